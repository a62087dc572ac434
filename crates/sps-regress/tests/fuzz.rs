//! Whatever bytes a reader of fitted regressions is given, it answers within its limits; `fixtures/fuzz`
//! says which.

#[path = "../../../fixtures/fuzz/mod.rs"]
mod fuzz;
#[path = "../../../fixtures/fuzz/surfaces.rs"]
mod surfaces;

use std::collections::HashMap;

use fuzz::{Damage, broken, damaged, fuzz, nested, said};
use safetensors::tensor::TensorView;
use sps_regress::kernel_ridge::{KernelRidge, KernelRidgeConfig};
use sps_regress::nearest::Nearest;
use sps_regress::ridge::Ridge;
use sps_regress::stacking::Stacking;
use sps_regress::{FittedRegressor, Regressor, fitted_from_bytes};
use surfaces::Made;

#[test]
fn ridges() {
    let made = Made::new();
    let ridge = Ridge::default();
    let trained = ridge.train(&made.data(), &made.plan());
    let file = trained.unwrap().to_bytes().unwrap();
    let read = |bytes: &[u8]| {
        if let Some(ridges) = said(fitted_from_bytes("ridges", "file", bytes, &[])) {
            said(ridges.predict(&made.embeddings));
        }
    };
    fuzz("ridge regressions", &Damage::some(), |damages| {
        read(&damaged(file.clone(), &damages));
    });
    nested("ridge regressions", |text| read(text.as_bytes()));
}

/// The last is of a kernel ridge and of a stack of a ridge.
#[test]
fn archives() {
    let made = Made::new();
    let stacking = |members| Stacking::new(members, 2).unwrap();
    let ridge = Ridge::default();
    let kernel = KernelRidge::default();
    let stack = stacking(vec![
        Box::new(kernel.clone()),
        Box::new(stacking(vec![Box::new(ridge)])),
    ]);
    let twice = KernelRidge::new(KernelRidgeConfig {
        stacked_targets: true,
        ..KernelRidgeConfig::default()
    });
    let regressors: [Box<dyn Regressor>; 4] = [
        Box::new(kernel),
        Box::new(twice.unwrap()),
        Box::new(Nearest),
        Box::new(stack),
    ];
    for regressor in regressors {
        let fitted = regressor.fit(&made.data(), &made.plan()).unwrap();
        let files = vec![fitted.to_bytes().unwrap()];
        fuzz(fitted.kind(), &broken(files), |bytes| {
            if let Some(read) = said(fitted_from_bytes(fitted.kind(), "file", &bytes, &[])) {
                said(read.predict(&made.embeddings));
            }
        });
    }
}

/// Metadata that nest.
#[test]
fn metadata_that_nest() {
    nested("metadata", |text| {
        for kind in ["kernel-ridges", "nearest", "stacks"] {
            let metadata = HashMap::from([(format!("sps-{kind}"), text.clone())]);
            let tensors: [(&str, TensorView<'_>); 0] = [];
            let file = safetensors::serialize(tensors, Some(metadata)).unwrap();
            assert!(said(fitted_from_bytes(kind, "file", &file, &[])).is_none());
        }
    });
}
