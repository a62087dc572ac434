//! What a model says of a photograph.

use std::path::Path;

use sps_estimator::{Estimator, Scale};

fn main() -> sps_estimator::Result<()> {
    let model = Estimator::load(Path::new("models/smoke"))?;
    let path = Path::new("fixtures/tiny-dataset/frames/oak-01/002.jpg");
    for touch in model
        .predict(&[model.read(path, Scale::OfModel)?])?
        .estimates
    {
        println!(
            "{} {:.1} ({:?} to {:?})",
            touch.name, touch.value, touch.low, touch.high
        );
    }
    Ok(())
}
