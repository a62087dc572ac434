//! The gradient of a convolution's weights.

use std::ops::Range;

use sps_base::parallel;

use super::bands::chunks;
use super::conv::ConvShape;
use super::grid::{Grid, Window, pixels};
use super::grouped::GroupWeights;
use super::image::{self, PIXEL, Phase, rows_of_words};
use super::outer::{Joined, Outer, Pairs};
use super::outer_tiles::OuterTiles;
use super::phases::Lattice;
use super::simd::{Level, TileKind};
use super::winograd::{self, Reach};
use super::words::{Real, lanes_of};
use super::{depthwise, grouped};

/// Pixels whose outer products are summed before the sum joins a longer one: they stay in the cache.
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
    let reach = Lattice::of_window(&shape.window, from).whole_reach(from, to);
    let pairs = Pairs {
        source,
        starts: &reach.starts,
        gradient,
        places: &reach.places,
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
        dense(level, shape, pairs, &taps, target);
    } else if shape.depthwise() {
        let taps = from.taps(shape.window.size);
        depthwise::weight_gradient(level, &taps, pairs, target);
    } else {
        of_groups(level, shape, pairs, &from.taps(shape.window.size), target);
    }
}

/// The same of a convolution of images, `(outputs, 3, time, height, width)`: `source` lies as [`super::image`] says.
pub(crate) fn weight_gradient_of_images<W: Real>(
    level: Level,
    shape: &ConvShape,
    (source, images): (&[W], &Grid),
    (gradient, to): (&[W], &Grid),
    target: &mut [f32],
) {
    let [time, height, width] = shape.window.size;
    let runs = image::taps::<W>(&shape.window, images);
    let memory = rows_of_words::<W>(images);
    target.fill(0.0);
    for phase in Phase::all::<W>(&shape.window) {
        let lattice = phase.lattice(&shape.window, images);
        let reach = lattice.reach(to.rows(), &memory, to);
        let pairs = Pairs {
            source,
            starts: &reach.starts,
            gradient,
            places: &reach.places,
        };
        // Each run is a pixel of as many numbers as its words hold.
        let of_runs = ConvShape {
            window: Window {
                size: [time, height, 1],
                ..shape.window
            },
            inputs: W::NUMBERS * phase.run::<W>(&shape.window),
            ..*shape
        };
        let mut sums = vec![0.0; shape.outputs * of_runs.inputs * runs.len()];
        dense(level, &of_runs, pairs, &runs, &mut sums);
        let outputs = target.chunks_exact_mut(PIXEL * runs.len() * width);
        for (target, sums) in outputs.zip(sums.chunks_exact(of_runs.inputs * runs.len())) {
            for (row, target) in target.chunks_exact_mut(width).enumerate() {
                let (channel, run) = (row / runs.len(), row % runs.len());
                for (pixel, target) in target.iter_mut().enumerate() {
                    *target += sums[(phase.offset + PIXEL * pixel + channel) * runs.len() + run];
                }
            }
        }
    }
}

