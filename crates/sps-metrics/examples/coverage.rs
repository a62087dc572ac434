//! How often intervals at 95 % hold the true value, where units and reruns are both drawn at random:
//! those of this crate, and of a bootstrap of units alone and of units and reruns ("The pigeonhole
//! bootstrap", Owen, Annals of Applied Statistics 1, 2007).
//!
//! `cargo run --release -p sps-metrics --example coverage`

use sps_metrics::{IntervalError, Intervals, Level, Metric, Samples, Scored, TrainingMean};

/// Simulated experiments of each row.
const TRIALS: usize = 2000;

/// Resamples of a bootstrap; none for so many units, where it takes too long.
const RESAMPLES: usize = 200;
const MOST_RESAMPLED: usize = 200;

fn main() -> Result<(), IntervalError> {
    println!("R² about the training mean; 95 % intervals, % of {TRIALS} that hold the true value");
    println!("tails   units  reruns  by reruns  this crate  models alone  bootstrap  pigeonhole");
    for heavy in [false, true] {
        for units in [8, 20, 200, 2000] {
            for reruns in [3, 5, 10] {
                for by_rerun in [0.0, 0.1] {
                    crossed(&Design {
                        heavy,
                        units,
                        reruns,
                        by_rerun,
                    })?;
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

/// Estimates 0.6 t + a + b + c of truths t: a of the unit, b of the rerun, c of both.
struct Design {
    heavy: bool,
    units: usize,
    reruns: usize,
    by_rerun: f64,
}

const BY_UNIT: f64 = 0.4;
const BY_BOTH: f64 = 0.2;

impl Design {
    /// Of variance 1: normal, or Student's t of five degrees of freedom.
    fn number(&self, random: &mut Random) -> f64 {
        if !self.heavy {
            return random.normal();
        }
        let squares: f64 = (0..5).map(|_| random.normal().powi(2)).sum();
        random.normal() / (squares / 5.0).sqrt() * 0.6_f64.sqrt()
    }

    fn truth(&self) -> f64 {
        let errors = 0.16 + BY_UNIT.powi(2) + self.by_rerun.powi(2) + BY_BOTH.powi(2);
        1.0 - errors
    }

    /// Truths, and estimates of each rerun.
    fn draw(&self, random: &mut Random) -> (Vec<f64>, Vec<Vec<f64>>) {
        let truth: Vec<f64> = (0..self.units).map(|_| self.number(random)).collect();
        let own = truth
            .iter()
            .map(|truth| 0.6 * truth + BY_UNIT * self.number(random));
        let own: Vec<f64> = own.collect();
        let mut rerun = |_| {
            let rerun = self.by_rerun * random.normal();
            let both = own
                .iter()
                .map(|own| own + rerun + BY_BOTH * self.number(random));
            both.collect()
        };
        let estimates = (0..self.reruns).map(&mut rerun).collect();
        (truth, estimates)
    }
}

fn crossed(design: &Design) -> Result<(), IntervalError> {
    let mut random = Random(1);
    let mut held = [0; 4];
    let known = design.truth();
    let resampled = design.units <= MOST_RESAMPLED;
    for _ in 0..TRIALS {
        let (truth, estimates) = design.draw(&mut random);
        let means = vec![0.0; design.reruns];
        let scored = scored(&truth, &estimates, &means);
        let mut ends = vec![
            ends(Intervals::of_training(Level::P95), &scored)?,
            ends(Intervals::of_models(Level::P95), &scored)?,
        ];
        if resampled {
            ends.extend(bootstraps(&truth, &estimates, &mut random));
        }
        for (held, [low, high]) in held.iter_mut().zip(ends) {
            *held += usize::from(low <= known && known <= high);
        }
    }
    let share = |at: usize| {
        let drawn = at < 2 || resampled;
        if drawn {
            percent(held[at])
        } else {
            "–".into()
        }
    };
    let [here, alone, by_units, by_both] = [0, 1, 2, 3].map(share);
    let Design {
        heavy,
        units,
        reruns,
        by_rerun,
    } = design;
    let tails = if *heavy { "heavy" } else { "normal" };
    print!("{tails:6}  {units:5}  {reruns:6}  {by_rerun:9}  ");
    println!("{here:>10}  {alone:>12}  {by_units:>9}  {by_both:>10}");
    Ok(())
}

fn percent(held: usize) -> String {
    format!("{:.1}", 100.0 * held as f64 / TRIALS as f64)
}

fn ends(intervals: Intervals, scored: &[Scored<'_>]) -> Result<[f64; 2], IntervalError> {
    let found = intervals.interval(scored)?;
    Ok([found.low, found.high])
}

/// R² of each rerun about a mean of its own.
fn scored<'a>(truth: &'a [f64], estimates: &'a [Vec<f64>], means: &[f64]) -> Vec<Scored<'a>> {
    let reruns = estimates.iter().zip(means).enumerate();
    let scored = reruns.filter_map(|(rerun, (estimate, mean))| {
        Some(Scored {
            metric: Metric::R2(TrainingMean::new(*mean).ok()?),
            samples: Samples { truth, estimate },
            units: None,
            rerun,
        })
    });
    scored.collect()
}

/// Percentile intervals over units, and over units and reruns.
fn bootstraps(truth: &[f64], estimates: &[Vec<f64>], random: &mut Random) -> [[f64; 2]; 2] {
    let (mut units, mut both) = (Vec::new(), Vec::new());
    for _ in 0..RESAMPLES {
        let drawn: Vec<usize> = truth.iter().map(|_| random.below(truth.len())).collect();
        let squares: f64 = drawn.iter().map(|&at| truth[at].powi(2)).sum();
        let r2 = |estimate: &Vec<f64>| {
            let errors = drawn.iter().map(|&at| (truth[at] - estimate[at]).powi(2));
            1.0 - errors.sum::<f64>() / squares
        };
        let scores: Vec<f64> = estimates.iter().map(r2).collect();
        let count = scores.len() as f64;
        units.push(scores.iter().sum::<f64>() / count);
        let reruns = scores.iter().map(|_| scores[random.below(scores.len())]);
        both.push(reruns.sum::<f64>() / count);
    }
    [units, both].map(|mut scores| {
        scores.sort_by(f64::total_cmp);
        let tail = RESAMPLES / 40;
        [scores[tail - 1], scores[RESAMPLES - tail]]
    })
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
                let held_out = |place: usize| place % FOLDS == fold;
                let (test, training): (Vec<usize>, Vec<usize>) =
                    (0..units).partition(|&place| held_out(place));
                let training: Vec<usize> = training.iter().map(|&place| order[place]).collect();
                let weights = ridge(&rows, &truth, &training);
                known += true_r2(&weights);
                for place in test {
                    let at = order[place];
                    estimate[at] = rows[at].iter().zip(&weights).map(|(x, w)| x * w).sum();
                }
            }
        }
        let means = vec![0.0; reruns];
        let scored = scored(&truth, &estimates, &means);
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

/// By conjugate gradients, which end after as many steps as there are weights.
fn ridge(rows: &[[f64; FEATURES]], truth: &[f64], training: &[usize]) -> [f64; FEATURES] {
    let add = |sums: &mut [f64; FEATURES], factor: f64, row: &[f64; FEATURES]| {
        for (sum, x) in sums.iter_mut().zip(row) {
            *sum += factor * x;
        }
    };
    let product = |weights: &[f64; FEATURES]| {
        let mut sums = weights.map(|weight| PENALTY * weight);
        for &at in training {
            let value: f64 = rows[at].iter().zip(weights).map(|(x, w)| x * w).sum();
            add(&mut sums, value, &rows[at]);
        }
        sums
    };
    let dot = |a: &[f64; FEATURES], b: &[f64; FEATURES]| -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    };
    let (mut weights, mut rest) = ([0.0; FEATURES], [0.0; FEATURES]);
    for &at in training {
        add(&mut rest, truth[at], &rows[at]);
    }
    let mut direction = rest;
    for _ in 0..FEATURES {
        let image = product(&direction);
        let before = dot(&rest, &rest);
        let step = before / dot(&direction, &image).max(f64::MIN_POSITIVE);
        for at in 0..FEATURES {
            weights[at] += step * direction[at];
            rest[at] -= step * image[at];
        }
        let turn = dot(&rest, &rest) / before.max(f64::MIN_POSITIVE);
        direction = std::array::from_fn(|at| rest[at] + turn * direction[at]);
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

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }

    /// By Box and Muller.
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    fn order(&mut self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for at in (1..count).rev() {
            order.swap(at, self.below(at + 1));
        }
        order
    }
}
