//! A model whose encoder is an ONNX file.
#![cfg(feature = "onnx")]

mod support;

use std::path::Path;

use sps_estimator::{Embedder, Estimator, Frame, Network, OnnxEncoder, OnnxSettings, Sight};
use support::{Tables, about, examples, photograph, recipe, refused, ridge};

fn network() -> Network {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/onnx/tiny.onnx");
    let settings = OnnxSettings {
        outputs: vec!["map".to_owned(), "pooled".to_owned()],
        ..OnnxSettings::default()
    };
    Network::Onnx(OnnxEncoder::read(&path, settings).unwrap())
}

#[test]
fn a_model_keeps_its_network() {
    let embedder = Embedder::new(network(), None).unwrap();
    assert_eq!((embedder.resize(), embedder.width()), (Some(16), 7));
    let other = Embedder::new(network(), Some(20)).unwrap();
    assert_ne!(embedder.identity(), other.identity());

    let frames: Vec<Frame> = (0..40).map(|surface| photograph(surface, 0)).collect();
    let values = embedder.embed(&frames).unwrap();
    // A photograph's embedding does not depend on those beside it.
    assert_eq!(embedder.embed(&frames[7..8]).unwrap(), values[7 * 7..8 * 7]);
    let tables = Tables::new(40, 1, 1);
    let embeddings = embedder.table(&values, 40, 1).unwrap();
    let examples = examples(&embeddings, &tables.readings, &tables.units);
    let fitted = recipe(ridge(), &[0]).fit(&examples, &tables.all(), 0);
    let estimator = Estimator::new(embedder, fitted.unwrap(), about(&[0])).unwrap();
    let folder = tempfile::tempdir().unwrap();
    estimator.save(folder.path()).unwrap();
    let again = Estimator::load(folder.path()).unwrap();
    let answer = again.predict(&frames[..1]).unwrap();
    assert_eq!(answer, estimator.predict(&frames[..1]).unwrap());
    // The map of a photograph that is one window is its estimate.
    let map = again.map(&frames[0], 1, Sight::Within).unwrap();
    let values = &map.predictions.properties[0].values;
    assert_eq!(*values, [answer.estimates[0].value]);

    std::fs::write(folder.path().join("encoder.onnx"), b"another").unwrap();
    refused(Estimator::load(folder.path()), "encoder.onnx");
}
