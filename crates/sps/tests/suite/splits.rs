//! What splits keep together, from the config to the results.

use std::collections::BTreeSet;

use crate::support::{Ends, Scratch, expect, method, rows};
use serde::Deserialize;

/// A line of `predictions.csv`.
#[derive(Deserialize)]
struct Prediction {
    rerun: usize,
    surface: String,
    truth: f64,
    estimate: f64,
    group: String,
}

/// Three reruns of two folds by material: denim and wood have two surfaces each, sponge and ceramic
/// one. R² is the mean over reruns of `1 - sum (y - e)² / sum (y - m)²`, over both folds of a rerun
/// with the training mean `m` of each.
#[test]
fn folds_by_material_are_pooled_in_a_rerun_and_differ_between_reruns() {
    let scratch = Scratch::new();
    let mut run = scratch.experiment_into("run --only ridge");
    let split = "split={k-fold={folds=2,by=\"material\"}}";
    run.set(&[split, "reruns=3", "properties=[\"fRS\"]"]);
    run.assert().success();
    let results = scratch.results();
    assert_eq!(results["dataset"]["unit"], "material");
    assert_eq!(results["dataset"]["units"], 4);
    let note = results["notes"][0].as_str().unwrap();
    assert!(note.starts_with("splits are by material"), "{note}");
    assert!(note.ends_with("2 of 4 materials, 0.50 of the surfaces"));

    let ridge = method(&results, "ridge");
    let means = ridge["training_means"]["fRS"].as_array().unwrap();
    let mut all: Vec<Prediction> = rows(&scratch.read("run/predictions.csv"));
    all.sort_by_key(|one| one.rerun);
    let folds = all.chunk_by(|one, other| one.rerun == other.rerun);
    let folds: Vec<&[Prediction]> = folds.collect();
    assert_eq!((folds.len(), means.len()), (6, 6));
    let mut r2 = 0.0;
    for (rerun, means) in folds.chunks(2).zip(means.chunks(2)) {
        let names = rerun.iter().copied().flatten().map(|p| &*p.surface);
        assert_eq!(names.collect::<BTreeSet<_>>().len(), 6);
        let mut groups = rerun[0].iter().map(|p| &p.group);
        assert!(groups.all(|group| rerun[1].iter().all(|p| p.group != *group)));
        let (mut errors, mut distances) = (0.0, 0.0);
        for (fold, mean) in rerun.iter().zip(means) {
            for one in *fold {
                errors += (one.truth - one.estimate).powi(2);
                distances += (one.truth - mean.as_f64().unwrap()).powi(2);
            }
        }
        r2 += (1.0 - errors / distances) / 3.0;
    }
    let scored = ridge["r2"]["fRS"].as_f64().unwrap();
    assert!((scored - r2).abs() < 1e-9, "{scored}, {r2}");
    let held_out = |fold: &[Prediction]| fold.iter().map(|p| p.surface.clone()).collect::<Vec<_>>();
    let first = held_out(folds[0]);
    let mut others = folds[2..].iter().map(|fold| held_out(fold));
    assert!(others.any(|other| other.contains(&first[0]) && other != first));
}

/// One bolt of denim has two surfaces. By surface, a model that is trained on one is asked about the other.
#[test]
fn training_says_which_question_was_asked() {
    let scratch = Scratch::new();
    let train = |by: &str, parts: &str| {
        let split = format!("split={{leave-one-out={{by=\"{by}\"}}}}");
        let mut train = scratch.sps(&format!("fit --config @tiny.toml --out @{by}"));
        train.set(&["train.method=ridge", "reruns=1", &split]);
        let said = train.said();
        expect(&said, parts);
        said
    };
    let known =
        "splits are by surface: 33.3 % of the surfaces held out are of a group that was trained on";
    train("surface", known);
    let calibrated = "the intervals of the model are calibrated on 1 of 5 groups";
    let said = train("group", calibrated);
    let new = "splits are by group: scores tell what is known of new groups; 33.3 % of the surfaces \
        held out are of a material";
    assert!(said.contains(new), "{said}");
}
