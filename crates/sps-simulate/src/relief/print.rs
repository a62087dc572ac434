//! Prints and woven patterns: colour that no touch can tell.

use super::super::grid::Grid;
use super::super::numeric::smoothstep;
use super::super::stream::Stream;
use super::fractal::{Fractal, pair};

/// How much of the second colour lies at each texel, 0 to 1.
pub(crate) fn print_mask(n: usize, stream: &mut Stream) -> Grid {
    let strength = stream.between32(0.35, 1.0);
    let repeats = (2 + stream.index(9)) as f32;
    let duty = stream.between32(0.15, 0.5);
    let upright = stream.chance(0.5);
    let band = move |t: f32| {
        let t = t * repeats;
        1.0 - smoothstep(duty - 0.03, duty + 0.03, 2.0 * (t - t.floor() - 0.5).abs())
    };
    let mut mask = match stream.index(4) {
        0 => Grid::from_fn(n, |u, v| band(if upright { u } else { v })),
        1 => Grid::from_fn(n, |u, v| 0.5 * (band(u) + band(v))),
        2 => Grid::from_fn(n, |u, v| {
            let centred = |t: f32| t * repeats - (t * repeats).floor() - 0.5;
            let (x, y) = (centred(u), centred(v));
            1.0 - smoothstep(duty - 0.05, duty + 0.05, 2.0 * (x * x + y * y).sqrt())
        }),
        _ => {
            let length = 0.25 / f64::from(repeats);
            let mut blobs = pair(n, Fractal::isotropic(length, 1.0), stream).0;
            let level = 1.0 - 2.0 * duty;
            blobs.map_in_place(|v| smoothstep(level - 0.1, level + 0.1, v));
            blobs
        }
    };
    mask.map_in_place(|v| v * strength);
    mask
}
