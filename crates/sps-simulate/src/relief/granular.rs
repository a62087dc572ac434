//! Grains, pebbles, pores and veins.

use super::super::numeric::smoothstep;
use super::cells::{Cells, Nearest};
use super::{Builder, Fractal, Layers};

/// Hurst exponents of cell walls: drawn tight, or broken.
const SMOOTH: f64 = 2.5;
const FRAYED: f64 = 1.0;

impl Builder<'_> {
    /// Domes parted by creases, as in leather and moulded grain.
    pub(super) fn pebbled(&mut self) -> Layers {
        let crumple = self.disorder(1.2, 9.0).0;
        let mut layers = self.cellular(SMOOTH, |cell, random| {
            let crease = smoothstep(0.02, 0.32, cell.second - cell.first);
            let dome = crease * (1.0 - 0.35 * cell.first) + 0.12 * random;
            let tone = 0.25 + 0.45 * crease + 0.07 * random;
            (dome, tone, 0.6 + 0.4 * crease)
        });
        layers.height.add_scaled(&crumple, 0.25);
        layers.tone.add_scaled(&crumple, 0.03);
        layers
    }

    /// Pits of two sizes in a body.
    pub(super) fn porous(&mut self) -> Layers {
        let fine = self.finer().pits(0.9, 0.3);
        let mut layers = self.pits(0.75, 0.55);
        layers.height.add_scaled(&fine.height, 0.4);
        layers.tone.add_scaled(&fine.tone, 0.5);
        layers.tone.map_in_place(|t| t - 0.3);
        layers
    }

    /// Round pits: `share` of the cells hold one, of up to `radius` of the pitch.
    fn pits(&mut self, share: f32, radius: f32) -> Layers {
        self.cellular(SMOOTH, |cell, random| {
            let size = radius * (0.4 + 0.6 * random.abs());
            let there = if random > 1.0 - 2.0 * share { 1.0 } else { 0.0 };
            let depth = there * (1.0 - smoothstep(0.55 * size, size, cell.first));
            (-depth * size * 2.0, 0.75 - 0.65 * depth, 1.0 - 0.8 * depth)
        })
    }

    /// Loose or cemented grains, each of its own height and tone.
    pub(super) fn granular(&mut self) -> Layers {
        self.cellular(FRAYED, |cell, random| {
            let dome = (1.0 - cell.first * cell.first).max(0.0).sqrt();
            let tone = 0.5 + 0.4 * random + 0.2 * (dome - 0.7);
            (dome + 0.35 * random, tone, 1.0)
        })
    }

    /// Minerals ground flat: dark mica, quartz and two feldspars.
    pub(super) fn speckled(&mut self) -> Layers {
        let fine = self.finer().cellular(FRAYED, |_, random| {
            let tone = if random > 0.72 { -0.35 } else { 0.05 * random };
            (random, tone, 1.0)
        });
        let mut layers = self.cellular(FRAYED, |cell, random| {
            let mineral = match random {
                r if r < -0.66 => 0.06,
                r if r < -0.1 => 0.36,
                r if r < 0.62 => 0.68,
                _ => 0.95,
            };
            let joint = smoothstep(0.0, 0.08, cell.second - cell.first);
            let tone = mineral - 0.05 * (1.0 - joint);
            (0.5 * random + 0.4 * joint, tone, 1.0)
        });
        layers.height.add_scaled(&fine.height, 0.2);
        layers.tone.add_scaled(&fine.tone, 1.0);
        layers
    }

    /// Veins where a warped field crosses zero, as in marble.
    pub(super) fn veined(&mut self) -> Layers {
        let length = 0.5 / self.count as f64;
        let direction = std::f64::consts::PI * self.stream.unit();
        let broad = Fractal::isotropic(length, 0.75).stretched(2.0, direction);
        let (broad, warp) = self.fields(broad);
        let (second, cloud) = self.fields(Fractal::isotropic(0.5 * length, 0.6));
        let width = 0.05 + 0.1 * self.stream.unit() as f32;
        Layers::of_texels(self.n, |at, _, _| {
            let (b, s, w) = (broad[at], second[at], warp[at]);
            let main = 1.0 - smoothstep(0.0, width * (1.0 + 0.6 * w.abs()), b.abs());
            let fine = 1.0 - smoothstep(0.0, 0.5 * width, (s + 0.5 * b).abs());
            let veins =
                (main * (0.55 + 0.4 * w) + 0.5 * fine * smoothstep(-0.2, 0.8, w)).clamp(0.0, 1.0);
            (cloud[at], 0.72 + 0.08 * cloud[at] - 0.66 * veins, 1.0)
        })
    }

    /// Evaluates `(height, tone, polish)` of each cell at each texel, given the place in the cell
    /// and the cell's own draw from -1 to 1. `fray` is the Hurst exponent of the walls.
    fn cellular(&mut self, fray: f64, f: impl Fn(Nearest, f32) -> (f32, f32, f32)) -> Layers {
        let jitter = 0.95 * (1.0 - self.regularity).sqrt();
        let cells = Cells::new(self.count, jitter, self.stream);
        let random: Vec<f32> = (0..cells.len()).map(|_| self.signed()).collect();
        let (dx, dy) = self.displacement(0.3, 1.5, fray);
        let count = self.count as f32;
        Layers::of_texels(self.n, |at, u, v| {
            let cell = cells.at(u * count + dx[at], v * count + dy[at]);
            f(cell, random[cell.id])
        })
    }
}
