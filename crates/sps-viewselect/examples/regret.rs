//! How far every selector is from the true optimum, on frozen late-fusion estimators of random
//! smooth terms.
//!
//! `cargo run --release -p sps-viewselect --example regret [PICKS]`, 3 by default. Beyond 3 the
//! optimum is out of reach, and the best set that any selector found stands in for it.

#[path = "../tests/suite/problems.rs"]
#[allow(dead_code, reason = "the tests use the rest")]
mod problems;

use problems::LateFusion;
use sps_viewselect::{
    Equidistant, Exhaustive, Greedy, Nadir, Nvs, Problem, Random, SelectError, Selection, Selector,
    VbNvs,
};

const VIEWS: usize = 100;
const SURFACES: usize = 60;
const PROBLEMS: u64 = 5;
const SEEDS: u64 = 3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let picks = std::env::args()
        .nth(1)
        .map_or(Ok(3), |picks| picks.parse())?;
    let mut plain = Nvs::default();
    plain.policy = plain.policy.plain();
    let selectors: [(&str, Box<dyn Selector>); 8] = [
        ("random", Box::new(Random::default())),
        ("random, 20,000", Box::new(Random { draws: 20_000 })),
        ("nadir", Box::new(Nadir::default())),
        ("equidistant", Box::new(Equidistant::default())),
        ("nvs, plain", Box::new(plain)),
        ("nvs", Box::new(Nvs::default())),
        ("vb-nvs", Box::new(VbNvs::default())),
        ("greedy", Box::new(Greedy::default())),
    ];
    let mut rows = vec![Vec::new(); selectors.len()];
    for index in 0..PROBLEMS {
        let loss = LateFusion::new(VIEWS, picks, SURFACES, index);
        let problem = Problem::new(&loss)?;
        let random = Random { draws: 4000 }.select(&problem)?.curve[0].mean;
        let mut runs = Vec::new();
        for (_, selector) in &selectors {
            let seeds = (0..SEEDS).map(|seed| selector.select(&problem.seed(seed)));
            runs.push(seeds.collect::<Result<Vec<_>, _>>()?);
        }
        let optimum = optimum(&problem, &runs)?;
        for (row, runs) in rows.iter_mut().zip(runs) {
            let regret = |run: &Selection| run.regret(random, optimum).unwrap_or(f64::NAN);
            row.extend(runs.into_iter().map(|run| (regret(&run), run)));
        }
    }
    println!("| selector | median regret | worst | evaluations | computed | seconds |");
    println!("|---|---|---|---|---|---|");
    for ((name, _), runs) in selectors.iter().zip(&mut rows) {
        print_row(name, runs);
    }
    Ok(())
}

/// The lowest loss of all sets, or where there are too many, of the runs.
fn optimum(problem: &Problem<'_>, runs: &[Vec<Selection>]) -> Result<f64, SelectError> {
    match Exhaustive::default().select(problem) {
        Ok(optimum) => {
            println!("optimum {:?} in {:.1} s", optimum.picks, optimum.seconds);
            Ok(optimum.loss)
        }
        Err(SelectError::TooManySets { .. }) => {
            let losses = runs.iter().flatten().map(|run| run.loss);
            Ok(losses.fold(f64::INFINITY, f64::min))
        }
        Err(other) => Err(other),
    }
}

fn print_row(name: &str, runs: &mut [(f64, Selection)]) {
    runs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mean = |value: fn(&Selection) -> f64| {
        runs.iter().map(|(_, run)| value(run)).sum::<f64>() / runs.len() as f64
    };
    println!(
        "| {name} | {:.1} % | {:.1} % | {:.0} | {:.0} | {:.3} |",
        100.0 * runs[runs.len() / 2].0,
        100.0 * runs[runs.len() - 1].0,
        mean(|run| run.evaluations as f64),
        mean(|run| run.computed as f64),
        mean(|run| run.seconds),
    );
}
