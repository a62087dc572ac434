use sps_regress::Error;

use super::*;

/// The order of a set does not matter, and its views may repeat.
#[test]
fn losses_are_those_of_the_fitted_regressions() {
    let shape = (40, 4, 3);
    let mut gaps = smooth(shape);
    gaps[..5].fill(None);
    let columns = [smooth(shape), column("kernel.noise", 40), gaps];
    let set = Set::new(shape, &columns);
    let training: Vec<usize> = (0..30).rev().collect();
    for kernel in [Kernel::Exponential, Kernel::Gaussian, Kernel::Linear] {
        let config = config(kernel, &[1e-3, 0.03, 1.0], &[0.7, 3.0]);
        let properties = set.readings.properties();
        let losses = SetLosses::new(&set.data(), properties, &training, &config).unwrap();
        for views in [&[2][..], &[3, 0], &[1, 0, 1], &[0, 1, 2, 3]] {
            let trained = set.train(&config, 30, views).unwrap();
            let found = losses.losses(views).unwrap();
            for ((found, ridge), column) in found.iter().zip(trained.models()).zip(&columns) {
                let values: Vec<f64> = column[..30].iter().flatten().copied().collect();
                let expected = ridge.left_out_error().unwrap() / variance(&values);
                assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}");
            }
            let turned: Vec<usize> = views.iter().rev().copied().collect();
            assert_eq!(losses.losses(&turned).unwrap(), found);
        }
    }
}

#[test]
fn hard_cases() {
    let columns = [
        vec![Some(0.5); 6],
        vec![None, None, Some(1.0), None, None, None],
    ];
    let set = Set::new((6, 2, 3), &columns);
    let data = set.data();
    let config = KernelRidgeConfig::default();
    let both = set.readings.properties();
    let losses = SetLosses::new(&data, both, &[0, 1, 2], &config).unwrap();
    // Constant readings, and one alone.
    assert_eq!(losses.losses(&[0]).unwrap(), [0.0, 0.0]);
    for wrong in [&[][..], &[2], &[0, 9]] {
        assert!(matches!(losses.losses(wrong), Err(Error::Input(_))));
    }
    let unknown = ["none".to_owned()];
    for (properties, training) in [
        (both, &[0, 1][..]),
        (both, &[0, 2, 2]),
        (both, &[2, 6]),
        (both, &[]),
        (&unknown, &[2]),
    ] {
        let refused = SetLosses::new(&data, properties, training, &config);
        assert!(matches!(refused, Err(Error::Input(_))));
    }
}
