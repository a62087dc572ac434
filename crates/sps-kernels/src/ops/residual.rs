//! The end of a residual branch: `activation(norm(x) * gate + shortcut)`, forward and backward.

use super::bands::{Band, Threads, for_each_band};
use super::batch_norm::{FrameSums, Norm};
use super::grid::{Grid, pixel, pixel_mut, pixels, rows, rows_mut};
use super::product::Activation;
use super::simd::{Kernel, Lanes, Level};
use super::words::Real;

/// What is added to the gated branch.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Shortcut<'a, W = f32> {
    /// A feature map as it is, with any border.
    Plain(&'a [W], &'a Grid),
    /// A feature map that is normed first, without a border.
    Normed(&'a [W], &'a Norm),
}

/// A residual branch before its end.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Branch<'a, W = f32> {
    /// Without a border, as `grid` says.
    pub(crate) x: &'a [W],
    pub(crate) norm: &'a Norm,
    /// `(frames, channels)`
    pub(crate) gate: &'a [f32],
    pub(crate) grid: &'a Grid,
    pub(crate) activation: Activation,
}

/// What gives the gradient of `x`: `gradient * of_gradient + (x - mean) * of_x + constant`.
#[derive(Debug, Clone)]
pub(crate) struct FrameSlopes {
    /// `(frames, channels)`
    pub(crate) of_gradient: Vec<f32>,
    /// `(channels)`
    pub(crate) of_x: Vec<f32>,
    /// `(frames, channels)`
    pub(crate) constant: Vec<f32>,
}

impl<W: Real> Branch<'_, W> {
    fn of_frame<'a>(&self, values: &'a [f32], frame: usize) -> &'a [f32] {
        &values[frame * self.grid.channels..(frame + 1) * self.grid.channels]
    }

    /// Writes the branch's end.
    pub(crate) fn end(
        &self,
        level: Level,
        shortcut: Shortcut<'_, W>,
        (target, to): (&mut [W], &Grid),
    ) {
        let places = to.places();
        let added = match shortcut {
            Shortcut::Plain(_, grid) => grid.places(),
            Shortcut::Normed(..) => Vec::new(),
        };
        for_each_frame((target, to), |frame, band| {
            level.run(End {
                norm: self.norm,
                pitch: self.grid.pitch,
                x: &self.x[self.elements(&band)],
                gate: self.of_frame(self.gate, frame),
                shortcut: match shortcut {
                    Shortcut::Plain(x, _) => Added::Plain(x, &added[band.pixels.clone()]),
                    Shortcut::Normed(x, norm) => Added::Normed(&x[self.elements(&band)], norm),
                },
                places: &places[band.pixels],
                origin: band.origin,
                target: band.target,
                limits: self.activation.limits(),
            });
        });
    }

    /// Sets the end's gradient to 0 where the activation let nothing through, and sums it over each
    /// frame, alone and times `x - mean`.
    pub(crate) fn mask(
        &self,
        level: Level,
        (end, from): (&[W], &Grid),
        gradient: &mut [W],
    ) -> FrameSums {
        let places = from.places();
        let pitch = self.grid.pitch;
        FrameSums::of_mut(self.grid, gradient, |range, gradient| {
            level.run(Mask {
                mean: &self.norm.mean,
                pitch,
                x: &self.x[range.clone()],
                end,
                places: &places[range.start / pitch..range.end / pitch],
                limits: self.activation.limits(),
                gradient,
            })
        })
    }

    /// Writes the gradient of `x` from the masked one of the end, which lies as `x` does.
    pub(crate) fn backward(
        &self,
        level: Level,
        slopes: &FrameSlopes,
        gradient: &[W],
        (target, to): (&mut [W], &Grid),
    ) {
        let places = to.places();
        for_each_frame((target, to), |frame, band| {
            let range = self.elements(&band);
            level.run(Backward {
                mean: &self.norm.mean,
                pitch: self.grid.pitch,
                of_gradient: self.of_frame(&slopes.of_gradient, frame),
                of_x: &slopes.of_x,
                constant: self.of_frame(&slopes.constant, frame),
                x: &self.x[range.clone()],
                gradient: &gradient[range],
                places: &places[band.pixels],
                origin: band.origin,
                target: band.target,
            });
        });
    }

    /// The elements of `x` that a band's pixels are.
    fn elements(&self, band: &Band<'_, W>) -> std::ops::Range<usize> {
        band.pixels.start * self.grid.pitch..band.pixels.end * self.grid.pitch
    }
}

