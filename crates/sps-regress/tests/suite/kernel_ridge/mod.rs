mod design;
mod hard_cases;
mod set_losses;
mod stacked_targets;

use ndarray::{Array1, Array2, Axis};
use sps_regress::kernel_ridge::{
    Kernel, KernelRidge, KernelRidgeConfig, SetLosses, Shape, TrainedKernelRidges,
};
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::{
    Embeddings, FittedRegressor, Plan, Result, TrainingData, Trial, Views, fitted_from_bytes,
};

use crate::golden::uniform;
use crate::support::{Set, solved};

impl Set {
    fn new(shape: (usize, usize, usize), columns: &[Vec<Option<f64>>]) -> Self {
        let values = uniform("kernel.x", shape.0 * shape.1 * shape.2);
        let values: Vec<f32> = values.into_iter().map(|x| x as f32).collect();
        Self::of(Embeddings::new(values, shape.into()).unwrap(), columns)
    }

    /// The first `training` surfaces, and some of the views.
    fn train(
        &self,
        config: &KernelRidgeConfig,
        training: usize,
        views: &[usize],
    ) -> Result<TrainedKernelRidges> {
        let plan = self.plan(0..training, views);
        KernelRidge::new(config.clone())?.train(&self.data(), &plan)
    }

    /// Of a set of views, for the first surfaces.
    fn losses(
        &self,
        data: &TrainingData<'_>,
        training: usize,
        config: &KernelRidgeConfig,
        views: &[usize],
    ) -> Vec<f64> {
        let training: Vec<usize> = (0..training).collect();
        let losses = SetLosses::new(data, self.readings.properties(), &training, config);
        losses.unwrap().losses(views).unwrap()
    }
}

fn column(name: &str, surfaces: usize) -> Vec<Option<f64>> {
    let values = uniform(name, surfaces).into_iter();
    values.map(|value| Some(3.0 + value)).collect()
}

/// Values that a kernel can predict from view 0 of `Set::new`.
fn smooth(shape: (usize, usize, usize)) -> Vec<Option<f64>> {
    let features = uniform("kernel.x", shape.0 * shape.1 * shape.2);
    let rows = features.chunks(shape.1 * shape.2);
    rows.map(|x| Some(20.0 + (2.0 * x[0]).sin() + x[1] * x[2]))
        .collect()
}

fn config(kernel: Kernel, penalties: &[f64], widths: &[f64]) -> KernelRidgeConfig {
    let linear = kernel == Kernel::Linear;
    let widths = if linear { &widths[..1] } else { widths };
    let kernels = widths.iter().map(|&width| Shape::even(kernel, width));
    KernelRidgeConfig {
        penalties: penalties.to_vec(),
        kernels: kernels.collect(),
        ..KernelRidgeConfig::default()
    }
}

fn variance(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64
}

fn close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < tolerance, "{found} {expected}");
    }
}

/// A kernel matrix, written down element by element: the mean over the views, each with the median
/// distance of its training surfaces.
fn matrix(set: &Set, kernel: Kernel, width: f64, training: usize, views: &[usize]) -> Array2<f64> {
    let surfaces = set.embeddings.surfaces();
    let mut sum = Array2::zeros((surfaces, surfaces));
    for &view in views {
        let at = |s: usize| set.embeddings.get(s, view).unwrap();
        let distance = |a: usize, b: usize| -> f64 {
            let pairs = at(a).iter().zip(at(b));
            let squares = pairs.map(|(a, b)| f64::from(a - b).powi(2));
            squares.sum::<f64>().sqrt()
        };
        let pairs = (0..training).flat_map(|a| (0..a).map(move |b| (a, b)));
        let mut all: Vec<f64> = pairs.map(|(a, b)| distance(a, b)).collect();
        all.sort_by(f64::total_cmp);
        let scale = 0.5 * (all[(all.len() - 1) / 2] + all[all.len() / 2]);
        sum += &Array2::from_shape_fn((surfaces, surfaces), |(a, b)| {
            let d = distance(a, b) / (width * scale);
            match kernel {
                Kernel::Exponential => (-d).exp(),
                Kernel::Gaussian => (-0.5 * d * d).exp(),
                Kernel::Linear => panic!("ridge regression stands for it"),
            }
        });
    }
    sum / views.len() as f64
}

