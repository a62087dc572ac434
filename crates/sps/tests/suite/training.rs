//! Training encoders from the command line.

use std::fs;

use crate::support::{Ends, Scratch};
use serde_json::Value;

/// An experiment in which the encoder of each of two reruns is trained, through heads with all their losses.
fn fine_tune(scratch: &Scratch, more: &[&str]) -> (Value, String) {
    let mut command = scratch.sps(
        "experiment configs/end-to-end.toml --fresh --only frozen --only heads --out @run \
         --set reruns=2 --set data.simulated.surfaces=20 --set data.simulated.test-surfaces=10 \
         --set data.simulated.size=32 --set encoder.name=squeezenet1-1 --set encoder.depths=last \
         --set encoder.weights=untrained --set encoder.training.epochs=2 --set head.epochs=2 \
         --set encoder.training.frozen-epochs=0 --set encoder.training.validation=0 \
         --set encoder.training.patience=0 \
         --set cache.folder=@cache --set properties=[\"fRS\",\"mTX\"]",
    );
    command.set(more);
    let log = command.logged();
    (scratch.results(), log)
}

fn entries(scratch: &Scratch, folder: &str) -> usize {
    fs::read_dir(scratch.path(folder)).unwrap().count()
}

#[test]
fn an_encoder_is_trained_once_for_each_rerun() {
    let scratch = Scratch::new();
    let (results, log) = fine_tune(&scratch, &[]);
    assert!(!log.contains("trained before"), "{log}");
    assert_eq!(entries(&scratch, "cache/encoders"), 2);
    for entry in fs::read_dir(scratch.path("cache/encoders")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let epochs = scratch.json(&format!("cache/encoders/{name}/epochs.json"));
        for loss in "values classes embedding generator discriminator".split(' ') {
            let value = epochs[1]["training"][loss].as_f64().unwrap();
            assert!(value.is_finite() && value != 0.0, "{loss}: {value}");
        }
    }
    let (again, log) = fine_tune(&scratch, &[]);
    assert_eq!(log.matches("trained before").count(), 2, "{log}");
    assert_eq!(again, results);
}

/// Embeddings are kept by what computes them.
#[test]
fn a_trained_encoder_computes_in_the_precision_that_is_asked_for() {
    let scratch = Scratch::new();
    fine_tune(&scratch, &[]);
    assert_eq!(entries(&scratch, "cache/embeddings"), 3);
    fine_tune(&scratch, &["encoder.precision=bf16"]);
    assert_eq!(entries(&scratch, "cache/embeddings"), 6);
    // Scaled for what each rerun trains on: two frozen, what training starts from, two trained.
    fine_tune(&scratch, &["encoder.precision=int8"]);
    assert_eq!(entries(&scratch, "cache/embeddings"), 10);
}
