//! What a model says of a photograph.

use std::path::Path;

use sps_estimator::{Estimator, Scale};

fn main() -> sps_estimator::Result<()> {
    let model = Estimator::load(Path::new("models/smoke"))?;
    let path = Path::new("fixtures/tiny-dataset/frames/oak-01/002.jpg");
    let answer = model.predict(&[model.read(path, Scale::OfModel)?])?;
    for touch in answer.estimates {
        let (low, high) = (touch.low, touch.high);
        println!("{} {:.1} ({low:?} to {high:?})", touch.name, touch.value);
    }
    Ok(())
}