/// Coefficients and intercept by the whole system of the centred problem: `(K + rI) c + b = y`,
/// and the coefficients sum to none.
fn direct(kernel: &Array2<f64>, values: &[f64], ridge: f64) -> (Array1<f64>, f64) {
    let n = values.len();
    let system = Array2::from_shape_fn((n + 1, n + 2), |(i, j)| match (i == n, j) {
        (true, j) if j >= n => 0.0,
        (false, j) if j < n => kernel[[i, j]] + if i == j { ridge } else { 0.0 },
        (false, j) if j > n => values[i],
        _ => 1.0,
    });
    let solution = solved(system);
    (solution[..n].to_vec().into(), solution[n])
}

/// The penalty's unit: `n` times the mean diagonal element of the centred kernel.
fn trace(kernel: &Array2<f64>) -> f64 {
    kernel.diag().sum() - kernel.sum() / kernel.nrows() as f64
}

fn part(kernel: &Array2<f64>, rows: &[usize], columns: &[usize]) -> Array2<f64> {
    kernel.select(Axis(0), rows).select(Axis(1), columns)
}

/// What is read from the bytes of fitted regressions, which gives the same bytes.
fn stored(fitted: &dyn FittedRegressor) -> Box<dyn FittedRegressor> {
    let bytes = fitted.to_bytes().unwrap();
    let read = fitted_from_bytes("kernel-ridges", "file", &bytes, &[]).unwrap();
    assert!(read.to_bytes().unwrap() == bytes);
    read
}

/// Of the first property.
fn estimates(fitted: &dyn FittedRegressor, embeddings: &Embeddings) -> Vec<f64> {
    fitted.predict(embeddings).unwrap().remove(0).values
}

#[test]
fn the_fit_solves_the_normal_equations() {
    let shape = (34, 3, 5);
    let set = Set::new(shape, &[smooth(shape)]);
    let values: Vec<f64> = smooth(shape).into_iter().flatten().take(30).collect();
    let training: Vec<usize> = (0..30).collect();
    let all: Vec<usize> = (0..34).collect();
    for kernel in [Kernel::Exponential, Kernel::Gaussian] {
        for views in [&[0][..], &[2, 0], &[0, 1, 1]] {
            let whole = matrix(&set, kernel, 1.5, 30, views);
            let config = config(kernel, &[0.02], &[1.5]);
            let trained = set.train(&config, 30, views).unwrap();
            let found = estimates(&trained, &set.embeddings.select(&all, views).unwrap());
            assert_eq!(trained.models()[0].penalty(), Some(0.02));
            let among = part(&whole, &training, &training);
            let (coefficients, intercept) = direct(&among, &values, 0.02 * trace(&among));
            let expected = part(&whole, &all, &training).dot(&coefficients) + intercept;
            close(&found, expected.as_slice().unwrap(), 1e-7);
        }
    }
}

