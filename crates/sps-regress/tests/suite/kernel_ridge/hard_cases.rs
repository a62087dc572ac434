use std::collections::BTreeSet;

use safetensors::SafeTensors;
use sps_regress::Error;

use super::*;

#[test]
fn one_surface_is_its_own_mean_and_equal_ones_get_theirs() {
    let one = Set::new((3, 1, 4), &[vec![Some(7.0), None, None]]);
    let values = [0.1_f32, 0.2, 0.7].repeat(5);
    let embeddings = Embeddings::new(values, [5, 1, 3]).unwrap();
    let equal = Set::of(embeddings, &[[1.0, 2.0, 3.0, 4.0, 5.0].map(Some).to_vec()]);
    for kernel in [Kernel::Exponential, Kernel::Gaussian, Kernel::Linear] {
        let config = config(kernel, &[1e-9, 0.1], &[1.0]);
        let trained = one.train(&config, 3, &[0]).unwrap();
        assert_eq!(estimates(&trained, &one.embeddings), [7.0; 3]);
        assert_eq!(trained.models()[0].left_out_error(), None);
        let trained = equal.train(&config, 5, &[0]).unwrap();
        assert_eq!(estimates(&trained, &equal.embeddings), [3.0; 5]);
    }
}

/// Two equal surfaces with unlike readings, among others.
#[test]
fn two_equal_surfaces_are_fitted_alike() {
    let mut values: Vec<f32> = uniform("kernel.x", 30).iter().map(|&x| x as f32).collect();
    values.copy_within(0..3, 3);
    let readings: Vec<_> = values.chunks(3).map(|x| Some(f64::from(x[0]))).collect();
    let mut unlike = readings.clone();
    unlike[0] = Some(0.5);
    let embeddings = Embeddings::new(values, [10, 1, 3]).unwrap();
    let set = Set::of(embeddings, &[unlike]);
    let config = config(Kernel::Exponential, &[1e-12, 1e-3], &[1.0]);
    let trained = set.train(&config, 10, &[0]).unwrap();
    let estimates = estimates(&trained, &set.embeddings);
    assert!(estimates.iter().all(|value| value.is_finite()));
    assert_eq!(estimates[0], estimates[1]);
}

#[test]
fn constant_readings_are_kept() {
    let set = Set::new((12, 1, 3), &[vec![Some(0.1); 12]]);
    let trained = set.train(&KernelRidgeConfig::default(), 12, &[0]).unwrap();
    close(&estimates(&trained, &set.embeddings), &[0.1; 12], 1e-15);
}

/// The surfaces without a reading are not there for that property.
#[test]
fn gaps_are_left_out() {
    let shape = (40, 1, 5);
    let mut gaps = smooth(shape);
    gaps[..6].fill(None);
    let set = Set::new(shape, &[smooth(shape), gaps.clone()]);
    let trained = set.train(&KernelRidgeConfig::default(), 30, &[0]).unwrap();
    let plan = set.plan(6..30, &[0]);
    let ridge = KernelRidge::default();
    let without = ridge.train(&set.data(), &plan).unwrap();
    assert_eq!(trained.models()[1], without.models()[1]);
    let errors = [&trained, &without].map(|all| all.models()[0].left_out_error());
    assert_ne!(errors[0], errors[1]);
}

#[test]
fn what_does_not_fit_is_refused() {
    let shape = (20, 2, 3);
    let set = Set::new(shape, &[smooth(shape)]);
    for (penalties, widths) in [
        (&[][..], &[1.0][..]),
        (&[0.1], &[]),
        (&[0.0], &[1.0]),
        (&[f64::INFINITY], &[1.0]),
        (&[0.1], &[-1.0]),
        (&[0.1], &[f64::NAN]),
    ] {
        let config = config(Kernel::Gaussian, penalties, widths);
        assert!(matches!(KernelRidge::new(config), Err(Error::Input(_))));
    }
    let trained = set.train(&KernelRidgeConfig::default(), 20, &[0]).unwrap();
    let error = trained.predict(&set.embeddings).unwrap_err();
    assert!(error.to_string().contains("2 views of width 3"), "{error}");
    let mut plan = set.plan(0..20, &[0]);
    plan.trials[0].views = Views::Random;
    let ridge = KernelRidge::default();
    assert!(ridge.train(&set.data(), &plan).is_err());
}

/// Readings whose mean leaves f64, and such whose squares do.
#[test]
fn numbers_that_are_not_finite_cannot_be_stored() {
    for reading in [f64::MAX, 1e200] {
        let signs = [1.0, 1.0, 1.0, -1.0, 1.0];
        let readings = signs.map(|sign| Some(sign * reading)).to_vec();
        let set = Set::new((5, 1, 4), &[readings]);
        let config = KernelRidgeConfig::default();
        let stored = set.train(&config, 5, &[0]).unwrap().to_bytes();
        let message = stored.unwrap_err().to_string();
        assert!(message.contains("finite"), "{message}");
        let ridge = Ridge::default();
        let trained = ridge.train(&set.data(), &set.plan(0..5, &[0])).unwrap();
        if reading == f64::MAX {
            let message = trained.to_bytes().unwrap_err().to_string();
            assert!(message.contains("finite"), "{message}");
        }
    }
}

/// The fit is that of the surfaces drawn, whatever their order in the plan; another rerun draws others.
#[test]
fn of_many_surfaces_some_are_drawn() {
    let set = Set::new((60, 1, 4), &[smooth((60, 1, 4))]);
    let few = |at_most| KernelRidgeConfig {
        at_most,
        ..KernelRidgeConfig::default()
    };
    let fit = |at_most: usize, plan: &Plan| {
        let ridge = KernelRidge::new(few(at_most)).unwrap();
        ridge.train(&set.data(), plan).unwrap()
    };
    let plan = set.plan(0..50, &[0]);
    let found = fit(12, &plan);
    let drawn = drawn(&set, &found);
    assert_eq!((drawn.len(), drawn.iter().all(|&s| s < 50)), (12, true));
    let mut thinned = plan.clone();
    thinned.reruns[0].training = drawn.iter().copied().collect();
    assert_eq!(found, fit(4000, &thinned));
    assert_eq!(fit(50, &plan), fit(4000, &plan));

    let mut turned = plan.clone();
    turned.reruns[0].training.reverse();
    assert_eq!(found, fit(12, &turned));
    let mut other = plan;
    other.reruns[0].number = 1;
    other.trials[0].rerun = 1;
    assert_ne!(drawn, self::drawn(&set, &fit(12, &other)));

    let error = KernelRidge::new(few(0)).unwrap_err().to_string();
    assert!(error.contains("at least 1"), "{error}");
}

/// The surfaces that a regression keeps.
fn drawn(set: &Set, trained: &TrainedKernelRidges) -> BTreeSet<usize> {
    let bytes = trained.to_bytes().unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let kept = file.tensor("0/embeddings").unwrap();
    let first = |s: &usize| set.embeddings.get(*s, 0).unwrap()[0].to_le_bytes();
    let surface = |row: &[u8]| (0..60).find(|s| row.starts_with(&first(s))).unwrap();
    kept.data().chunks(16).map(surface).collect()
}
