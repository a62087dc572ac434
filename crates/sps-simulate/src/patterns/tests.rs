//! Laws of patterns.

use super::noise::{Metric, from_point, gradient, hash, nearest, unit};
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

/// Gradient noise is 0 at the points of its lattice, and slopes there as one of its eight gradients.
#[test]
fn gradient_noise_is_what_its_lattice_says() {
    for (x, y) in [(0.0, 0.0), (-3.0, 7.0), (120.0, -41.0)] {
        assert_eq!(gradient([x, y], 9), 0.0);
        let step = 1.0 / 1024.0;
        let slope = [
            gradient([x + step, y], 9) / step,
            gradient([x, y + step], 9) / step,
        ];
        // 1.5 is the factor that brings the noise to about -1 to 1.
        let length = (slope[0] * slope[0] + slope[1] * slope[1]).sqrt() / 1.5;
        assert!((length - 1.0).abs() < 0.02, "{length}");
    }
}

/// The nearest point by looking at all around: with a jitter of a half, no point farther than the
/// neighbouring cells' can be the nearest or the next.
#[test]
fn the_nearest_point_is_the_nearest_of_all() {
    for metric in [Metric::Euclid, Metric::Blocks, Metric::Chess] {
        for i in 0..200 {
            let place = [0, 1].map(|axis| 40.0 * unit(hash(i, axis, 3)) - 20.0);
            let [column, row] = place.map(|v| v.floor() as i32);
            let mut all = Vec::new();
            for y in row - 4..=row + 4 {
                for x in column - 4..=column + 4 {
                    all.push(metric.length(from_point(place, [x, y], hash(x, y, 5), 0.5)));
                }
            }
            all.sort_by(f32::total_cmp);
            let found = nearest(place, 5, 0.5, metric);
            assert_eq!(found.first, all[0], "{metric:?} at {place:?}");
            assert_eq!(found.second, all[1], "{metric:?} at {place:?}");
        }
    }
}

/// The same bits on every machine: those of a few images are kept here, whatever they show.
#[test]
fn images_keep_their_bits() {
    let hash = |class| {
        let frame = Patterns::new(1).frame(class, 0, 32);
        let bytes: Vec<u8> = frame.data.iter().flat_map(|v| v.to_le_bytes()).collect();
        blake3::hash(&bytes).to_hex()[..16].to_string()
    };
    let all: Vec<String> = (0..24).map(hash).collect();
    let joined = blake3::hash(all.concat().as_bytes()).to_hex();
    assert_eq!(&joined[..16], "4d9579175f57b734");
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