/// `reference.py`:
///
/// ```text
/// # scikit-learn 1.9.1; `uniform` is the rule of `fixtures/golden/rule.rs`
/// x = uniform("kernel.x", 25 * 4).astype(np.float32).astype(float).reshape(25, 4)
/// y = 20 + np.sin(2 * x[:, 0]) + x[:, 1] * x[:, 2]
/// train, test = x[:20], x[20:]
/// distances = lambda a, b: np.sqrt(((a[:, None] - b[None]) ** 2).sum(2))
/// d = distances(train, train)
/// scale = np.median(d[np.triu_indices(20, 1)])
/// for k in [lambda d: np.exp(-d / (2 * scale)), lambda d: np.exp(-0.5 * (d / (2 * scale)) ** 2)]:
///     K, T = k(d), k(distances(test, train))
///     H = np.eye(20) - 1 / 20
///     Kc = H @ K @ H
///     Tc = (T - K.mean(0)) @ H
///     m = KernelRidge(alpha=0.1 * np.trace(Kc), kernel="precomputed")
///     m.fit(Kc, y[:20] - y[:20].mean())
///     print((m.predict(Tc) + y[:20].mean()).tolist())
/// ```
#[test]
fn predictions_are_scikit_learns() {
    let shape = (25, 1, 4);
    let set = Set::new(shape, &[smooth(shape)]);
    let held_out = set.embeddings.select(&[20, 21, 22, 23, 24], &[0]).unwrap();
    let exponential = [
        20.533_032_070_897_722,
        19.872_959_401_119_513,
        19.733_645_829_893_998,
        19.769_507_918_252_373,
        20.072_847_117_820_505,
    ];
    let gaussian = [
        20.836_527_317_142_185,
        19.905_711_582_275_043,
        20.022_505_369_252_286,
        19.792_923_902_602_244,
        20.102_707_426_277_49,
    ];
    for (kernel, expected) in [
        (Kernel::Exponential, exponential),
        (Kernel::Gaussian, gaussian),
    ] {
        let trained = set.train(&config(kernel, &[0.1], &[2.0]), 20, &[0]);
        close(&estimates(&trained.unwrap(), &held_out), &expected, 1e-12);
    }
}

/// Blocks of one view count as views do: each with a scale of its own, whatever they are measured in.
#[test]
fn the_kernel_of_a_view_is_the_mean_of_its_blocks() {
    let set = Set::new((30, 4, 3), &[smooth((30, 4, 3))]);
    let values = |factors: [f32; 2]| -> Vec<f32> {
        let rows = (0..30).flat_map(|s| (0..4).map(move |view| (s, view)));
        let scaled = rows.flat_map(|(s, view)| {
            let row = set.embeddings.get(s, view).unwrap();
            row.iter().map(move |x| x * factors[view % 2])
        });
        scaled.collect()
    };
    let train = |embeddings: Embeddings, views: &[usize]| {
        let readings = set.readings.clone();
        let set = Set {
            embeddings,
            readings,
        };
        let config = config(Kernel::Exponential, &[0.01, 0.1], &[1.0, 4.0]);
        let trained = set.train(&config, 20, views).unwrap();
        let losses = set.losses(&set.data(), 20, &config, views);
        let all: Vec<usize> = (0..30).collect();
        let seen = set.embeddings.select(&all, views).unwrap();
        let found = estimates(&trained, &seen);
        assert_eq!(estimates(stored(&trained).as_ref(), &seen), found);
        (found, losses)
    };
    let embeddings = |factors, shape| Embeddings::new(values(factors), shape).unwrap();
    let views = embeddings([1.0; 2], [30, 4, 3]);
    let (expected, expected_losses) = train(views, &[0, 1, 2, 3]);
    // Powers of two change no bit.
    let blocks = embeddings([4.0, 0.25], [30, 2, 6]);
    let (found, losses) = train(blocks.clone().in_blocks(&[3, 3]).unwrap(), &[0, 1]);
    close(&found, &expected, 1e-9);
    close(&losses, &expected_losses, 1e-6);
    let (as_one, _) = train(blocks.clone(), &[0, 1]);
    let mut pairs = as_one.iter().zip(&expected);
    assert!(pairs.any(|(a, b)| (a - b).abs() > 1e-3));
    for wrong in [&[6, 0][..], &[3, 4], &[]] {
        let error = blocks.clone().in_blocks(wrong).unwrap_err().to_string();
        assert!(error.contains("6 together"), "{error}");
    }
}

