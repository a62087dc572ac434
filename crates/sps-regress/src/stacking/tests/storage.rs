//! Stacks, and models of every kind, as bytes and back.

use super::*;
use crate::regressor::{OtherKind, fitted_from_bytes};

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
    let mut set = Set::new(30);
    // A missing reading parts the training surfaces of the properties in rerun 0; in rerun 1 they share them.
    let rows = (0..30).map(|s| set.readings.row(s).unwrap().to_vec());
    let mut rows: Vec<_> = rows.collect();
    rows[0][0] = None;
    set.readings = Readings::new(set.readings.properties().to_vec(), &rows).unwrap();
    let (data, plan) = (set.data(), set.plan(2));
    let mut all = regressors();
    all.push(("stacks", Box::new(stack(2))));
    let within: Vec<Box<dyn Regressor>> = vec![Box::new(Nearest), Box::new(stack(1))];
    all.push(("stacks", Box::new(Stacking::new(within, 3).unwrap())));
    let fitted = all.into_iter().flat_map(|(kind, regressor)| {
        let fitted = regressor.fit(&data, &plan).unwrap();
        let one = fitted.filtered(&|trial| trial.property == "noise");
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
        read: |name, _| Err(Error::input("rules", name, "none")),
    };
    let error = fitted_from_bytes("ridge", "model.bin", b"", &[rules]);
    assert_eq!(
        error.err().unwrap().to_string(),
        "model.bin: kind of fitted models: found \"ridge\", expected one of rules, ridges, \
         kernel-ridges, nearest, stacks"
    );
    let error = fitted_from_bytes("rules", "model.bin", b"", &[rules]);
    let said = "rules: found model.bin, expected none";
    assert_eq!(error.err().unwrap().to_string(), said);
}

/// A stack of one member for one trial.
fn of_one(weight: f64, member: &dyn FittedRegressor) -> TrainedStacks {
    let trial = member.trials()[0].clone();
    let member = member.filtered(&|other| *other == trial);
    let stack = TrainedStack {
        trial,
        mean: 0.5,
        weights: vec![weight],
    };
    TrainedStacks {
        stacks: vec![stack],
        members: vec![member],
    }
}

#[test]
fn what_could_not_be_read_again_is_not_written() {
    let set = Set::new(30);
    let rule = Rule::new(|_| 1.0).fit(&set.data(), &set.plan(1)).unwrap();
    refused(of_one(1.0, rule.as_ref()).to_bytes(), "\"rules\"");
    let mut fitted = Nearest.fit(&set.data(), &set.plan(1)).unwrap();
    refused(of_one(f64::NAN, fitted.as_ref()).to_bytes(), "finite");
    fitted = Nearest.fit(&set.data(), &set.plan(1)).unwrap();
    for _ in 0..MOST_DEPTH {
        fitted = Box::new(of_one(1.0, fitted.as_ref()));
        let bytes = fitted.to_bytes().unwrap();
        let read = fitted_from_bytes("stacks", "file", &bytes, &[]).unwrap();
        let [found, expected] = [&read, &fitted].map(|f| f.predict(&set.embeddings).unwrap());
        assert_eq!(found, expected);
    }
    refused(of_one(1.0, fitted.as_ref()).to_bytes(), "9 deep");
}

/// The file with something else in its metadata, which are JSON in a string of JSON.
fn with(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let (length, rest) = bytes.split_first_chunk::<8>().unwrap();
    let (header, tensors) = rest.split_at(u64::from_le_bytes(*length) as usize);
    let header = std::str::from_utf8(header).unwrap();
    let [from, to] = [from, to].map(|text| text.replace('"', "\\\""));
    assert!(header.contains(&from), "{header}");
    let header = header.replacen(&from, &to, 1);
    let length = (header.len() as u64).to_le_bytes();
    [&length, header.as_bytes(), tensors].concat()
}

#[test]
fn stacks_that_do_not_fit_together_are_refused() {
    let set = Set::new(30);
    let fitted = Nearest.fit(&set.data(), &set.plan(1)).unwrap();
    let inner = of_one(0.25, fitted.as_ref());
    let bytes = of_one(0.5, &inner).to_bytes().unwrap();
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
        let changed = with(&bytes, from, to);
        let read = TrainedStacks::from_bytes(MOST_DEPTH, &changed, &[]);
        refused(read, expected);
        refused(fitted_from_bytes("stacks", "file", &changed, &[]), "file: ");
    }
}
