//! Laws of patterns.

use super::*;

fn spread(frame: &Frame) -> f64 {
    let count = frame.data.len() as f64;
    let mean = frame.data.iter().map(|&v| f64::from(v)).sum::<f64>() / count;
    let squares = frame.data.iter().map(|&v| (f64::from(v) - mean).powi(2));
    (squares.sum::<f64>() / count).sqrt()
}

#[test]
fn images_are_displayed_values_and_hardly_any_is_plain() {
    let patterns = Patterns::new(5);
    let frames: Vec<Frame> = (0..300).map(|class| patterns.frame(class, 0, 24)).collect();
    for frame in &frames {
        assert_eq!(frame.data.len(), 24 * 24 * 3);
        assert!(frame.data.iter().all(|v| (0.0..=1.0).contains(v)));
    }
    let plain = frames.iter().filter(|frame| spread(frame) < 0.01).count();
    assert!(plain <= 15, "{plain} of 300 show nothing");
}

/// Another seed, class or number is another image.
#[test]
fn seed_class_and_number_each_change_the_image() {
    let frame = |seed, class, number| Patterns::new(seed).frame(class, number, 16);
    let first = frame(1, 2, 3);
    assert_eq!(first, frame(1, 2, 3));
    for other in [frame(2, 2, 3), frame(1, 3, 3), frame(1, 2, 4)] {
        assert_ne!(first, other);
    }
}

/// The same on every machine: bits of a few images, as they were when this was written.
#[test]
fn images_keep_their_bits() {
    let hash = |class| {
        let frame = Patterns::new(1).frame(class, 0, 32);
        let bytes: Vec<u8> = frame.data.iter().flat_map(|v| v.to_le_bytes()).collect();
        blake3::hash(&bytes).to_hex()[..16].to_string()
    };
    let all: Vec<String> = (0..24).map(hash).collect();
    let joined = blake3::hash(all.concat().as_bytes()).to_hex();
    assert_eq!(&joined[..16], "1467a0443cbf9860");
}

mod hard_cases {
    use super::*;

    #[test]
    fn an_image_of_one_pixel_is_one() {
        assert_eq!(Patterns::new(0).frame(0, 0, 1).data.len(), 3);
    }

    #[test]
    fn an_image_without_pixels_has_none() {
        assert_eq!(Patterns::new(0).frame(0, 0, 0).data.len(), 0);
    }
}
