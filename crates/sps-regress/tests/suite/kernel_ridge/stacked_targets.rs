//! A second fit, to what first ones estimate of all properties.

use super::*;

const TRAINING: usize = 20;

const SHAPE: (usize, usize, usize) = (26, 2, 4);

/// Another property that a kernel can predict from view 0.
fn other() -> Vec<Option<f64>> {
    let features = uniform("kernel.x", 26 * 2 * 4);
    let rows = features.chunks(2 * 4);
    rows.map(|x| Some(5.0 + 9.0 * x[1] - 4.0 * x[0] * x[0]))
        .collect()
}

fn config() -> KernelRidgeConfig {
    KernelRidgeConfig {
        stacked_targets: true,
        ..super::config(Kernel::Exponential, &[0.02], &[1.5])
    }
}

fn values(set: &Set, property: usize) -> Vec<f64> {
    let value = |surface| set.readings.get(surface, property).unwrap();
    (0..TRAINING).map(value).collect()
}

/// Estimates of the first property, written down refit by refit; units are left out together.
fn directly(set: &Set, units: &[usize], views: &[usize], fitted: [bool; 2]) -> Vec<f64> {
    let training: Vec<usize> = (0..TRAINING).collect();
    let all: Vec<usize> = (0..26).collect();
    let kernel = matrix(set, Kernel::Exponential, 1.5, TRAINING, views);
    let ridge = 0.02 * trace(&part(&kernel, &training, &training));
    let mut of_all: Vec<Vec<f64>> = Vec::new();
    for property in 0..2 {
        let values = values(set, property);
        let by = |fitted: &[usize], of: usize| {
            let kept: Vec<f64> = fitted.iter().map(|&s| values[s]).collect();
            let (c, intercept) = direct(&part(&kernel, fitted, fitted), &kept, ridge);
            part(&kernel, &[of], fitted).dot(&c)[0] + intercept
        };
        let level = values.iter().sum::<f64>() / values.len() as f64;
        let estimate = |surface: usize| {
            if !fitted[property] {
                return level;
            }
            let apart = |s: usize| surface >= TRAINING || units[s] != units[surface];
            let others = training.iter().copied().filter(|&s| apart(s));
            by(&others.collect::<Vec<_>>(), surface)
        };
        let unit = variance(&values).sqrt();
        let unit = if unit > 0.0 { unit } else { 1.0 };
        of_all.push(all.iter().map(|&s| estimate(s) / unit).collect());
    }
    let distance = |a: usize, b: usize| {
        let squares = of_all.iter().map(|of| (of[a] - of[b]).powi(2));
        squares.sum::<f64>().sqrt()
    };
    let pairs = (0..TRAINING).flat_map(|a| (0..a).map(move |b| (a, b)));
    let mut distances: Vec<f64> = pairs.map(|(a, b)| distance(a, b)).collect();
    distances.sort_by(f64::total_cmp);
    let middle = distances.len() / 2;
    let scale = 0.5 * (distances[middle - 1] + distances[middle]);
    let own = Array2::from_shape_fn((26, 26), |(a, b)| (-distance(a, b) / (1.5 * scale)).exp());
    let kernel = kernel + own;
    let among = part(&kernel, &training, &training);
    let (c, intercept) = direct(&among, &values(set, 0), 0.02 * trace(&among));
    (part(&kernel, &all, &training).dot(&c) + intercept).to_vec()
}

#[test]
fn estimates_are_those_of_two_stages() {
    let set = Set::new(SHAPE, &[smooth(SHAPE), other()]);
    let new: Vec<usize> = (TRAINING..26).collect();
    for units in [
        (0..26).collect::<Vec<_>>(),
        (0..26).map(|i| i / 3).collect(),
    ] {
        for views in [&[0][..], &[1, 0]] {
            let plan = set.plan(0..TRAINING, views);
            let data = set.data().with_units(&units);
            let trained = KernelRidge::new(config()).unwrap();
            let trained = trained.train(&data, &plan).unwrap();
            let seen = set.embeddings.select(&new, views).unwrap();
            let found = estimates(&trained, &seen);
            let expected = directly(&set, &units, views, [true; 2]);
            close(&found, &expected[TRAINING..], 1e-9);
            assert_eq!(estimates(stored(&trained).as_ref(), &seen), found);
            // Alone it still has the first fits to both, whether it is kept alone or fitted alone.
            let alone = trained.filtered(&|trial| trial.property == "p0");
            assert_eq!(estimates(alone.as_ref(), &seen), found);
            assert_eq!(estimates(stored(alone.as_ref()).as_ref(), &seen), found);
            let mut plan = set.plan(0..TRAINING, views);
            plan.trials.retain(|trial| trial.property == "p0");
            let alone = KernelRidge::new(config()).unwrap();
            let alone = alone.train(&data, &plan).unwrap();
            assert_eq!(estimates(&alone, &seen), found);
        }
    }
}

#[test]
fn hard_cases() {
    let train = |columns: &[Vec<Option<f64>>], config: &KernelRidgeConfig| {
        let set = Set::new(SHAPE, columns);
        let trained = set.train(config, TRAINING, &[0]).unwrap();
        let seen = set.embeddings.select(&[21, 25], &[0]).unwrap();
        let found = estimates(&trained, &seen);
        assert_eq!(estimates(stored(&trained).as_ref(), &seen), found);
        found
    };
    let one_stage = KernelRidgeConfig {
        stacked_targets: false,
        ..config()
    };
    // One property has no second fit.
    let alone = [smooth(SHAPE)];
    assert_eq!(train(&alone, &config()), train(&alone, &one_stage));
    // Readings that do not differ tell nothing.
    let constant = vec![Some(7.0); 26];
    let columns = [smooth(SHAPE), constant.clone()];
    let units: Vec<usize> = (0..26).collect();
    let expected = directly(&Set::new(SHAPE, &columns), &units, &[0], [true, false]);
    let found = train(&columns, &config());
    close(&found, &[expected[21], expected[25]], 1e-9);
    assert_eq!(train(&[constant.clone(), constant], &config()), [7.0, 7.0]);
    // Nor does a property that was not read of all surfaces.
    let mut lacking = other();
    lacking[3] = None;
    let columns = [smooth(SHAPE), lacking];
    assert_eq!(train(&columns, &config()), train(&columns, &one_stage));
    // Linear kernels are refused.
    let mut linear = config();
    linear.kernels = vec![Shape::even(Kernel::Linear, 1.0)];
    let error = KernelRidge::new(linear).unwrap_err().to_string();
    assert!(error.contains("stacked targets"), "{error}");
}
