//! Stacks, and models of every kind, as bytes and back.

use std::collections::HashMap;

use safetensors::Dtype;
use safetensors::tensor::TensorView;
use sps_regress::{OtherKind, Readings, fitted_from_bytes};

use super::*;

fn regressors() -> Vec<(&'static str, Box<dyn Regressor>)> {
    let ridge = Ridge::default();
    let kernel = KernelRidge::default();
    vec![
        ("ridges", Box::new(ridge)),
        ("kernel-ridges", Box::new(kernel)),
        ("nearest", Box::new(Nearest)),
    ]
}

/// A stack of the first `count` of them.
fn stack(count: usize) -> Stacking {
    let members = regressors().into_iter().map(|(_, member)| member);
    Stacking::new(members.take(count).collect(), 3).unwrap()
}

#[test]
fn bytes_give_back_the_same_estimates() {
    let mut set = Set::stacked(30);
    // A missing reading parts the training surfaces of the properties in rerun 0; in rerun 1 they share them.
    let rows = (0..30).map(|s| set.readings.row(s).unwrap().to_vec());
    let mut rows: Vec<_> = rows.collect();
    rows[0][0] = None;
    set.readings = Readings::new(set.readings.properties().to_vec(), &rows).unwrap();
    let (data, plan) = (set.data(), set.reruns(2));
    let mut all = regressors();
    all.push(("stacks", Box::new(stack(2))));
    let within: Vec<Box<dyn Regressor>> = vec![Box::new(Nearest), Box::new(stack(1))];
    all.push(("stacks", Box::new(Stacking::new(within, 3).unwrap())));
    let fitted = all.into_iter().flat_map(|(kind, regressor)| {
        let fitted = regressor.fit(&data, &plan).unwrap();
        let one = fitted.filtered(&|trial| trial.property == "p1");
        [(kind, fitted), (kind, one)]
    });
    for (kind, fitted) in fitted {
        assert_eq!(fitted.kind(), kind);
        let bytes = fitted.to_bytes().unwrap();
        let read = fitted_from_bytes(kind, "file", &bytes, &[]).unwrap();
        assert_eq!((read.kind(), read.trials()), (kind, fitted.trials()));
        let [found, expected] = [&read, &fitted].map(|f| f.predict(&set.embeddings).unwrap());
        assert_eq!(found, expected, "{kind}");
        assert_eq!(read.multiply_adds(), fitted.multiply_adds());
        assert!(read.to_bytes().unwrap() == bytes, "{kind}");
        // Stacks are long, and hold the others.
        let step = if kind == "stacks" { 7 } else { 1 };
        for length in (0..bytes.len()).step_by(step) {
            let read = fitted_from_bytes(kind, "file", &bytes[..length], &[]);
            refused(read, "file");
        }
    }
}

#[test]
fn a_kind_that_there_is_not_is_told_those_that_there_are() {
    let rules = OtherKind {
        kind: "rules",
        read: |name, _| Err(Error::Other(format!("rules of {name}").into())),
    };
    let error = fitted_from_bytes("ridge", "model.bin", b"", &[rules]);
    assert_eq!(
        error.err().unwrap().to_string(),
        "model.bin: kind of fitted models: found \"ridge\", expected one of rules, ridges, \
         kernel-ridges, nearest, stacks"
    );
    let error = fitted_from_bytes("rules", "model.bin", b"", &[rules]);
    assert_eq!(error.err().unwrap().to_string(), "rules of model.bin");
}

/// So many stacks, each the one member of the next.
fn nested(depth: usize) -> Box<dyn Regressor> {
    match depth {
        0 => Box::new(Nearest),
        depth => Box::new(Stacking::new(vec![nested(depth - 1)], 2).unwrap()),
    }
}

#[test]
fn what_could_not_be_read_again_is_not_written() {
    let set = Set::stacked(30);
    let mut rule = Rule::new(|x| f64::from(x[0]));
    rule.kept = false;
    let stack = Stacking::new(vec![Box::new(rule)], 2).unwrap();
    let stacks = stack.train(&set.data(), &set.reruns(1)).unwrap();
    refused(stacks.to_bytes(), "\"rules\"");
    let fitted = nested(9).fit(&set.data(), &set.reruns(1)).unwrap();
    refused(fitted.to_bytes(), "9 deep");
}

