//! What scoring costs: streaming, every score of a test split, and intervals over units.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use sps_metrics::{
    Intervals, Level, Metric, Pair, Samples, ScoreAccumulator, Scored, Scores, SplitConformal,
    TrainingMean,
};

/// As many surfaces as the paper's dataset, to print rounding.
const SURFACES: usize = 400;

/// Truths over 0 to 100 and estimates that wander about them.
fn samples(count: usize, wander: f64) -> (Vec<f64>, Vec<f64>) {
    let truth = (0..count).map(|i| (i as f64 * 37.7) % 100.0);
    let estimate = truth
        .clone()
        .enumerate()
        .map(|(i, truth)| truth + wander * (i as f64 * 1.3).sin());
    (truth.collect(), estimate.collect())
}

fn streaming(criterion: &mut Criterion) {
    const COUNT: usize = 100_000;
    let (truth, estimate) = samples(COUNT, 8.0);
    let pairs = truth.iter().zip(&estimate);
    let pairs: Vec<Pair> = pairs
        .map(|(&truth, &estimate)| Pair { truth, estimate })
        .collect();
    let mut group = criterion.benchmark_group("streaming");
    group.throughput(Throughput::Elements(COUNT as u64));
    group.bench_function("score_accumulator", |bencher| {
        bencher.iter(|| {
            black_box(&pairs)
                .iter()
                .copied()
                .collect::<ScoreAccumulator>()
        });
    });
    // What the same sums cost in plain f64: the ratio is the price of order independence.
    group.bench_function("plain_f64", |bencher| {
        bencher.iter(|| {
            let sums = [0.0; 4];
            black_box(&pairs).iter().fold(sums, |[t, tt, a, ee], pair| {
                let error = pair.truth - pair.estimate;
                [
                    t + pair.truth,
                    tt + pair.truth * pair.truth,
                    a + error.abs(),
                    ee + error * error,
                ]
            })
        });
    });
    group.finish();
}

fn scores(criterion: &mut Criterion) {
    let (truth, estimate) = samples(SURFACES, 8.0);
    let samples = Samples {
        truth: &truth,
        estimate: &estimate,
    };
    criterion.bench_function("all_scores_400", |bencher| {
        bencher.iter(|| Scores::of(black_box(samples), TrainingMean::new(50.0)));
    });
    let residuals: Vec<f64> = truth.iter().zip(&estimate).map(|(t, e)| t - e).collect();
    criterion.bench_function("split_conformal_400", |bencher| {
        bencher.iter(|| SplitConformal::from_residuals(black_box(&residuals), Level::P90));
    });
}

fn intervals(criterion: &mut Criterion) {
    let (truth, rough) = samples(SURFACES, 8.0);
    let (_, fine) = samples(SURFACES, 5.0);
    let intervals = Intervals::of_models(Level::P95);
    let mean = TrainingMean::new(50.0).unwrap_or_else(|reason| panic!("{reason}"));
    let mut group = criterion.benchmark_group("interval_400_surfaces");
    for metric in [
        Metric::R2(mean),
        Metric::R2OwnMean,
        Metric::Mae,
        Metric::MedianPercentError,
        Metric::Spearman,
    ] {
        let samples = Samples {
            truth: &truth,
            estimate: &rough,
        };
        let scored = [Scored::new(metric, samples)];
        group.bench_function(metric.id(), |bencher| {
            bencher.iter(|| intervals.interval(black_box(&scored)));
        });
    }
    let [first, second] = [&rough, &fine].map(|estimate| {
        let truth = &truth;
        [Scored::new(Metric::R2(mean), Samples { truth, estimate })]
    });
    group.bench_function("r2_difference", |bencher| {
        bencher.iter(|| intervals.difference(black_box(&first), black_box(&second)));
    });
    group.finish();
}

criterion_group!(benches, streaming, scores, intervals);
criterion_main!(benches);
