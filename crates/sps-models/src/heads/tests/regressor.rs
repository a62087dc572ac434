//! Heads as regressors, beside others and in stacks of them.

use sps_regress::kernel_ridge::{KernelRidge, KernelRidgeConfig};
use sps_regress::nearest::Nearest;
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::stacking::Stacking;
use sps_regress::{FittedRegressor, Regressor};

use super::*;
use crate::fitted_from_bytes;

fn small() -> Head {
    let config = HeadConfig {
        model: Model::Regression {},
        epochs: 2,
        ..HeadConfig::default()
    };
    Head::new(config).unwrap()
}

/// Of a head among others.
fn stack() -> Stacking {
    let ridge = Ridge::new(RidgeConfig::default()).unwrap();
    let kernel = KernelRidge::new(KernelRidgeConfig::default()).unwrap();
    let members: Vec<Box<dyn Regressor>> =
        vec![Box::new(ridge), Box::new(kernel), Box::new(small())];
    Stacking::new(members, 3).unwrap()
}

#[test]
fn bytes_give_back_the_same_estimates() {
    let set = Set::new(30, 1, 3, 2);
    let (data, plan) = (set.data(), set.plan(2));
    let within: Vec<Box<dyn Regressor>> = vec![Box::new(Nearest), Box::new(stack())];
    let deep = Stacking::new(within, 3).unwrap();
    let all: [(&str, &dyn Regressor); 3] =
        [("heads", &small()), ("stacks", &stack()), ("stacks", &deep)];
    for (kind, regressor) in all {
        let fitted = regressor.fit(&data, &plan).unwrap();
        assert_eq!(fitted.kind(), kind);
        let bytes = fitted.to_bytes().unwrap();
        let read = fitted_from_bytes(kind, "file", &bytes).unwrap();
        assert_eq!((read.kind(), read.trials()), (kind, fitted.trials()));
        let estimates = |f: &dyn FittedRegressor| f.predict(&set.embeddings).unwrap();
        assert_eq!(estimates(&*read), estimates(&*fitted), "{kind}");
        assert_eq!(read.multiply_adds(), fitted.multiply_adds());
        assert!(read.to_bytes().unwrap() == bytes, "{kind}");
        let lengths = (0..bytes.len()).step_by(7);
        for length in lengths.chain([1, 8, 9, bytes.len() - 1]) {
            let Err(error) = fitted_from_bytes(kind, "file", &bytes[..length]) else {
                panic!("{kind} cut after {length} bytes was read");
            };
            let error = error.to_string();
            assert!(error.contains("file"), "{kind}, {length} bytes: {error}");
        }
    }
}

#[test]
fn a_kind_that_there_is_not_is_told_those_that_there_are() {
    let error = fitted_from_bytes("ridge", "model.bin", b"").err().unwrap();
    assert_eq!(
        error.to_string(),
        "model.bin: kind of fitted models: found \"ridge\", expected one of heads, ridges, \
         kernel-ridges, nearest, stacks"
    );
}

#[test]
fn a_head_that_stops_early_is_no_member() {
    let head = Head::new(HeadConfig {
        early_stopping: Some(EarlyStopping::default()),
        ..HeadConfig::default()
    });
    let stack = Stacking::new(vec![Box::new(head.unwrap())], 2);
    golden::refused(stack, "early stopping");
}

/// What a head says goes through a regressor's error unchanged.
#[test]
fn errors_come_out_as_they_were() {
    let set = Set::new(30, 1, 3, 2);
    let fitted = small().fit(&set.data(), &set.plan(1)).unwrap();
    let other = Set::new(30, 1, 4, 2).embeddings;
    let error = crate::Error::from(fitted.predict(&other).unwrap_err());
    let what = "embeddings for prediction: ";
    assert!(matches!(error, crate::Error::Input(_)), "{error}");
    assert!(error.to_string().starts_with(what), "{error}");
}

/// Two views of two blocks, 2 and 3 wide. Powers of two change no bit, so that estimates must be the
/// same to the last.
#[test]
fn units_of_blocks_do_not_matter() {
    let estimates = |units: [f32; 2]| {
        let mut set = Set::new(30, 2, 5, 1);
        let views = (0..30).flat_map(|s| [0, 1].map(|view| set.embeddings.get(s, view).unwrap()));
        let unit = |at: usize| units[usize::from(at >= 2)];
        let values = views.flat_map(|row| row.iter().enumerate().map(|(at, x)| x * unit(at)));
        let embeddings = Embeddings::new(values.collect(), [30, 2, 5]).unwrap();
        set.embeddings = embeddings.in_blocks(&[2, 3]).unwrap();
        let mut plan = set.plan(1);
        plan.trials[0].views = Views::Fixed(vec![0, 1]);
        let config = HeadConfig {
            epochs: 2,
            input: Input::LateFusion { views: 2 },
            ..HeadConfig::default()
        };
        let head = set.train(&config, &plan);
        head.predict(&set.embeddings).unwrap()
    };
    assert_eq!(estimates([1.0; 2]), estimates([8.0, 0.25]));
}