/// Calls `work` on parts of frames of `target`: the frame, and its rows and memory.
fn for_each_frame<W: Real>(
    (target, to): (&mut [W], &Grid),
    work: impl Fn(usize, Band<'_, W>) + Send + Sync,
) {
    let per_frame = pixels(to.size);
    for_each_band(Threads::All, to, target, |band| {
        work(band.pixels.start / per_frame, band);
    });
}

/// What is added to some pixels of the branch.
#[derive(Debug, Clone, Copy)]
enum Added<'a, W> {
    /// A feature map, and where each pixel lies in it.
    Plain(&'a [W], &'a [usize]),
    Normed(&'a [W], &'a Norm),
}

struct End<'a, W> {
    norm: &'a Norm,
    pitch: usize,
    x: &'a [W],
    gate: &'a [f32],
    shortcut: Added<'a, W>,
    places: &'a [usize],
    origin: usize,
    target: &'a mut [W],
    limits: [f32; 2],
}

impl<W: Real> Kernel for End<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        let (n, mean, factor, beta) = self.norm.channels();
        let gate = &self.gate[..n];
        let pixels = rows(self.x, self.pitch, n).zip(self.places);
        match self.shortcut {
            Added::Plain(memory, added) => {
                for ((x, place), &added) in pixels.zip(added) {
                    let out = pixel_mut(&mut self.target[place - self.origin..], n);
                    let shortcut = pixel(&memory[added..], n);
                    for c in 0..n {
                        let y = (W::widened(x[c]) - mean[c]) * factor[c] + beta[c];
                        let end = y * gate[c] + W::widened(shortcut[c]);
                        out[c] = W::narrowed(within(self.limits, end));
                    }
                }
            }
            Added::Normed(shortcut, norm) => {
                let (_, m, f, b) = norm.channels();
                let (m, f, b) = (&m[..n], &f[..n], &b[..n]);
                for ((x, place), shortcut) in pixels.zip(rows(shortcut, self.pitch, n)) {
                    let out = pixel_mut(&mut self.target[place - self.origin..], n);
                    for c in 0..n {
                        let y = (W::widened(x[c]) - mean[c]) * factor[c] + beta[c];
                        let z = (W::widened(shortcut[c]) - m[c]) * f[c] + b[c];
                        out[c] = W::narrowed(within(self.limits, y * gate[c] + z));
                    }
                }
            }
        }
    }
}

/// NaN stays NaN.
#[inline(always)]
fn within([least, most]: [f32; 2], x: f32) -> f32 {
    let x = if x < least { least } else { x };
    if x > most { most } else { x }
}

struct Mask<'a, W> {
    mean: &'a [f32],
    pitch: usize,
    x: &'a [W],
    end: &'a [W],
    places: &'a [usize],
    limits: [f32; 2],
    gradient: &'a mut [W],
}

impl<W: Real> Kernel for Mask<'_, W> {
    type Output = [Vec<f32>; 2];

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) -> [Vec<f32>; 2] {
        let n = self.mean.len();
        let mean = &self.mean[..n];
        let mut sums = [vec![0.0_f32; n], vec![0.0_f32; n]];
        let [total, product] = &mut sums;
        let (total, product) = (&mut total[..n], &mut product[..n]);
        let pitch = self.pitch;
        let [least, most] = self.limits;
        let pixels = rows(self.x, pitch, n).zip(self.places);
        for ((x, &place), gradient) in pixels.zip(rows_mut(self.gradient, pitch, n)) {
            let end = pixel(&self.end[place..], n);
            for c in 0..n {
                // Read whether it is kept or not: a read that depends on `end` would keep the
                // compiler from taking several channels at a time.
                let g = W::widened(gradient[c]);
                let end = W::widened(end[c]);
                let g = if end > least && end < most { g } else { 0.0 };
                gradient[c] = W::narrowed(g);
                total[c] += g;
                product[c] += g * (W::widened(x[c]) - mean[c]);
            }
        }
        sums
    }
}

struct Backward<'a, W> {
    mean: &'a [f32],
    pitch: usize,
    of_gradient: &'a [f32],
    of_x: &'a [f32],
    constant: &'a [f32],
    x: &'a [W],
    gradient: &'a [W],
    places: &'a [usize],
    origin: usize,
    target: &'a mut [W],
}

impl<W: Real> Kernel for Backward<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        let n = self.mean.len();
        let (of_gradient, of_x) = (&self.of_gradient[..n], &self.of_x[..n]);
        let constant = &self.constant[..n];
        let pitch = self.pitch;
        let pixels = rows(self.x, pitch, n).zip(rows(self.gradient, pitch, n));
        for ((x, g), &place) in pixels.zip(self.places) {
            let out = pixel_mut(&mut self.target[place - self.origin..], n);
            for c in 0..n {
                let deviation = W::widened(x[c]) - self.mean[c];
                let g = W::widened(g[c]);
                out[c] = W::narrowed(g * of_gradient[c] + deviation * of_x[c] + constant[c]);
            }
        }
    }
}