/// Blocks that lean: the last of two counts e² times the first.
#[test]
fn later_blocks_count_more_where_a_kernel_leans() {
    let shape = (30, 2, 4);
    let set = Set::new(shape, &[smooth(shape)]);
    let values: Vec<f64> = smooth(shape).into_iter().flatten().take(20).collect();
    let training: Vec<usize> = (0..20).collect();
    let weights = [1.0, 2.0_f64.exp()].map(|weight| weight / (1.0 + 2.0_f64.exp()));
    let kernels = [0, 1].map(|view| matrix(&set, Kernel::Exponential, 1.5, 20, &[view]));
    let kernel = &kernels[0] * weights[0] + &kernels[1] * weights[1];
    let of_training = part(&kernel, &training, &training);
    let (coefficients, intercept) = direct(&of_training, &values, 0.02 * trace(&of_training));
    let new: Vec<usize> = (20..30).collect();
    let expected = part(&kernel, &new, &training).dot(&coefficients) + intercept;

    let one = Embeddings::new(set.embeddings.values().to_vec(), [30, 1, 8]).unwrap();
    let embeddings = one.in_blocks(&[4, 4]).unwrap();
    let set = Set { embeddings, ..set };
    let mut config = config(Kernel::Exponential, &[0.02], &[1.5]);
    config.kernels[0].leaning = 2.0;
    let trained = set.train(&config, 20, &[0]).unwrap();
    let ridge = &trained.models()[0];
    let chosen = (ridge.shape(), ridge.penalty());
    assert_eq!(chosen, (Some(config.kernels[0]), Some(0.02)));
    let found = estimates(&trained, &set.embeddings.select(&new, &[0]).unwrap());
    close(&found, &expected.to_vec(), 1e-9);

    config.kernels[0].leaning = f64::NAN;
    assert!(KernelRidge::new(config.clone()).is_err());
    let mixed = [Kernel::Linear, Kernel::Gaussian].map(|kernel| Shape::even(kernel, 1.0));
    config.kernels = mixed.to_vec();
    assert!(KernelRidge::new(config).is_err());
}

/// Surfaces one by one, and in units of 1 to 7 of them.
#[test]
fn the_choice_is_the_best_when_each_unit_is_left_out() {
    let shape = (25, 2, 4);
    let penalties = [1e-4, 0.01, 1.0];
    let set = Set::new(shape, &[smooth(shape)]);
    let values: Vec<f64> = smooth(shape).into_iter().flatten().collect();
    let mut config = config(Kernel::Exponential, &penalties, &[0.5, 2.0]);
    config.kernels.push(Shape::even(Kernel::Gaussian, 1.5));
    let uneven = |i: usize| (f64::from(i as u32) * 2.0 + 0.25).sqrt() as usize;
    for units in [(0..25).collect(), (0..25).map(uneven).collect::<Vec<_>>()] {
        let data = set.data().with_units(&units);
        let ridge = KernelRidge::new(config.clone()).unwrap();
        let trained = ridge.train(&data, &set.plan(0..25, &[0, 1])).unwrap();
        let mut errors = Vec::new();
        for &shape in &config.kernels {
            let kernel = matrix(&set, shape.kernel, shape.width, 25, &[0, 1]);
            for penalty in penalties {
                let ridge = penalty * trace(&kernel);
                let squared = (0..25).map(|out| {
                    let others = (0..25).filter(|&s| units[s] != units[out]);
                    let others: Vec<usize> = others.collect();
                    let kept: Vec<f64> = others.iter().map(|&s| values[s]).collect();
                    let (c, intercept) = direct(&part(&kernel, &others, &others), &kept, ridge);
                    let estimate = part(&kernel, &[out], &others).dot(&c)[0] + intercept;
                    (values[out] - estimate).powi(2)
                });
                errors.push((squared.sum::<f64>() / 25.0, shape, penalty));
            }
        }
        let best = errors.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let (error, shape, penalty) = best.unwrap();
        let ridge = &trained.models()[0];
        let found = (ridge.shape(), ridge.penalty());
        assert_eq!(found, (Some(shape), Some(penalty)));
        assert!((ridge.left_out_error().unwrap() / error - 1.0).abs() < 1e-9);
        let loss = set.losses(&data, 25, &config, &[0, 1])[0];
        assert!((loss * variance(&values) / error - 1.0).abs() < 1e-4);
    }
}

