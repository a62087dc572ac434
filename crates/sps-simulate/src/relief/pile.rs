//! Loops, tufts, hair and matted fibre.

use super::super::grid::Grid;
use super::super::numeric::mix;
use super::cells::Cells;
use super::strokes::{Canvas, Stroke};
use super::{Builder, Layers, fractal};

impl Builder<'_> {
    /// Terry: yarn loops that stand in rough rows and fall over any way.
    pub(super) fn looped(&mut self) -> Layers {
        let pitch = 1.0 / self.count as f32;
        let jitter = 0.6 * (1.0 - self.regularity);
        let mut canvas = Canvas::new(self.n, -0.5, 0.0);
        for layer in 0..3 {
            for k in 0..self.count * self.count {
                let (row, column) = (k / self.count, k % self.count);
                let half = 0.5 * row as f32 + layer as f32 / 3.0;
                let stroke = Stroke {
                    x: (column as f32 + half + jitter * self.signed()) * pitch,
                    y: (row as f32 + layer as f32 / 3.0 + jitter * self.signed()) * pitch,
                    direction: mix(3.0, 0.5, self.regularity) * self.signed() + 1.2,
                    turn: 1.6 * self.signed(),
                    length: pitch * (0.85 + 0.3 * self.signed()),
                    radius: pitch * (0.24 + 0.04 * self.signed()),
                    heights: [-0.5, 0.6 + 0.3 * self.signed(), -0.5],
                    bulge: 0.3,
                    tones: [0.45 + 0.2 * self.signed(), 0.7 + 0.25 * self.signed()],
                };
                canvas.draw(&stroke);
            }
        }
        self.yarn_fuzz(canvas)
    }

    /// Tufts of cut yarn, each a bundle of ends.
    pub(super) fn tufted(&mut self) -> Layers {
        let (n, count) = (self.n, self.count as f32);
        let tufts = Cells::new(self.count, 0.9 - 0.6 * self.regularity, self.stream);
        let ends = Cells::new(self.count * 4, 0.9, self.stream);
        let tuft_tones: Vec<f32> = (0..tufts.len()).map(|_| self.signed()).collect();
        let end_tones: Vec<f32> = (0..ends.len()).map(|_| self.signed()).collect();
        let (dx, dy) = self.disorder(0.35, 1.0);
        let mut tone = Grid::filled(n, 0.0);
        let mut at = 0;
        let height = Grid::from_fn(n, |u, v| {
            let (ox, oy) = (dx.data()[at], dy.data()[at]);
            let tuft = tufts.at(u * count + ox, v * count + oy);
            let end = ends.at(u * count * 4.0 + ox, v * count * 4.0 + oy);
            let dome = 1.0 - tuft.first * tuft.first * 1.6;
            let tip = 1.0 - end.first * end.first;
            tone.data_mut()[at] = 0.5
                + 0.28 * tuft_tones[tuft.id]
                + 0.16 * end_tones[end.id]
                + 0.15 * (dome + tip - 1.0);
            at += 1;
            dome + 0.35 * tip + 0.2 * end_tones[end.id]
        });
        Layers {
            height,
            tone,
            polish: Grid::filled(n, 0.8),
        }
    }

    /// Long hair that lies one way, in locks.
    pub(super) fn haired(&mut self) -> Layers {
        let pitch = 1.0 / self.count as f32;
        let lie = 6.2 * self.stream.unit() as f32;
        let (sway, lift) = self.disorder(1.0, 5.0);
        let mut canvas = Canvas::new(self.n, -1.2, 0.0);
        let (length, radius) = (2.6 * pitch, (0.025 * pitch).clamp(0.0015, 0.003));
        let strokes = (3.2 / (length * 2.0 * radius)) as usize;
        for _ in 0..strokes {
            let (x, y) = (self.stream.unit() as f32, self.stream.unit() as f32);
            let height = 0.5 * lift.sample(x, y) + 0.4 * self.signed();
            let shade = 0.5 + 0.3 * self.signed();
            canvas.draw(&Stroke {
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
        self.finished(canvas)
    }

    /// Fibres matted in all directions.
    pub(super) fn fibrous(&mut self) -> Layers {
        let pitch = 1.0 / self.count as f32;
        let (clump, clouds) = self.disorder(1.0, 3.0);
        let mut canvas = Canvas::new(self.n, -1.2, 0.3);
        let (length, radius) = (2.2 * pitch, 0.06 * pitch);
        let strokes = (2.2 / (length * 2.0 * radius)) as usize;
        for _ in 0..strokes.min(12_000) {
            let (x, y) = (self.stream.unit() as f32, self.stream.unit() as f32);
            let height = 0.6 * clump.sample(x, y) + 0.5 * self.signed();
            let shade = 0.5 + 0.12 * height + 0.06 * clouds.sample(x, y) + 0.2 * self.signed();
            canvas.draw(&Stroke {
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
        self.finished(canvas)
    }

    /// Uniform from -1 to 1.
    fn signed(&mut self) -> f32 {
        2.0 * self.stream.unit() as f32 - 1.0
    }

    /// Adds the fuzz of spun yarn.
    fn yarn_fuzz(&mut self, canvas: Canvas) -> Layers {
        let fine = fractal::Fractal::isotropic(0.05 / self.count as f64, 0.4);
        let fuzz = fractal::field(self.n, fine, self.stream);
        let mut layers = self.finished(canvas);
        layers.height.add_scaled(&fuzz, 0.05);
        layers.tone.add_scaled(&fuzz, 0.06);
        layers
    }

    fn finished(&self, canvas: Canvas) -> Layers {
        Layers {
            height: canvas.height,
            tone: canvas.tone,
            polish: Grid::filled(self.n, 0.8),
        }
    }
}
