//! Cast, moulded, rolled and brushed surfaces.

use std::f64::consts::FRAC_PI_2;

use super::super::numeric::smoothstep;
use super::cells::Cells;
use super::{Builder, Fractal, Layers};

impl Builder<'_> {
    /// The faint waviness of a cast or blown surface.
    pub(super) fn smooth(&mut self) -> Layers {
        let length = 0.2 / self.count as f64;
        let (height, cloud) = self.fields(Fractal::isotropic(length, 2.0));
        let specks = self.fields(Fractal::isotropic(0.003, 0.9)).0;
        let density = 2.2 + 1.6 * self.stream.unit() as f32;
        Layers::of_texels(self.n, |at, _, _| {
            let speck = smoothstep(density, density + 0.5, specks[at]);
            (height[at], 0.55 + 0.05 * cloud[at] - 0.4 * speck, 1.0)
        })
    }

    /// A glaze: waves, specks of iron, and a net of cracks that stain has entered.
    pub(super) fn glazed(&mut self) -> Layers {
        let clear = self.smooth();
        let specks = Cells::new(self.count * 3, 0.95, self.stream);
        let net = Cells::new((self.count * 3).div_ceil(4), 0.95, self.stream);
        let size = |_| 0.42 * self.stream.unit() as f32 - 0.14;
        let sizes: Vec<f32> = (0..specks.len()).map(size).collect();
        let stain = 0.1 + 0.35 * self.stream.unit() as f32;
        let (dx, dy) = self.disorder(0.8, 2.0);
        let (fine, wide) = (self.count as f32 * 3.0, (self.count * 3).div_ceil(4) as f32);
        Layers::of_texels(self.n, |at, u, v| {
            let (ox, oy) = (dx[at], dy[at]);
            let speck = specks.at(u * fine + ox, v * fine + oy);
            let size = sizes[speck.id];
            let dark = 1.0 - smoothstep(0.6 * size, size.max(1e-3), speck.first);
            let cell = net.at(u * wide + 0.3 * ox, v * wide + 0.3 * oy);
            let crack = 1.0 - smoothstep(0.0, 0.06, cell.second - cell.first);
            let stained = 0.5 * dark * f32::from(u8::from(size > 0.0)) + stain * crack;
            (clear.height[at], clear.tone[at] - stained, 1.0)
        })
    }

    /// Parallel scratches over a faint waviness.
    pub(super) fn brushed(&mut self) -> Layers {
        let level = self.stream.chance(0.5);
        let direction = if level { 0.0 } else { FRAC_PI_2 };
        let direction = direction + 0.03 * (self.stream.unit() - 0.5);
        let scratch = Fractal::isotropic(0.08 / self.count as f64, 0.5);
        let (height, streaks) = self.fields(scratch.stretched(60.0, direction));
        let waviness = self.fields(Fractal::isotropic(0.15, 1.0)).0;
        Layers::of_texels(self.n, |at, _, _| {
            let height = height[at] + 0.6 * waviness[at];
            (height, 0.5 + 0.16 * streaks[at], 1.0)
        })
    }

    /// A raised motif on a lattice.
    pub(super) fn embossed(&mut self) -> Layers {
        let motif = MOTIFS[self.stream.index(MOTIFS.len())];
        let fill = self.stream.between32(0.22, 0.38);
        let sharpness = self.stream.between32(0.06, 0.3);
        let count = self.count as f32;
        let (dx, dy) = self.disorder(0.6, 3.0);
        let (inner, outer) = (fill - sharpness * 0.5, fill + sharpness * 0.5);
        Layers::of_texels(self.n, |at, u, v| {
            let (x, y) = (u * count + dx[at], v * count + dy[at]);
            let height = 1.0 - smoothstep(inner, outer, motif(x, y));
            (height, 0.45 + 0.2 * height, 1.0)
        })
    }
}

/// What is raised on an embossed surface: the distance from the middle of the nearest motif, in
/// pitches.
const MOTIFS: [fn(f32, f32) -> f32; 6] = [
    // Dots, squares, diamonds.
    |x, y| hypot(centred(x), centred(y)),
    |x, y| centred(x).abs().max(centred(y).abs()),
    |x, y| 0.7 * (centred(x).abs() + centred(y).abs()),
    // Lines, hexagons, waves.
    |x, _| centred(x).abs(),
    |x, y| {
        let shift = 0.5 * (y.floor() as i32).rem_euclid(2) as f32;
        hypot(centred(x + shift), centred(y))
    },
    |x, y| centred(x + centred(0.5 * y).abs()).abs(),
];

fn centred(t: f32) -> f32 {
    t - t.floor() - 0.5
}

fn hypot(x: f32, y: f32) -> f32 {
    (x * x + y * y).sqrt()
}
