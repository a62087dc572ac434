//! The gradient of the weights.

use sps_base::parallel;

use super::points::of_sums;
use super::transforms::{TransformGradients, TransformInputs};
use super::{CACHE, CHANNELS, MEMORY, Reach, Tile, Winograd, tiles, worth_it};
use crate::ops::grid::{Window, pixels, starts};
use crate::ops::outer::Outer;
use crate::ops::simd::Level;
use crate::ops::words::Word;

/// More weights of a tap than this have sums that are not read and written, for each chunk of tiles, in the time
/// that is saved.
const MOST_WEIGHTS: usize = 1 << 14;

/// Products of a pair of channels by tiles of 2 x 2 outputs.
const PRODUCTS: usize = 16;

/// Parts of frames whose sums of products are joined in order.
const MOST_PARTS: usize = 8;

/// The gradient of the weights, `(outputs, inputs, time, height, width)`, by tiles of 2 x 2 outputs: of each tile
/// 16 products of a pair of channels in place of 36. False where the window is another or it is not worth it.
/// Frames are summed in parts, and the parts in order. More threads than parts share the outputs of each.
pub(in crate::ops) fn weight_gradient(
    level: Level,
    window: &Window,
    [inputs, outputs]: [usize; 2],
    reach: &Reach<'_>,
    gradient: &[f32],
    target: &mut [f32],
) -> bool {
    let (frames, size) = (reach.to.frames, reach.to.size);
    let serves = worth_it(window, [inputs, outputs])
        && inputs * outputs <= MOST_WEIGHTS
        && Winograd::serves(size);
    if !serves {
        return false;
    }
    let shape @ [times, ..] = [window.size[0], inputs, outputs];
    let parts = frames.min(MOST_PARTS);
    let shares = rayon::current_num_threads().div_ceil(parts.max(1));
    let height = outputs.div_ceil(shares).next_multiple_of(CHANNELS);
    let shares = outputs.div_ceil(height);
    let piece = |piece: usize| {
        let (part, first) = (piece / shares, piece % shares * height);
        let at = |part: usize| frames * part / parts * pixels(size);
        let tiles = tiles(2, size, at(part)..at(part + 1));
        let rows = (first, height.min(outputs - first));
        sums_of_products(level, shape, rows, reach, gradient, &tiles)
    };
    let pieces: Vec<Vec<f32>> = parallel::map(0..parts * shares, piece);
    let rows = target.chunks_mut(inputs * 9 * times).enumerate();
    parallel::each(rows, |(output, target)| {
        let (share, row) = (output / height, output % height);
        for time in 0..times {
            let mut sums = vec![[0.0; PRODUCTS]; inputs];
            for piece in pieces.iter().skip(share).step_by(shares) {
                let products = piece.chunks_exact(piece.len() / PRODUCTS);
                for (product, piece) in products.enumerate() {
                    let row = &piece[piece.len() / times * time + row * inputs..][..inputs];
                    for (sum, value) in sums.iter_mut().zip(row) {
                        sum[product] += value;
                    }
                }
            }
            for (sums, target) in sums.iter().zip(target.chunks_exact_mut(9 * times)) {
                target[9 * time..][..9].copy_from_slice(of_sums(sums).as_flattened());
            }
        }
    });
    true
}

/// `(products, times, height, inputs)`: sums over tiles of the products of their inputs with the gradients of
/// `height` outputs from `first` on, both transformed.
fn sums_of_products(
    level: Level,
    [times, inputs, outputs]: [usize; 3],
    (first, height): (usize, usize),
    reach: &Reach<'_>,
    gradient: &[f32],
    tiles: &[Tile],
) -> Vec<f32> {
    let mut sums = vec![0.0; PRODUCTS * times * inputs * height];
    let most = (CACHE / (PRODUCTS * (times * inputs + outputs))).max(1);
    let mut memory = MEMORY.take();
    for tiles in tiles.chunks(most) {
        let seen = PRODUCTS * times * tiles.len() * inputs;
        memory.resize(seen + PRODUCTS * tiles.len() * outputs);
        let (seen, slopes) = memory.split_at_mut(seen);
        let of_inputs = TransformInputs::<f32, 4> {
            reach,
            tiles,
            times,
            run: inputs,
            target: &mut *seen,
        };
        f32::run(level, of_inputs);
        level.run(TransformGradients {
            reach,
            gradient,
            tiles,
            n: outputs,
            target: &mut *slopes,
        });
        let slopes = &slopes[first..];
        let [left_rows, right_rows] = [outputs, inputs].map(|step| starts(tiles.len(), step));
        for (i, sums) in sums.chunks_exact_mut(inputs * height).enumerate() {
            let outer = Outer {
                left: (&slopes[i / times * tiles.len() * outputs..], &left_rows),
                right: (&seen[i * tiles.len() * inputs..], &right_rows),
                height,
                width: inputs,
            };
            outer.add(level, sums, inputs);
        }
    }
    MEMORY.set(memory);
    sums
}