#[test]
fn what_cannot_be_predicted_gets_the_mean() {
    let set = Set::new((40, 1, 6), &[column("kernel.noise", 40)]);
    let penalties = KernelRidgeConfig::default().penalties;
    let config = config(Kernel::Exponential, &penalties, &[1.0]);
    let trained = set.train(&config, 30, &[0]).unwrap();
    let values: Vec<f64> = column("kernel.noise", 30).into_iter().flatten().collect();
    let mean = values.iter().sum::<f64>() / 30.0;
    let ridge = &trained.models()[0];
    assert_eq!((ridge.shape(), ridge.penalty()), (None, None));
    close(&estimates(&trained, &set.embeddings), &[mean; 40], 1e-12);
    // The mean of all others.
    let of_others = |v: &f64| (mean * 30.0 - v) / 29.0;
    let errors = values.iter().map(|v| (v - of_others(v)).powi(2));
    let error = errors.sum::<f64>() / 30.0;
    assert!((ridge.left_out_error().unwrap() / error - 1.0).abs() < 1e-12);
}

#[test]
fn the_linear_kernel_is_ridge_regression() {
    let shape = (40, 2, 5);
    let set = Set::new(shape, &[smooth(shape)]);
    let plan = set.plan(0..30, &[0, 1]);
    let penalty = 0.03;
    let ridge = Ridge::new(RidgeConfig {
        penalties: vec![penalty],
    });
    let ridge = ridge.unwrap().train(&set.data(), &plan).unwrap();
    // Ridge regression's penalty is one of a feature's variance with `n - 1` below it.
    let penalty = penalty / 10.0 * 30.0 / 29.0;
    let config = config(Kernel::Linear, &[penalty], &[1.0]);
    let trained = set.train(&config, 30, &[0, 1]).unwrap();
    assert_eq!(trained.models()[0].penalty(), Some(penalty));
    let expected = estimates(&ridge, &set.embeddings);
    close(&estimates(&trained, &set.embeddings), &expected, 1e-9);
}

/// A trial has the bits that it would have alone, on any number of threads.
#[test]
fn company_and_threads_change_nothing() {
    let shape = (60, 2, 7);
    let mut gaps = smooth(shape);
    gaps[3] = None;
    let columns = [smooth(shape), column("kernel.y", 60), gaps, smooth(shape)];
    let set = Set::new(shape, &columns);
    let on = |threads: usize, keep: &dyn Fn(&Trial) -> bool| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let mut plan = set.plan(0..50, &[1, 0]);
        plan.trials.retain(keep);
        let ridge = KernelRidge::default();
        pool.unwrap().install(|| {
            let trained = ridge.train(&set.data(), &plan).unwrap();
            let estimates = trained.predict(&set.embeddings).unwrap();
            (trained, estimates)
        })
    };
    let (all, estimates) = on(3, &|_| true);
    let (one, same) = on(1, &|_| true);
    assert_eq!((&all, &estimates), (&one, &same));
    for (at, trial) in all.trials().into_iter().enumerate() {
        let (alone, estimate) = on(2, &|other| other == trial);
        assert_eq!(alone.models(), &all.models()[at..=at]);
        assert_eq!(estimate, estimates[at..=at]);
        let kept = all.filtered(&|other| other == trial);
        assert_eq!(kept.predict(&set.embeddings).unwrap(), estimate);
    }
}
