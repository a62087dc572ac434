//! Loops, tufts, hair and matted fibre.

use super::super::grid::Grid;
use super::super::numeric::mix;
use super::cells::Cells;
use super::strokes::Stroke;
use super::{Builder, Fractal, Layers};

impl Builder<'_> {
    /// Terry: yarn loops that stand in rough rows and fall over any way.
    pub(super) fn looped(&mut self) -> Layers {
        let pitch = 1.0 / self.count as f32;
        let jitter = 0.6 * (1.0 - self.regularity);
        let mut layers = self.ground(-0.5, 0.0);
        for layer in 0..3 {
            for k in 0..self.count * self.count {
                let (row, column) = (k / self.count, k % self.count);
                let half = 0.5 * row as f32 + layer as f32 / 3.0;
                layers.draw(&Stroke {
                    x: (column as f32 + half + jitter * self.signed()) * pitch,
                    y: (row as f32 + layer as f32 / 3.0 + jitter * self.signed()) * pitch,
                    direction: mix(3.0, 0.5, self.regularity) * self.signed() + 1.2,
                    turn: 1.6 * self.signed(),
                    length: pitch * (0.85 + 0.3 * self.signed()),
                    radius: pitch * (0.24 + 0.04 * self.signed()),
                    heights: [-0.5, 0.6 + 0.3 * self.signed(), -0.5],
                    bulge: 0.3,
                    tones: [0.45 + 0.2 * self.signed(), 0.7 + 0.25 * self.signed()],
                });
            }
        }
        // The fuzz of spun yarn.
        let fuzz = Fractal::isotropic(0.05 / self.count as f64, 0.4);
        let fuzz = self.fields(fuzz).0;
        layers.height.add_scaled(&fuzz, 0.05);
        layers.tone.add_scaled(&fuzz, 0.06);
        layers
    }

    /// Tufts of cut yarn, each a bundle of ends.
    pub(super) fn tufted(&mut self) -> Layers {
        let count = self.count as f32;
        let tufts = Cells::new(self.count, 0.9 - 0.6 * self.regularity, self.stream);
        let ends = Cells::new(self.count * 4, 0.9, self.stream);
        let tuft_tones: Vec<f32> = (0..tufts.len()).map(|_| self.signed()).collect();
        let end_tones: Vec<f32> = (0..ends.len()).map(|_| self.signed()).collect();
        let (dx, dy) = self.disorder(0.35, 1.0);
        Layers::of_texels(self.n, |at, u, v| {
            let (ox, oy) = (dx[at], dy[at]);
            let tuft = tufts.at(u * count + ox, v * count + oy);
            let end = ends.at(u * count * 4.0 + ox, v * count * 4.0 + oy);
            let dome = 1.0 - tuft.first * tuft.first * 1.6;
            let tip = 1.0 - end.first * end.first;
            let tone = 0.5
                + 0.28 * tuft_tones[tuft.id]
                + 0.16 * end_tones[end.id]
                + 0.15 * (dome + tip - 1.0);
            (dome + 0.35 * tip + 0.2 * end_tones[end.id], tone, 0.8)
        })
    }

    /// Long hair that lies one way, in locks.
    pub(super) fn haired(&mut self) -> Layers {
        let pitch = 1.0 / self.count as f32;
        let lie = 6.2 * self.stream.unit() as f32;
        let (sway, lift) = self.disorder(1.0, 5.0);
        let mut layers = self.ground(-1.2, 0.0);
        let (length, radius) = (2.6 * pitch, (0.025 * pitch).clamp(0.0015, 0.003));
        let strokes = (3.2 / (length * 2.0 * radius)) as usize;
        for _ in 0..strokes {
            let (x, y) = (self.stream.unit() as f32, self.stream.unit() as f32);
            let height = 0.5 * lift.sample(x, y) + 0.4 * self.signed();
            let shade = 0.5 + 0.3 * self.signed();
            layers.draw(&Stroke {
                x,
                y,
                direction: lie + 0.4 * sway.sample(x, y) + 0.12 * self.signed(),
                turn: 0.4 * self.signed(),
                length: length * (1.0 + 0.5 * self.signed()),
                radius,
                heights: [height - 1.0, height + 0.1, height],
                bulge: 0.12,
                tones: [shade - 0.3, shade + 0.15],
            });
        }
        layers
    }

    /// Fibres matted in all directions.
    pub(super) fn fibrous(&mut self) -> Layers {
        let pitch = 1.0 / self.count as f32;
        let (clump, clouds) = self.disorder(1.0, 3.0);
        let mut layers = self.ground(-1.2, 0.3);
        let (length, radius) = (2.2 * pitch, 0.06 * pitch);
        let strokes = (2.2 / (length * 2.0 * radius)) as usize;
        for _ in 0..strokes.min(12_000) {
            let (x, y) = (self.stream.unit() as f32, self.stream.unit() as f32);
            let height = 0.6 * clump.sample(x, y) + 0.5 * self.signed();
            let shade = 0.5 + 0.12 * height + 0.06 * clouds.sample(x, y) + 0.2 * self.signed();
            layers.draw(&Stroke {
                x,
                y,
                direction: 3.2 * self.signed(),
                turn: 2.2 * self.signed(),
                length: length * (1.0 + 0.5 * self.signed()),
                radius: radius * (1.0 + 0.4 * self.signed()),
                heights: [height - 0.3, height, height - 0.3],
                bulge: 0.3,
                tones: [shade, shade],
            });
        }
        layers
    }

    /// What strokes are drawn on, of this height and tone.
    fn ground(&self, height: f32, tone: f32) -> Layers {
        let [height, tone] = [height, tone].map(|value| Grid::filled(self.n, value));
        Layers::new(height, tone, 0.8)
    }
}
