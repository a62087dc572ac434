//! How often intervals at 95 % hold the true value, where units and reruns are both drawn at random.
//!
//! `cargo run --release -p sps-metrics --example coverage`

use sps_metrics::{IntervalError, Intervals, Level, Metric, Samples, Scored, TrainingMean};

/// Simulated experiments of each row.
const TRIALS: usize = 2000;

fn main() -> Result<(), IntervalError> {
    println!("R² about the training mean; 95 % intervals, % of {TRIALS} that hold the true value");
    println!("tails   units  reruns  by reruns  this crate  models alone");
    for heavy in [false, true] {
        for units in [8, 20, 200, 2000] {
            for reruns in [3, 5, 10] {
                for by_rerun in [0.0, 0.1] {
                    crossed(heavy, [units, reruns], by_rerun)?;
                }
            }
        }
    }
    println!("\nTen folds of one set of surfaces, ridge regression on 20 numbers");
    println!("units  reruns  this crate  without shared training  models alone");
    for units in [40, 60, 200] {
        for reruns in [3, 10] {
            folds(units, reruns)?;
        }
    }
    Ok(())
}

const BY_UNIT: f64 = 0.4;
const BY_BOTH: f64 = 0.2;

/// Estimates 0.6 t + a + b + c of truths t: a of the unit, b of the rerun, c of both; normal, or, but for b, with tails as
/// heavy as those of Student's t of five degrees of freedom.
fn crossed(heavy: bool, [units, reruns]: [usize; 2], by_rerun: f64) -> Result<(), IntervalError> {
    let mut random = Random(1);
    let mut held = [0; 2];
    let known = 0.84 - BY_UNIT.powi(2) - by_rerun * by_rerun - BY_BOTH.powi(2);
    for _ in 0..TRIALS {
        let truth: Vec<f64> = (0..units).map(|_| random.number(heavy)).collect();
        let own = truth.iter();
        let own = own.map(|truth| 0.6 * truth + BY_UNIT * random.number(heavy));
        let own: Vec<f64> = own.collect();
        let mut rerun = |_| {
            let rerun = by_rerun * random.normal();
            let both = own.iter();
            let both = both.map(|own| own + rerun + BY_BOTH * random.number(heavy));
            both.collect()
        };
        let estimates: Vec<Vec<f64>> = (0..reruns).map(&mut rerun).collect();
        let scored = scored(&truth, &estimates);
        let ends = [
            ends(Intervals::of_training(Level::P95), &scored)?,
            ends(Intervals::of_models(Level::P95), &scored)?,
        ];
        for (held, [low, high]) in held.iter_mut().zip(ends) {
            *held += usize::from(low <= known && known <= high);
        }
    }
    let [here, alone] = held.map(percent);
    let tails = if heavy { "heavy" } else { "normal" };
    println!("{tails:6}  {units:5}  {reruns:6}  {by_rerun:9}  {here:>10}  {alone:>12}");
    Ok(())
}

fn percent(held: usize) -> String {
    format!("{:.1}", 100.0 * held as f64 / TRIALS as f64)
}

