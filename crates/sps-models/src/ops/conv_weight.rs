//! The gradient of a convolution's weights.

use rayon::prelude::*;

use super::conv::ConvShape;
use super::depthwise::DepthwiseOuter;
use super::grid::{Grid, pixels};
use super::grouped::GroupedOuter;
use super::outer::Outer;
use super::simd::Level;

/// Pixels whose outer products are summed before the sum joins a longer one: few enough that
/// what they hold stays in the cache.
const NEAR: usize = 512;

/// The same where both feature maps are read where they lie: pixels of the first sums, and of those that
/// these join. Of a single pixel's window, and of wider ones.
const STEPS: [[usize; 2]; 2] = [[256, 256], [96, 512]];

/// Writes the gradient of the weights, `(outputs, inputs / groups, time, height, width)`.
///
/// `source` is the input with the window's padding around it, `gradient` that of the output, with
/// any border. No sum depends on the number of threads.
pub(crate) fn weight_gradient(
    level: Level,
    shape: &ConvShape,
    (source, from): (&[f32], &Grid),
    (gradient, to): (&[f32], &Grid),
    target: &mut [f32],
) {
    let pairs = Pairs {
        source,
        starts: &from.starts(&shape.window, to.size),
        gradient,
        places: &to.places(),
    };
    if shape.groups == 1 {
        let taps = from.taps(shape.runs(from));
        let run = pixels(shape.window.size) * shape.inputs / taps.len();
        dense(level, shape, &pairs, &taps, run, target);
    } else if shape.depthwise() {
        let outer = DepthwiseOuter {
            level,
            channels: shape.outputs,
            taps: &from.taps(shape.window.size),
        };
        outer.write(source, pairs.starts, gradient, pairs.places, target);
    } else {
        grouped(level, shape, &pairs, &from.taps(shape.window.size), target);
    }
}

/// Pixels of the output with the places of the input where their windows begin.
struct Pairs<'a> {
    source: &'a [f32],
    starts: &'a [usize],
    gradient: &'a [f32],
    places: &'a [usize],
}

/// Rows of a part that one thread computes, where there are as many: two tall tiles.
const ROWS: usize = 28;

/// A matrix for each run of the window: rows are outputs, columns the run's elements.
fn dense(
    level: Level,
    shape: &ConvShape,
    pairs: &Pairs<'_>,
    runs: &[usize],
    run: usize,
    target: &mut [f32],
) {
    let wanted = (2 * rayon::current_num_threads()).min(shape.outputs / ROWS);
    let height = shape.outputs.div_ceil(wanted.max(1));
    let firsts = (0..shape.outputs).step_by(height);
    let parts = firsts.flat_map(|first| runs.iter().map(move |&offset| (first, offset)));
    let parts: Vec<(usize, usize)> = parts.collect();
    let [few, many] = STEPS[usize::from(pixels(shape.window.size) > 1)];
    let part = |&(first, offset): &(usize, usize)| {
        let height = height.min(shape.outputs - first);
        let (mut sums, mut total) = (vec![0.0; height * run], vec![0.0; height * run]);
        let blocks = pairs.starts.chunks(many).zip(pairs.places.chunks(many));
        for (starts, places) in blocks {
            sums.fill(0.0);
            for (starts, places) in starts.chunks(few).zip(places.chunks(few)) {
                let outer = Outer {
                    left: &pairs.gradient[first..],
                    left_rows: places,
                    right: &pairs.source[offset..],
                    right_rows: starts,
                    height,
                    width: run,
                };
                outer.add(level, &mut sums, run);
            }
            for (total, sum) in total.iter_mut().zip(&sums) {
                *total += sum;
            }
        }
        total
    };
    let parts: Vec<Vec<f32>> = parts.par_iter().map(part).collect();
    let (taps, inputs) = (pixels(shape.window.size), shape.inputs);
    let rows = target.par_chunks_exact_mut(inputs * taps).enumerate();
    rows.for_each(|(row, target)| {
        let parts = &parts[row / height * runs.len()..][..runs.len()];
        let columns = parts.iter().flat_map(|part| {
            let own = &part[row % height * run..][..run];
            own.chunks_exact(inputs)
        });
        for (tap, values) in columns.enumerate() {
            for (target, value) in target.iter_mut().skip(tap).step_by(taps).zip(values) {
                *target = *value;
            }
        }
    });
}

/// A small matrix for each group and tap.
fn grouped(level: Level, shape: &ConvShape, pairs: &Pairs<'_>, taps: &[usize], target: &mut [f32]) {
    let outer = GroupedOuter::new(level, shape.outputs, shape.group_inputs(), taps);
    if let Some(outer) = outer.filter(|_| shape.group_inputs() == shape.group_outputs()) {
        outer.write(
            pairs.source,
            pairs.starts,
            pairs.gradient,
            pairs.places,
            target,
        );
        return;
    }
    let (inputs, outputs) = (shape.group_inputs(), shape.group_outputs());
    let group_len = outputs * inputs * taps.len();
    target
        .par_chunks_exact_mut(group_len)
        .enumerate()
        .for_each(|(group, target)| {
            let mut sums = vec![0.0; outputs * inputs];
            for (tap, &offset) in taps.iter().enumerate() {
                sums.fill(0.0);
                let blocks = pairs.starts.chunks(NEAR).zip(pairs.places.chunks(NEAR));
                for (starts, places) in blocks {
                    let outer = Outer {
                        left: &pairs.source[offset + group * inputs..],
                        left_rows: starts,
                        right: &pairs.gradient[group * outputs..],
                        right_rows: places,
                        height: inputs,
                        width: outputs,
                    };
                    outer.add(level, &mut sums, outputs);
                }
                for (i, sum) in sums.iter().enumerate() {
                    let (input, output) = (i / outputs, i % outputs);
                    target[(output * inputs + input) * taps.len() + tap] = *sum;
                }
            }
        });
}
