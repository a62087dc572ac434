//! The gradient of a convolution's weights.

use rayon::prelude::*;

use super::conv::ConvShape;
use super::depthwise::DepthwiseOuter;
use super::grid::{Grid, pixels};
use super::grouped::GroupedOuter;
use super::outer::Outer;
use super::simd::Level;
use super::winograd::{self, Reach};
use super::words::{Real, lanes_of};

/// Pixels whose outer products are summed before the sum joins a longer one: few enough that
/// what they hold stays in the cache.
const BLOCK: usize = 512;

/// The same of wide windows, whose sums join that of a block.
const WINDOWS: usize = 96;

/// The same of pixels by themselves.
const PIXELS: usize = 256;

/// Writes the gradient of the weights, `(outputs, inputs / groups, time, height, width)`.
///
/// `source` is the input with the window's padding around it, `gradient` that of the output, with
/// any border. No sum depends on the number of threads.
pub(crate) fn weight_gradient<W: Real>(
    level: Level,
    shape: &ConvShape,
    (source, from): (&[W], &Grid),
    (gradient, to): (&[W], &Grid),
    target: &mut [f32],
) {
    let pairs = Pairs {
        source,
        starts: &from.starts(&shape.window, to.size),
        gradient,
        places: &to.places(),
    };
    if shape.groups == 1 {
        if W::NUMBERS == 1 {
            let reach = Reach {
                source: lanes_of(source),
                from,
                starts: pairs.starts,
                to,
                places: pairs.places,
            };
            let ends = [shape.inputs, shape.outputs];
            let gradient = lanes_of(gradient);
            if winograd::weight_gradient(level, &shape.window, ends, &reach, gradient, target) {
                return;
            }
        }
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
struct Pairs<'a, W> {
    source: &'a [W],
    starts: &'a [usize],
    gradient: &'a [W],
    places: &'a [usize],
}

impl<'a, W: Real> Pairs<'a, W> {
    /// So many at a time.
    fn chunks(&self, count: usize) -> impl Iterator<Item = Pairs<'a, W>> {
        let (source, gradient) = (self.source, self.gradient);
        let chunks = self.starts.chunks(count).zip(self.places.chunks(count));
        chunks.map(move |(starts, places)| Pairs {
            source,
            starts,
            gradient,
            places,
        })
    }

    /// Adds the sum of outer products: rows from an output on, columns from an element of the window on.
    fn add(&self, level: Level, (output, offset): (usize, usize), run: usize, sums: &mut [f32]) {
        for pairs in self.chunks(PIXELS) {
            let outer = Outer {
                left: &pairs.gradient[W::words(output)..],
                left_rows: pairs.places,
                right: &pairs.source[offset..],
                right_rows: pairs.starts,
                height: sums.len() / run,
                width: run,
            };
            outer.add(level, sums, run);
        }
    }
}

/// Rows of a part that one thread computes, where the threads have enough of them: two tall tiles.
const ROWS: usize = 28;

/// A matrix for each run of the window: rows are outputs, columns the run's elements.
fn dense<W: Real>(
    level: Level,
    shape: &ConvShape,
    pairs: &Pairs<'_, W>,
    runs: &[usize],
    run: usize,
    target: &mut [f32],
) {
    let wanted = 2 * rayon::current_num_threads();
    let parts = (wanted.min(shape.outputs / ROWS)).max(wanted.div_ceil(runs.len()));
    let height = shape.outputs.div_ceil(parts).next_multiple_of(W::NUMBERS);
    let (taps, inputs) = (pixels(shape.window.size), shape.inputs);
    if taps == 1 {
        let parts = target.par_chunks_mut(height * run).enumerate();
        parts.for_each(|(part, target)| {
            target.fill(0.0);
            pairs.add(level, (part * height, 0), run, target);
        });
        return;
    }
    let firsts = (0..shape.outputs).step_by(height);
    let parts = firsts.flat_map(|first| runs.iter().map(move |&offset| (first, offset)));
    let parts: Vec<(usize, usize)> = parts.collect();
    let part = |&(first, offset): &(usize, usize)| {
        let height = height.min(shape.outputs - first);
        let (mut sums, mut total) = (vec![0.0; height * run], vec![0.0; height * run]);
        for pairs in pairs.chunks(BLOCK) {
            sums.fill(0.0);
            for pairs in pairs.chunks(WINDOWS) {
                pairs.add(level, (first, offset), run, &mut sums);
            }
            for (total, sum) in total.iter_mut().zip(&sums) {
                *total += sum;
            }
        }
        total
    };
    let parts: Vec<Vec<f32>> = parts.par_iter().map(part).collect();
    let rows = target.par_chunks_exact_mut(inputs * taps).enumerate();
    rows.for_each(|(row, target)| {
        let parts = &parts[row / height * runs.len()..][..runs.len()];
        let columns = parts.iter().flat_map(|part| {
            let own = &part[row % height * run..][..run];
            own.chunks_exact(inputs)
        });
        for (tap, values) in columns.enumerate() {
            for (target, value) in target.chunks_exact_mut(taps).zip(values) {
                target[tap] = *value;
            }
        }
    });
}

/// A small matrix for each group and tap.
fn grouped<W: Real>(
    level: Level,
    shape: &ConvShape,
    pairs: &Pairs<'_, W>,
    taps: &[usize],
    target: &mut [f32],
) {
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
                for pairs in pairs.chunks(BLOCK) {
                    let outer = Outer {
                        left: &pairs.source[offset + W::words(group * inputs)..],
                        left_rows: pairs.starts,
                        right: &pairs.gradient[W::words(group * outputs)..],
                        right_rows: pairs.places,
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
