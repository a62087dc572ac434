//! Fits a model to photographs that are made up, keeps it, and asks it about another.
//!
//! `cargo run --release --example fit FOLDER`

use std::path::PathBuf;

use sps_dataset::{Surface, Units};
use sps_estimator::{
    About, Calibration, Embedder, Estimator, Examples, Frame, Network, Recipe, Regression,
};
use sps_metrics::Level;
use sps_models::encoders::{Encoder, EncoderKind};
use sps_regress::ridge::Ridge;
use sps_regress::{AnyRegressor, Embeddings, Readings, TrainingData};

const SIDE: usize = 48;
const SURFACES: usize = 40;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args_os().nth(1);
    let folder = PathBuf::from(folder.ok_or("name a folder to keep the model in")?);

    // Untrained weights do for an example; `Encoder::load` reads trained ones.
    let encoder = Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0)?;
    let embedder = Embedder::new(Network::Images(encoder), None)?;
    let photographs: Vec<Frame> = (0..SURFACES).map(photograph).collect();
    let values = embedder.embed(&photographs)?;

    // What was felt on each: rougher where the stripes are wide.
    let row = |surface| vec![Some(roughness(surface))];
    let rows: Vec<_> = (0..SURFACES).map(row).collect();
    let embeddings = Embeddings::new(values, [SURFACES, 1, embedder.width()])?;
    let readings = Readings::new(vec!["mTX".into()], &rows)?;
    let surface = |at: usize| Surface {
        id: at.to_string(),
        material: String::new(),
        group: at.to_string(),
    };
    let units = Units::of(&(0..SURFACES).map(surface).collect::<Vec<_>>());

    let ridge = AnyRegressor::Ridge(Ridge::default());
    let calibration = Calibration {
        share: Some(0.3),
        level: Level::P90,
        seed: 0,
    };
    let mut recipe = Recipe::new(Regression::Rows(ridge), ["mTX"], &[0], calibration);
    recipe.wanted[0].range = Some([0.0, 100.0]);
    let examples = Examples {
        data: TrainingData::new(&embeddings, &readings).with_units(units.of_surface()),
        units: &units,
        encoder_saw: &[],
    };
    let fitted = recipe.fit(&examples, &(0..SURFACES).collect::<Vec<_>>(), 0)?;
    let about = About {
        name: "stripes".into(),
        data: "made-up photographs of stripes".into(),
        frame_size: [SIDE, SIDE],
        angles: vec![0.0],
        ..About::default()
    };
    Estimator::new(embedder, fitted, about)?.save(&folder)?;

    let model = Estimator::load(&folder)?;
    let answer = model.predict(&[photograph(SURFACES + 1)])?;
    println!("felt: {:.1}; {:#?}", roughness(SURFACES + 1), answer);
    Ok(())
}

fn roughness(surface: usize) -> f64 {
    10.0 + (surface * 37 % 41) as f64
}

fn photograph(surface: usize) -> Frame {
    let width = 1.0 + roughness(surface) / 8.0;
    let value = |at: usize| {
        let (x, y) = ((at / 3) % SIDE, at / 3 / SIDE);
        let stripe = ((x as f64 + 0.3 * y as f64) / width).sin();
        (0.5 + 0.4 * stripe) as f32
    };
    Frame {
        width: SIDE,
        height: SIDE,
        data: (0..3 * SIDE * SIDE).map(value).collect(),
    }
}
