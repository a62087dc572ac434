//! Trainings of a network of sequences.

use super::*;

/// Sequences of three frames that grow brighter or darker; how bright they are is the value.
struct Ramps(Stripes);

impl ImageSource for Ramps {
    fn image(&self, index: usize) -> Result<Image, Box<dyn StdError + Send + Sync>> {
        const SIDE: usize = 16;
        let bright = self.0.brightness[index] as f32;
        let frame = |time: usize| {
            let rising = index.is_multiple_of(2);
            let time = if rising { time } else { 2 - time };
            [bright * (0.5 + 0.25 * time as f32); 3 * SIDE * SIDE]
        };
        let frames = (0..3).flat_map(frame).collect();
        Ok(Image::sequence(3, SIDE, SIDE, frames)?)
    }
}

fn ramps() -> (Ramps, Targets, Parts) {
    let stripes = Stripes::new(24);
    let (targets, parts) = (stripes.targets(), stripes.parts());
    (Ramps(stripes), targets, parts)
}

fn start() -> Encoder {
    Encoder::seeded(EncoderKind::I3d, 0).unwrap()
}

fn trainer() -> Trainer {
    let (_, targets, parts) = ramps();
    Trainer::new(&start(), targets, parts, config(), 5).unwrap()
}

#[test]
fn a_network_of_sequences_learns_and_goes_on_with_the_same_bits() {
    let (ramps, targets, parts) = ramps();
    let mut through = trainer();
    epochs(&mut through, &ramps, 4);
    let of = |epoch: usize| through.history()[epoch].training.total();
    assert!(of(3) < 0.8 * of(0), "{} after {}", of(3), of(0));

    let mut stopped = trainer();
    on_threads(3, || epochs(&mut stopped, &ramps, 1));
    let state = stopped.to_bytes().unwrap();
    let mut again = Trainer::resume("a state", &state, targets, parts, config(), 5).unwrap();
    epochs(&mut again, &ramps, 3);
    assert!(again.to_bytes().unwrap() == through.to_bytes().unwrap());
}

#[test]
fn images_are_not_sequences() {
    let (ramps, targets, parts) = ramps();
    let stripes = Stripes::new(24);
    let mut of_sequences = trainer();
    let epoch = of_sequences.epoch(&stripes, |_| ());
    golden::refused(epoch, "(n, 3, frames, height, width)");

    let images = super::start();
    let mut of_images = Trainer::new(&images, targets, parts, config(), 5).unwrap();
    let epoch = of_images.epoch(&ramps, |_| ());
    golden::refused(epoch, "(n, 3, height, width)");
}