fn ends(intervals: Intervals, scored: &[Scored<'_>]) -> Result<[f64; 2], IntervalError> {
    let found = intervals.interval(scored)?;
    Ok([found.low, found.high])
}

/// R² of each rerun about 0.
fn scored<'a>(truth: &'a [f64], estimates: &'a [Vec<f64>]) -> Vec<Scored<'a>> {
    let scored = |(rerun, estimate): (usize, &'a Vec<f64>)| {
        let metric = Metric::R2(TrainingMean::new(0.0).ok()?);
        Some(Scored {
            rerun,
            ..Scored::new(metric, Samples { truth, estimate })
        })
    };
    estimates.iter().enumerate().filter_map(scored).collect()
}

const FEATURES: usize = 20;
const FOLDS: usize = 10;
const PENALTY: f64 = 5.0;

/// Truths of one number in two of the features and noise; the true value is the mean R² of models
/// that are trained on nine tenths of so many surfaces.
fn folds(units: usize, reruns: usize) -> Result<(), IntervalError> {
    const TRIALS_OF_FOLDS: usize = TRIALS / 4;
    let mut random = Random(2);
    let (mut found, mut known) = (Vec::new(), 0.0);
    for _ in 0..TRIALS_OF_FOLDS {
        let mut row = |_| std::array::from_fn(|_| random.normal());
        let rows: Vec<[f64; FEATURES]> = (0..units).map(&mut row).collect();
        let truth = rows.iter().map(|row| row[0] + row[1] + random.normal());
        let truth: Vec<f64> = truth.collect();
        let mut estimates = vec![vec![0.0; units]; reruns];
        for estimate in &mut estimates {
            let order = random.order(units);
            for fold in 0..FOLDS {
                let held_out = |&(place, _): &(usize, usize)| place % FOLDS == fold;
                let places = order.iter().copied().enumerate();
                let (test, training): (Vec<_>, Vec<_>) = places.partition(held_out);
                let weights = ridge(&rows, &truth, &training);
                known += true_r2(&weights);
                for (_, at) in test {
                    estimate[at] = rows[at].iter().zip(&weights).map(|(x, w)| x * w).sum();
                }
            }
        }
        let scored = scored(&truth, &estimates);
        let share = 1.0 / (FOLDS - 1) as f64;
        found.push([
            ends(Intervals::of_training(Level::P95).sharing(share), &scored)?,
            ends(Intervals::of_training(Level::P95), &scored)?,
            ends(Intervals::of_models(Level::P95), &scored)?,
        ]);
    }
    known /= (TRIALS_OF_FOLDS * reruns * FOLDS) as f64;
    let [here, unshared, alone] = [0, 1, 2].map(|at: usize| {
        let holds = |ends: &&[[f64; 2]; 3]| ends[at][0] <= known && known <= ends[at][1];
        let held = found.iter().filter(holds).count();
        percent(held * TRIALS / TRIALS_OF_FOLDS)
    });
    println!("{units:5}  {reruns:6}  {here:>10}  {unshared:>23}  {alone:>12}");
    Ok(())
}

/// Of truths of variance 3, on any surfaces.
fn true_r2(weights: &[f64; FEATURES]) -> f64 {
    let wanted = |at: usize| if at < 2 { 1.0 } else { 0.0 };
    let weights = weights.iter().enumerate();
    let off = weights.map(|(at, weight)| (weight - wanted(at)).powi(2));
    1.0 - (off.sum::<f64>() + 1.0) / 3.0
}

/// By coordinate descent, to a few digits.
fn ridge(rows: &[[f64; FEATURES]], truth: &[f64], training: &[(usize, usize)]) -> [f64; FEATURES] {
    let mut weights = [0.0; FEATURES];
    let mut rest: Vec<f64> = training.iter().map(|&(_, at)| truth[at]).collect();
    for _ in 0..40 {
        for (feature, weight) in weights.iter_mut().enumerate() {
            let column = || training.iter().map(|&(_, at)| rows[at][feature]);
            let squares: f64 = column().map(|x| x * x).sum();
            let along: f64 = column().zip(&rest).map(|(x, rest)| x * rest).sum();
            let step = (along - PENALTY * *weight) / (squares + PENALTY);
            let left = rest.iter_mut().zip(column());
            left.for_each(|(rest, x)| *rest -= step * x);
            *weight += step;
        }
    }
    weights
}

/// SplitMix64 (Steele, Lea and Flood, 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// In (0, 1].
    fn uniform(&mut self) -> f64 {
        ((self.next() >> 11) + 1) as f64 / (1_u64 << 53) as f64
    }

    /// By Box and Muller.
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// Of variance 1: normal, or Student's t of five degrees of freedom.
    fn number(&mut self, heavy: bool) -> f64 {
        if !heavy {
            return self.normal();
        }
        let squares: f64 = (0..5).map(|_| self.normal().powi(2)).sum();
        self.normal() / (squares / 5.0).sqrt() * 0.6_f64.sqrt()
    }

    fn order(&mut self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for at in (1..count).rev() {
            order.swap(at, (self.next() % (at as u64 + 1)) as usize);
        }
        order
    }
}
