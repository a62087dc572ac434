//! Features that stay as they are.

use candle_core::Tensor;

use super::*;
use crate::heads::Share;

/// Of two blocks.
fn encoder() -> Encoder {
    let depths = Depths::Named(vec!["stage-1".to_owned(), "stage-3".to_owned()]);
    start().with_depths(&depths).unwrap()
}

fn kept(images: std::ops::Range<usize>, weight: f64) -> Result<Kept> {
    Kept::new(encoder(), images, &Stripes::new(24), weight)
}

/// Features that are off by one standard deviation each have a loss of their weight, whatever is said of other images.
#[test]
fn the_loss_is_that_of_its_definition() {
    let kept = kept(0..20, 3.0).unwrap();
    let images = shown(&Stripes::new(24), 24);
    let wanted = encoder().embed(&images).unwrap();
    // By the sum of squares less that of the mean.
    let mean = |x: Tensor| x.narrow(0, 0, 20).unwrap().mean_keepdim(0).unwrap();
    let square = mean(wanted.sqr().unwrap());
    let std = (square - mean(wanted.clone()).sqr().unwrap()).unwrap();
    let std = std.relu().unwrap().sqrt().unwrap();
    let off = wanted.broadcast_add(&std).unwrap();
    let loss = |embeddings: &Tensor, surfaces: &[usize], of: &[usize]| {
        let rows: Vec<u32> = surfaces.iter().map(|&image| image as u32).collect();
        let rows = Tensor::new(rows, embeddings.device()).unwrap();
        let [images, embeddings] = [&images, embeddings].map(|t| t.index_select(&rows, 0).unwrap());
        let loss = kept
            .loss(&images, &embeddings, Share { surfaces, of })
            .unwrap();
        loss.map(|loss| f64::from(loss.to_scalar::<f32>().unwrap()))
    };
    let all = [1, 22, 7, 12, 23];
    assert!(loss(&wanted, &all, &all).unwrap() < 1e-9);
    let whole = loss(&off, &all, &all).unwrap();
    assert!((whole - 3.0).abs() < 1e-2, "{whole}");
    // Parts of a step add up to it.
    let parts = [loss(&off, &all[..2], &all), loss(&off, &all[2..], &all)];
    let sum: f64 = parts.into_iter().flatten().sum();
    assert!((sum - whole).abs() < 1e-5, "{sum}");
    assert_eq!(loss(&off, &[22, 23], &all), None);
}

/// By how much the features of the last images move in a training, as the loss says it.
fn moved(weight: Option<f64>) -> f64 {
    let stripes = Stripes::new(24);
    let targets = Targets {
        kept: weight.map(|weight| kept(0..24, weight).unwrap()),
        ..stripes.targets()
    };
    let config = TrainingConfig {
        running_statistics: Some(true),
        epochs: 4,
        ..config()
    };
    let mut trainer = Trainer::new(&encoder(), targets, stripes.parts(), config, 5).unwrap();
    to_the_end(&mut trainer, &stripes);
    let trained = trainer.into_encoder().unwrap();
    let images = shown(&stripes, 24);
    let embeddings = trained.embed(&images).unwrap();
    let all: Vec<usize> = (0..24).collect();
    let loss = kept(0..24, 1.0)
        .unwrap()
        .loss(&images, &embeddings, Share::whole(&all));
    f64::from(loss.unwrap().unwrap().to_scalar::<f32>().unwrap())
}

#[test]
fn features_that_are_kept_move_less() {
    let (free, held) = (moved(None), moved(Some(30.0)));
    println!("free {free:.2e}, kept {held:.2e}");
    assert!(held < 0.2 * free, "free {free:.2e}, kept {held:.2e}");
}

#[test]
fn a_stopped_training_goes_on_and_knows_what_is_kept() {
    let stripes = Stripes::new(24);
    let targets = |weight| Targets {
        kept: Some(kept(0..10, weight).unwrap()),
        ..stripes.targets()
    };
    let resumed = |state: &[u8], weight| {
        let (targets, parts) = (targets(weight), stripes.parts());
        Trainer::resume("a state", state, targets, parts, config(), 5)
    };
    let new = || Trainer::new(&encoder(), targets(2.0), stripes.parts(), config(), 5).unwrap();
    ends_alike(&stripes, new, |state| resumed(state, 2.0).unwrap());
    let state = new().to_bytes().unwrap();
    golden::refused(resumed(&state, 3.0), "a state of these targets and parts");
}

#[test]
fn what_cannot_be_kept_is_refused() {
    for weight in [0.0, -1.0, f64::NAN] {
        golden::refused(kept(0..4, weight), "weight of kept features");
    }
    let stripes = Stripes::new(24);
    let targets = Targets {
        kept: Some(kept(0..4, 1.0).unwrap()),
        ..stripes.targets()
    };
    let trainer = Trainer::new(&start(), targets, stripes.parts(), config(), 5);
    golden::refused(trainer, "kept features");
}
