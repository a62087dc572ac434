//! Cast, moulded, rolled and brushed surfaces.

use super::super::grid::Grid;
use super::super::numeric::smoothstep;
use super::cells::Cells;
use super::{Builder, Layers, fractal};

/// What is raised on an embossed surface.
#[derive(Clone, Copy)]
enum Motif {
    Dots,
    Squares,
    Diamonds,
    Lines,
    Hexagons,
    Waves,
}

impl Builder<'_> {
    /// The faint waviness of a cast or blown surface.
    pub(super) fn smooth(&mut self) -> Layers {
        let length = 0.2 / self.count as f64;
        let (height, cloud) = fractal::pair(
            self.n,
            fractal::Fractal::isotropic(length, 2.0),
            self.stream,
        );
        let specks = fractal::field(self.n, fractal::Fractal::isotropic(0.003, 0.9), self.stream);
        let mut tone = Grid::filled(self.n, 0.55);
        tone.add_scaled(&cloud, 0.05);
        let density = 2.2 + 1.6 * self.stream.unit() as f32;
        for (t, s) in tone.data_mut().iter_mut().zip(specks.data()) {
            *t -= 0.4 * smoothstep(density, density + 0.5, *s);
        }
        Layers {
            height,
            tone,
            polish: Grid::filled(self.n, 1.0),
        }
    }

    /// A glaze: waves, specks of iron, and a net of cracks that stain has entered.
    pub(super) fn glazed(&mut self) -> Layers {
        let mut layers = self.smooth();
        let specks = Cells::new(self.count * 3, 0.95, self.stream);
        let net = Cells::new((self.count * 3).div_ceil(4), 0.95, self.stream);
        let sizes: Vec<f32> = (0..specks.len())
            .map(|_| 0.42 * self.stream.unit() as f32 - 0.14)
            .collect();
        let stain = 0.1 + 0.35 * self.stream.unit() as f32;
        let (dx, dy) = self.disorder(0.8, 2.0);
        let (fine, wide) = (self.count as f32 * 3.0, (self.count * 3).div_ceil(4) as f32);
        let step = 1.0 / self.n as f32;
        for (at, tone) in layers.tone.data_mut().iter_mut().enumerate() {
            let (x, y) = (at % self.n, at / self.n);
            let (u, v) = ((x as f32 + 0.5) * step, (y as f32 + 0.5) * step);
            let (ox, oy) = (dx.data()[at], dy.data()[at]);
            let speck = specks.at(u * fine + ox, v * fine + oy);
            let size = sizes[speck.id];
            let dark = 1.0 - smoothstep(0.6 * size, size.max(1e-3), speck.first);
            let cell = net.at(u * wide + 0.3 * ox, v * wide + 0.3 * oy);
            let crack = 1.0 - smoothstep(0.0, 0.06, cell.second - cell.first);
            *tone -= 0.5 * dark * f32::from(u8::from(size > 0.0)) + stain * crack;
        }
        layers
    }

    /// Parallel scratches over a faint waviness.
    pub(super) fn brushed(&mut self) -> Layers {
        let direction = if self.stream.chance(0.5) {
            0.0
        } else {
            std::f64::consts::FRAC_PI_2
        };
        let scratch = fractal::Fractal {
            length: 0.08 / self.count as f64,
            hurst: 0.5,
            stretch: 60.0,
            direction: direction + 0.03 * (self.stream.unit() - 0.5),
        };
        let (mut height, streaks) = fractal::pair(self.n, scratch, self.stream);
        let waviness = fractal::field(self.n, fractal::Fractal::isotropic(0.15, 1.0), self.stream);
        height.add_scaled(&waviness, 0.6);
        let mut tone = Grid::filled(self.n, 0.5);
        tone.add_scaled(&streaks, 0.16);
        Layers {
            height,
            tone,
            polish: Grid::filled(self.n, 1.0),
        }
    }

    /// A raised motif on a lattice.
    pub(super) fn embossed(&mut self) -> Layers {
        const MOTIFS: [Motif; 6] = [
            Motif::Dots,
            Motif::Squares,
            Motif::Diamonds,
            Motif::Lines,
            Motif::Hexagons,
            Motif::Waves,
        ];
        let motif = MOTIFS[self.stream.index(MOTIFS.len())];
        let fill = self.stream.between(0.22, 0.38) as f32;
        let sharpness = self.stream.between(0.06, 0.3) as f32;
        let count = self.count as f32;
        let (dx, dy) = self.disorder(0.6, 3.0);
        let mut at = 0;
        let height = Grid::from_fn(self.n, |u, v| {
            let (x, y) = (u * count + dx.data()[at], v * count + dy.data()[at]);
            at += 1;
            1.0 - smoothstep(
                fill - sharpness * 0.5,
                fill + sharpness * 0.5,
                motif.distance(x, y),
            )
        });
        let mut tone = Grid::filled(self.n, 0.45);
        tone.add_scaled(&height, 0.2);
        Layers {
            height,
            tone,
            polish: Grid::filled(self.n, 1.0),
        }
    }
}

impl Motif {
    /// Distance from the middle of the nearest motif, in pitches.
    fn distance(self, x: f32, y: f32) -> f32 {
        let centred = |t: f32| t - t.floor() - 0.5;
        match self {
            Self::Dots => hypot(centred(x), centred(y)),
            Self::Squares => centred(x).abs().max(centred(y).abs()),
            Self::Diamonds => 0.7 * (centred(x).abs() + centred(y).abs()),
            Self::Lines => centred(x).abs(),
            Self::Hexagons => {
                let shift = if (y.floor() as i32).rem_euclid(2) == 0 {
                    0.0
                } else {
                    0.5
                };
                hypot(centred(x + shift), centred(y))
            }
            Self::Waves => {
                let bend = centred(0.5 * y).abs() * 2.0;
                centred(x + 0.5 * bend).abs()
            }
        }
    }
}

fn hypot(x: f32, y: f32) -> f32 {
    (x * x + y * y).sqrt()
}
