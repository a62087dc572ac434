//! The gradient of a convolution's weights.

use rayon::prelude::*;

use super::buffer::Buffer;
use super::conv::ConvShape;
use super::depthwise::DepthwiseOuter;
use super::grid::{Grid, pixels};
use super::grouped::GroupedOuter;
use super::outer::Outer;
use super::panels::Panels;
use super::product::{Epilogue, Product};
use super::simd::Level;

/// Pixels whose outer products are summed before the sum joins a longer one: few enough that
/// what they hold stays in the cache.
const BLOCK: usize = 512;

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
    if shape.groups == 1 && pixels(shape.window.size) == 1 {
        pointwise(level, shape, &pairs, target);
    } else if shape.groups == 1 {
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

/// Pixels of which both feature maps stay in the cache.
const NEAR: usize = 256;

/// One matrix: rows are outputs, columns inputs. Both feature maps are read where they lie.
fn pointwise(level: Level, shape: &ConvShape, pairs: &Pairs<'_>, target: &mut [f32]) {
    let rows = shape.outputs.div_ceil(2 * rayon::current_num_threads());
    let parts = target.par_chunks_mut(rows * shape.inputs).enumerate();
    parts.for_each(|(part, target)| {
        target.fill(0.0);
        let blocks = pairs.starts.chunks(NEAR).zip(pairs.places.chunks(NEAR));
        for (starts, places) in blocks {
            let outer = Outer {
                left: &pairs.gradient[part * rows..],
                left_rows: places,
                right: pairs.source,
                right_rows: starts,
                height: target.len() / shape.inputs,
                width: shape.inputs,
            };
            outer.add(level, target, shape.inputs);
        }
    });
}

/// One matrix: rows are outputs, columns the runs' elements.
fn dense(
    level: Level,
    shape: &ConvShape,
    pairs: &Pairs<'_>,
    taps: &[usize],
    run: usize,
    target: &mut [f32],
) {
    let columns = taps.len() * run;
    let parts = parts(shape.outputs, columns);
    let blocks: Vec<Vec<f32>> = parts
        .par_iter()
        .map(|part| part.compute(level, pairs, taps, run))
        .collect();
    let (taps, inputs) = (pixels(shape.window.size), shape.inputs);
    for (part, block) in parts.iter().zip(&blocks) {
        for (row, values) in part.rows.clone().zip(block.chunks(part.columns.len())) {
            for (column, value) in part.columns.clone().zip(values) {
                let (tap, input) = (column / inputs, column % inputs);
                target[(row * inputs + input) * taps + tap] = *value;
            }
        }
    }
}

/// A part of the matrix that one thread computes.
struct Part {
    rows: std::ops::Range<usize>,
    columns: std::ops::Range<usize>,
}

/// Cuts a matrix into parts enough for the threads, none of them needlessly small.
fn parts(rows: usize, columns: usize) -> Vec<Part> {
    let wanted = 2 * rayon::current_num_threads();
    let across = wanted.min(rows.div_ceil(56)).max(1);
    let along = wanted.div_ceil(across).min(columns.div_ceil(128)).max(1);
    let share = |len: usize, parts: usize, i: usize| len * i / parts..len * (i + 1) / parts;
    (0..across * along)
        .map(|i| Part {
            rows: share(rows, across, i / along),
            columns: share(columns, along, i % along),
        })
        .collect()
}

impl Part {
    /// The part, `(rows, columns)`: block by block, the gradient's columns stand as rows against
    /// the gathered input.
    fn compute(&self, level: Level, pairs: &Pairs<'_>, taps: &[usize], run: usize) -> Vec<f32> {
        let (height, width) = (self.rows.len(), self.columns.len());
        let mut sums = vec![0.0; height * width];
        let mut left = Buffer::zeros(height * BLOCK);
        let mut right = Panels::empty(level);
        let places: Vec<usize> = (0..height).map(|row| row * width).collect();
        let rows: Vec<usize> = (0..height).map(|row| row * BLOCK).collect();
        let blocks = pairs.starts.chunks(BLOCK).zip(pairs.places.chunks(BLOCK));
        for (starts, pixels) in blocks {
            transpose(pairs.gradient, pixels, self.rows.start, height, &mut left);
            right.gather(starts.len(), width, |row, column, out| {
                let start = starts[row];
                gather(
                    &pairs.source[start..],
                    taps,
                    run,
                    self.columns.start + column,
                    out,
                );
            });
            let product = Product {
                source: &left,
                rows: &rows,
                frame_rows: height,
                taps: &[0],
                run: starts.len(),
                panels: &right,
                epilogue: Epilogue {
                    accumulate: Some(1.0),
                    ..Epilogue::default()
                },
            };
            product.write(&mut sums, &places, 0);
        }
        sums
    }
}

/// Lays `height` channels from `channel` on out as rows of [`BLOCK`] pixels.
fn transpose(source: &[f32], pixels: &[usize], channel: usize, height: usize, target: &mut [f32]) {
    const TILE: usize = 16;
    for from in (0..height).step_by(TILE) {
        let to = (from + TILE).min(height);
        for (i, &pixel) in pixels.iter().enumerate() {
            let start = pixel + channel;
            for (row, value) in (from..to).zip(&source[start + from..start + to]) {
                target[row * BLOCK + i] = *value;
            }
        }
    }
}

/// Copies a window's elements from number `from` on, its runs one after the other.
fn gather(window: &[f32], taps: &[usize], run: usize, from: usize, out: &mut [f32]) {
    let mut at = from;
    let mut rest = out;
    while !rest.is_empty() {
        let (tap, offset) = (at / run, at % run);
        let len = (run - offset).min(rest.len());
        let (now, later) = rest.split_at_mut(len);
        let start = taps[tap] + offset;
        now.copy_from_slice(&window[start..start + len]);
        rest = later;
        at += len;
    }
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
                let blocks = pairs.starts.chunks(BLOCK).zip(pairs.places.chunks(BLOCK));
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