/// Adds sums of outer products, `(height, width)`, of a block of pixels to rows of `total`: of those of the left,
/// from a column and a pixel on, with those of the right. Of a window of several taps, sums join those of a block, in `block`.
fn add_products<W: Real>(
    level: Level,
    (left, column, first): (&Joined<'_, W>, usize, usize),
    (right, right_rows): (&[W], &[usize]),
    [height, width, taps]: [usize; 3],
    [total, block]: [&mut [f32]; 2],
) {
    let stride = Outer::<W>::stride(level, width);
    let add = |pixels: Range<usize>, sums: &mut [f32]| {
        let rows = first + pixels.start..first + pixels.end;
        let outer = Outer {
            left: left.of(column, rows),
            right: (right, &right_rows[pixels]),
            height,
            width,
        };
        outer.add(level, sums, stride);
    };
    let count = right_rows.len();
    if taps == 1 {
        add(0..count, total);
        return;
    }
    block.fill(0.0);
    chunks(0..count, WINDOWS).for_each(|pixels| add(pixels, block));
    for (total, sum) in total.iter_mut().zip(block) {
        *total += *sum;
    }
}

/// A part reads the other side in the time in which so many of its rows are summed.
const READ: usize = 16;

/// Numbers of sums that stay in the second-level cache beside what they are sums of.
const CACHE: usize = 64 << 10;

/// Sums that are laid out anew in the time in which a pixel is read once more.
const SUMS: usize = 16;

/// A matrix for each run of the window, of outputs and the run's elements: along its columns lies the side that
/// fills vectors better.
fn dense<W: Real>(
    level: Level,
    shape: &ConvShape,
    pairs: Pairs<'_, W>,
    runs: &[usize],
    target: &mut [f32],
) {
    let (taps, inputs) = (pixels(shape.window.size), shape.inputs);
    let run = taps * inputs / runs.len();
    if let Some(kind) = level.tiles().filter(|_| W::NUMBERS > 1) {
        return dense_by_tiles(level, kind, shape, pairs, runs, target);
    }
    let blocks = |count: usize| count.div_ceil(2 * level.lanes());
    let [by_outputs, by_run] = [blocks(shape.outputs) * run, blocks(run) * shape.outputs];
    // Where both fill vectors alike it is the narrower side, which each part reads anew; not where laying out the sums
    // takes longer than that.
    let narrower = run > shape.outputs && SUMS * pairs.starts.len() > run * shape.outputs;
    let turned = by_outputs < by_run || by_outputs == by_run && narrower;
    let (rows, columns) = if turned {
        (run, shape.outputs)
    } else {
        (shape.outputs, run)
    };
    let threads = rayon::current_num_threads();
    // In rows: the busiest thread's parts, and one more because threads do not keep in step.
    let cost = |&height: &usize| {
        let parts = rows.div_ceil(height) * runs.len();
        (parts.div_ceil(threads) + 1) * (height + READ)
    };
    let heights = (W::NUMBERS..rows + W::NUMBERS).step_by(W::NUMBERS);
    let height = heights.min_by_key(cost).unwrap_or(rows);
    let stride = Outer::<W>::stride(level, columns);
    let gradients = (!turned).then(|| Joined::new(level, pairs.gradient, pairs.places, rows));
    let sum =
        |(first, offset): (usize, usize), pixels: Range<usize>, [total, block]: [&mut [f32]; 2]| {
            let shape = [total.len() / stride, columns, taps];
            let seen = &pairs.source[offset..];
            let (starts, places) = (&pairs.starts[pixels.clone()], &pairs.places[pixels.clone()]);
            if let Some(gradients) = &gradients {
                let left = (gradients, first, pixels.start);
                add_products(level, left, (seen, starts), shape, [total, block]);
            } else {
                let seen = Joined::new(level, &seen[W::words(first)..], starts, shape[0]);
                let left = (&seen, 0, 0);
                add_products(level, left, (pairs.gradient, places), shape, [total, block]);
            }
        };
    let block = if taps == 1 { PIXELS } else { BLOCK };
    let blocks = || chunks(0..pairs.starts.len(), block);
    if taps == 1 && !turned && W::NUMBERS == 1 {
        let parts = target.chunks_mut(height * stride).enumerate();
        parallel::each(parts, |(part, total)| {
            total.fill(0.0);
            blocks().for_each(|pixels| sum((part * height, 0), pixels, [total, &mut []]));
        });
        return;
    }
    let firsts = (0..rows).step_by(height);
    let parts = firsts.flat_map(|first| runs.iter().map(move |&offset| (first, offset)));
    let parts: Vec<(usize, usize)> = parts.collect();
    // Parts that a thread computes together, block by block: what they share of a block is read once.
    let together = (CACHE / (height * stride)).clamp(1, parts.len().div_ceil(2 * threads).max(1));
    let sums = |parts: &[(usize, usize)]| {
        let len = |first: usize| height.min(rows - first) * stride;
        let totals = parts.iter().map(|&(first, _)| vec![0.0; len(first)]);
        let mut totals: Vec<Vec<f32>> = totals.collect();
        let mut block = vec![0.0; height * stride];
        for pixels in blocks() {
            for (&part, total) in parts.iter().zip(&mut totals) {
                let block = &mut block[..total.len()];
                sum(part, pixels.clone(), [total, block]);
            }
        }
        totals
    };
    let parts = parallel::map(parts.chunks(together), sums);
    let parts: Vec<Vec<f32>> = parts.into_iter().flatten().collect();
    let part = |row: usize, of_run: usize| {
        let part = &parts[row / height * runs.len() + of_run];
        &part[row % height * stride..][..stride]
    };
    let places = (0..columns).map(|column| W::place(column, level.lanes()));
    let places: Vec<usize> = places.collect();
    let outputs = target.chunks_mut(inputs * taps).enumerate();
    parallel::each(outputs, |(output, target)| {
        for tap in 0..taps {
            let (of_run, first) = (tap / (run / inputs), tap % (run / inputs) * inputs);
            let values = target.iter_mut().skip(tap).step_by(taps);
            if turned {
                for (row, value) in (first..).zip(values) {
                    *value = part(row, of_run)[places[output]];
                }
            } else {
                let part = part(output, of_run);
                for (place, value) in places[first..].iter().zip(values) {
                    *value = part[*place];
                }
            }
        }
    });
}

/// The same by matrix tiles.
fn dense_by_tiles<W: Real>(
    level: Level,
    kind: TileKind,
    shape: &ConvShape,
    pairs: Pairs<'_, W>,
    runs: &[usize],
    target: &mut [f32],
) {
    let (taps, inputs) = (pixels(shape.window.size), shape.inputs);
    let width = taps * inputs / runs.len();
    let sums = OuterTiles {
        kind,
        level,
        pairs,
        height: shape.outputs,
        runs,
        width,
    };
    let sums = sums.sums();
    let outputs = target.chunks_mut(inputs * taps).enumerate();
    parallel::each(outputs, |(output, target)| {
        for run in 0..runs.len() {
            let (mut place, mut left) = (run * (width / inputs), width);
            for values in sums.row(output, run) {
                let values = &values[..values.len().min(left)];
                left -= values.len();
                for value in values {
                    target[place] = *value;
                    place += taps;
                    if place >= target.len() {
                        place -= target.len() - 1;
                    }
                }
            }
        }
    });
}

/// A small matrix for each group and tap.
fn of_groups<W: Real>(
    level: Level,
    shape: &ConvShape,
    pairs: Pairs<'_, W>,
    taps: &[usize],
    target: &mut [f32],
) {
    let (inputs, outputs) = (shape.group_inputs(), shape.group_outputs());
    if inputs == outputs && GroupWeights::<f32>::serves(level, shape.outputs, inputs) {
        return grouped::weight_gradient(level, inputs, taps, pairs, target);
    }
    let stride = Outer::<W>::stride(level, outputs);
    let group_len = outputs * inputs * taps.len();
    let groups = target.chunks_mut(group_len).enumerate();
    parallel::each(groups, |(group, target)| {
        let mut sums = vec![0.0; inputs * stride];
        let right = &pairs.gradient[W::words(group * outputs)..];
        for (tap, &offset) in taps.iter().enumerate() {
            sums.fill(0.0);
            let seen = &pairs.source[offset + W::words(group * inputs)..];
            let seen = Joined::new(level, seen, pairs.starts, inputs);
            for pixels in chunks(0..pairs.starts.len(), BLOCK) {
                let outer = Outer {
                    left: seen.of(0, pixels.clone()),
                    right: (right, &pairs.places[pixels]),
                    height: inputs,
                    width: outputs,
                };
                outer.add(level, &mut sums, stride);
            }
            for (i, value) in target.iter_mut().skip(tap).step_by(taps.len()).enumerate() {
                let (output, input) = (i / inputs, i % inputs);
                *value = sums[input * stride + W::place(output, level.lanes())];
            }
        }
    });
}