/// What a weight would have to be for a rule that says next to nothing.
#[test]
fn a_weight_that_is_not_finite_is_not_written() {
    let signs = (0..30).map(|s| [1.0_f32, -1.0][s % 2]);
    let readings = signs.clone().map(|x| Some(1e160 * f64::from(x))).collect();
    let embeddings = Embeddings::new(signs.collect(), [30, 1, 1]).unwrap();
    let set = Set::of(embeddings, &[readings]);
    let rule = Rule::new(|x| 1e-160 * f64::from(x[0]));
    let stack = Stacking::new(vec![Box::new(rule)], 2).unwrap();
    let stacks = stack.train(&set.data(), &set.reruns(1)).unwrap();
    refused(stacks.to_bytes(), "stacks: found inf, expected finite");
}

/// The metadata of a stack of one member, for the first trial.
fn metadata(depth: usize, member: &str, weight: f64) -> String {
    let trial = r#"{"property":"p0","rerun":0,"views":{"fixed":[0]}}"#;
    let stack = format!(r#"{{"trial":{trial},"mean":0.5,"weights":[{weight:?}]}}"#);
    format!(r#"{{"format":1,"depth":{depth},"members":["{member}"],"stacks":[{stack}]}}"#)
}

fn file(metadata: &str, member: &dyn FittedRegressor) -> Vec<u8> {
    let member = member.to_bytes().unwrap();
    let member = TensorView::new(Dtype::U8, vec![member.len()], &member).unwrap();
    let metadata = HashMap::from([("sps-stacks".into(), metadata.into())]);
    safetensors::serialize([("0", member)], Some(metadata)).unwrap()
}

/// Of the first trial, with stacks of weight 1 over it.
fn deep(depth: usize, set: &Set) -> Box<dyn FittedRegressor> {
    if depth == 0 {
        let fitted = Nearest.fit(&set.data(), &set.reruns(1)).unwrap();
        return fitted.filtered(&|trial| trial.property == "p0");
    }
    let member = deep(depth - 1, set);
    let bytes = file(&metadata(depth, member.kind(), 1.0), member.as_ref());
    let read = fitted_from_bytes("stacks", "file", &bytes, &[]).unwrap();
    assert!(read.to_bytes().unwrap() == bytes);
    read
}

#[test]
fn stacks_may_be_8_deep() {
    let set = Set::stacked(30);
    let estimates = |depth| {
        deep(depth, &set)
            .predict(&set.embeddings)
            .unwrap()
            .remove(0)
    };
    for (found, expected) in estimates(8).values.iter().zip(estimates(0).values) {
        assert!((found - expected).abs() < 1e-12);
    }
}

#[test]
fn stacks_that_do_not_fit_together_are_refused() {
    let inner = deep(1, &Set::stacked(30));
    let outer = metadata(2, "stacks", 0.5);
    assert!(fitted_from_bytes("stacks", "file", &file(&outer, inner.as_ref()), &[]).is_ok());
    let (members, weights) = (r#"["stacks"]"#, "\"weights\":[0.5]");
    for (from, to, expected) in [
        ("\"format\":1", "\"format\":2", "format 2"),
        ("\"depth\":2", "\"depth\":1", "1 deep, expected 1 to 0 deep"),
        ("\"depth\":2", "\"depth\":9", "9 deep, expected 1 to 8 deep"),
        (
            members,
            "[\"stack\"]",
            "member 0: kind of fitted models: found \"stack\"",
        ),
        (members, r#"["nearest"]"#, "member 0: nearest neighbours"),
        (members, "[]", "0 members"),
        (members, r#"["stacks","stacks"]"#, "1 tensors, expected 2"),
        (weights, "\"weights\":[]", "weights []"),
        (weights, "\"weights\":[-0.5]", "[-0.5]"),
        (
            weights,
            "\"weights\":[0]",
            "member 0 of 1 trials, expected one of the 0",
        ),
        (weights, "\"weights\":[1e999]", "out of range"),
        ("\"rerun\":0", "\"rerun\":1", "member 0 of 1 trials"),
        ("\"mean\"", "\"median\"", "median"),
    ] {
        assert!(outer.contains(from), "{from}");
        let changed = file(&outer.replacen(from, to, 1), inner.as_ref());
        let read = || fitted_from_bytes("stacks", "file", &changed, &[]);
        refused(read(), expected);
        refused(read(), "file: ");
    }
}
