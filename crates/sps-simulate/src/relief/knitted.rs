//! Knitted cloth and ribs.

use super::super::numeric::smoothstep;
use super::{Builder, Fractal, Layers};

impl Builder<'_> {
    /// Stocking stitch: columns of nested V, each leg of yarn leaning outwards.
    pub(super) fn knitted(&mut self) -> Layers {
        // A stitch is wider than high.
        let (columns, rows) = (self.count, (self.count as f32 * 1.25).round() as usize);
        let (dx, dy) = self.disorder(0.25, 8.0);
        let fuzz = Fractal::isotropic(0.12 / columns as f64, 0.5);
        let fuzz = self.fields(fuzz).0;
        let tone = |_| 0.16 * (self.stream.unit() as f32 - 0.5);
        let tones: Vec<f32> = (0..columns * rows).map(tone).collect();
        Layers::of_texels(self.n, |at, u, v| {
            let (a, b) = (u * columns as f32 + dx[at], v * rows as f32 + dy[at]);
            let (z, row_shift, along) = stitch(a, b);
            let row = (b.floor() as i32 + row_shift).rem_euclid(rows as i32) as usize;
            let column = (a.floor() as i32).rem_euclid(columns as i32) as usize;
            let own = tones[row * columns + column];
            let tone = 0.3 + 0.5 * z + own + 0.08 * along + 0.05 * fuzz[at];
            (z + 0.06 * fuzz[at], tone, 1.0)
        })
    }

    /// Parallel ridges with fine lines along them.
    pub(super) fn ribbed(&mut self) -> Layers {
        let count = self.count as f32;
        let (shift, level) = self.disorder(0.15, 8.0);
        let lines = Fractal::isotropic(0.4 / f64::from(count) / 8.0, 0.6);
        let upright = std::f64::consts::FRAC_PI_2;
        let lines = self.fields(lines.stretched(8.0, upright)).0;
        let tone = |_| 0.2 * (self.stream.unit() as f32 - 0.5) * (1.2 - self.regularity);
        let tones: Vec<f32> = (0..self.count).map(tone).collect();
        Layers::of_texels(self.n, |at, u, _| {
            let place = u * count + shift[at];
            let across = (place - place.floor() - 0.5) * 2.0;
            let ridge = 1.0 - across * across * across * across;
            let own = tones[(place.floor() as i32).rem_euclid(tones.len() as i32) as usize];
            let height = ridge + 0.3 * level[at] + 0.05 * lines[at];
            let tone = 0.15 + 0.5 * smoothstep(0.0, 0.6, ridge) + own + 0.09 * lines[at];
            (height, tone, 1.0)
        })
    }
}

/// Height of the topmost leg at a place in units of a stitch, the row that it belongs to relative
/// to the place's own, and the place along it (-1 to 1).
fn stitch(a: f32, b: f32) -> (f32, i32, f32) {
    let x = a - a.floor() - 0.5;
    let fy = b - b.floor();
    let mut best = (-0.35, 0, 0.0);
    for shift in -1..=1 {
        // Legs run over one and a half rows, from the middle outwards.
        let along = (fy - shift as f32 - 0.5) / 0.8;
        if along.abs() > 1.0 {
            continue;
        }
        let centre = 0.25 + 0.11 * along;
        let q = (x.abs() - centre) / 0.24;
        let round = 1.0 - q * q;
        if round <= 0.0 {
            continue;
        }
        let z = round.sqrt() * (0.75 - 0.45 * along * along) + 0.25 * along;
        if z > best.0 {
            best = (z, shift, along);
        }
    }
    best
}
