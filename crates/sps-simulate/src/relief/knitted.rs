//! Knitted cloth and ribs.

use super::super::grid::Grid;
use super::super::numeric::smoothstep;
use super::{Builder, Layers, fractal};

impl Builder<'_> {
    /// Stocking stitch: columns of nested V, each leg of yarn leaning outwards.
    pub(super) fn knitted(&mut self) -> Layers {
        let n = self.n;
        // A stitch is wider than high.
        let (columns, rows) = (self.count, (self.count as f32 * 1.25).round() as usize);
        let (dx, dy) = self.disorder(0.25, 8.0);
        let fuzz = fractal::field(
            n,
            fractal::Fractal::isotropic(0.12 / columns as f64, 0.5),
            self.stream,
        );
        let tones: Vec<f32> = (0..columns * rows)
            .map(|_| 0.16 * (self.stream.unit() as f32 - 0.5))
            .collect();
        let mut height = Grid::filled(n, 0.0);
        let mut tone = Grid::filled(n, 0.0);
        let step = 1.0 / n as f32;
        for y in 0..n {
            for x in 0..n {
                let at = y * n + x;
                let a = (x as f32 + 0.5) * step * columns as f32 + dx.data()[at];
                let b = (y as f32 + 0.5) * step * rows as f32 + dy.data()[at];
                let (z, row_shift, along) = stitch(a, b);
                let row = (b.floor() as i32 + row_shift).rem_euclid(rows as i32) as usize;
                let column = (a.floor() as i32).rem_euclid(columns as i32) as usize;
                height.data_mut()[at] = z + 0.06 * fuzz.data()[at];
                tone.data_mut()[at] = 0.3
                    + 0.5 * z
                    + tones[row * columns + column]
                    + 0.08 * along
                    + 0.05 * fuzz.data()[at];
            }
        }
        Layers {
            height,
            tone,
            polish: Grid::filled(n, 1.0),
        }
    }

    /// Parallel ridges with fine lines along them.
    pub(super) fn ribbed(&mut self) -> Layers {
        let (n, count) = (self.n, self.count as f32);
        let (shift, level) = self.disorder(0.15, 8.0);
        let lines = fractal::Fractal {
            length: 0.4 / f64::from(count) / 8.0,
            hurst: 0.6,
            stretch: 8.0,
            direction: std::f64::consts::FRAC_PI_2,
        };
        let lines = fractal::field(n, lines, self.stream);
        let tones: Vec<f32> = (0..self.count)
            .map(|_| 0.2 * (self.stream.unit() as f32 - 0.5) * (1.2 - self.regularity))
            .collect();
        let step = 1.0 / n as f32;
        let mut height = Grid::filled(n, 0.0);
        let mut tone = Grid::filled(n, 0.0);
        for y in 0..n {
            for x in 0..n {
                let at = y * n + x;
                let place = (x as f32 + 0.5) * step * count + shift.data()[at];
                let across = (place - place.floor() - 0.5) * 2.0;
                let ridge = 1.0 - across * across * across * across;
                let id = (place.floor() as i32).rem_euclid(self.count as i32) as usize;
                height.data_mut()[at] = ridge + 0.3 * level.data()[at] + 0.05 * lines.data()[at];
                tone.data_mut()[at] =
                    0.15 + 0.5 * smoothstep(0.0, 0.6, ridge) + tones[id] + 0.09 * lines.data()[at];
            }
        }
        Layers {
            height,
            tone,
            polish: Grid::filled(n, 1.0),
        }
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
