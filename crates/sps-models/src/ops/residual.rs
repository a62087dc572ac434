//! The end of a residual branch: `relu(norm(x) * gate + shortcut)`, forward and backward.

use super::bands::{Threads, for_each_band};
use super::batch_norm::{FrameSums, Norm};
use super::grid::{Grid, pixels, rows, rows_mut};
use super::simd::{Kernel, Lanes, Level};

/// What is added to the gated branch.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Shortcut<'a> {
    /// A feature map as it is.
    Plain(&'a [f32]),
    /// A feature map that is normed first.
    Normed(&'a [f32], &'a Norm),
}

/// A residual branch before its end.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Branch<'a> {
    /// Without a border, as `grid` says.
    pub(crate) x: &'a [f32],
    pub(crate) norm: &'a Norm,
    /// `(frames, channels)`
    pub(crate) gate: &'a [f32],
    pub(crate) grid: &'a Grid,
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

impl Branch<'_> {
    fn of_frame<'a>(&self, values: &'a [f32], frame: usize) -> &'a [f32] {
        &values[frame * self.grid.channels..(frame + 1) * self.grid.channels]
    }

    /// Writes the branch's end.
    pub(crate) fn end(&self, level: Level, shortcut: Shortcut<'_>, target: &mut [f32]) {
        self.for_each_frame(target, |frame, range, target| {
            level.run(End {
                norm: self.norm,
                pitch: self.grid.pitch,
                x: &self.x[range.clone()],
                gate: self.of_frame(self.gate, frame),
                shortcut: match shortcut {
                    Shortcut::Plain(x) => Shortcut::Plain(&x[range]),
                    Shortcut::Normed(x, norm) => Shortcut::Normed(&x[range], norm),
                },
                target,
            });
        });
    }

    /// Sets the end's gradient to 0 where the end was rectified, and sums it over each frame,
    /// alone and times `x - mean`.
    pub(crate) fn mask(&self, level: Level, end: &[f32], gradient: &mut [f32]) -> FrameSums {
        FrameSums::of_mut(self.grid, gradient, |range, gradient| {
            level.run(Mask {
                mean: &self.norm.mean,
                pitch: self.grid.pitch,
                x: &self.x[range.clone()],
                end: &end[range],
                gradient,
            })
        })
    }

    /// Writes the gradient of `x` from the masked one of the end.
    pub(crate) fn backward(
        &self,
        level: Level,
        slopes: &FrameSlopes,
        gradient: &[f32],
        target: &mut [f32],
    ) {
        self.for_each_frame(target, |frame, range, target| {
            level.run(Backward {
                mean: &self.norm.mean,
                pitch: self.grid.pitch,
                of_gradient: self.of_frame(&slopes.of_gradient, frame),
                of_x: &slopes.of_x,
                constant: self.of_frame(&slopes.constant, frame),
                x: &self.x[range.clone()],
                gradient: &gradient[range],
                target,
            });
        });
    }

    /// Calls `work` on parts of frames: the frame, the range of elements, and that range of
    /// `target`.
    fn for_each_frame(
        &self,
        target: &mut [f32],
        work: impl Fn(usize, std::ops::Range<usize>, &mut [f32]) + Send + Sync,
    ) {
        let per_frame = pixels(self.grid.size);
        for_each_band(Threads::All, self.grid, target, |band| {
            let start = band.pixels.start * self.grid.pitch;
            let range = start..start + band.target.len();
            work(band.pixels.start / per_frame, range, band.target);
        });
    }
}

struct End<'a> {
    norm: &'a Norm,
    pitch: usize,
    x: &'a [f32],
    gate: &'a [f32],
    shortcut: Shortcut<'a>,
    target: &'a mut [f32],
}

impl Kernel for End<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        let (n, mean, factor, beta) = self.norm.channels();
        let gate = &self.gate[..n];
        let pitch = self.pitch;
        let pixels = rows(self.x, pitch, n).zip(rows_mut(self.target, pitch, n));
        match self.shortcut {
            Shortcut::Plain(shortcut) => {
                for ((x, out), shortcut) in pixels.zip(rows(shortcut, pitch, n)) {
                    for c in 0..n {
                        let y = (x[c] - mean[c]) * factor[c] + beta[c];
                        out[c] = relu(y * gate[c] + shortcut[c]);
                    }
                }
            }
            Shortcut::Normed(shortcut, norm) => {
                let (_, m, f, b) = norm.channels();
                let (m, f, b) = (&m[..n], &f[..n], &b[..n]);
                for ((x, out), shortcut) in pixels.zip(rows(shortcut, pitch, n)) {
                    for c in 0..n {
                        let y = (x[c] - mean[c]) * factor[c] + beta[c];
                        let z = (shortcut[c] - m[c]) * f[c] + b[c];
                        out[c] = relu(y * gate[c] + z);
                    }
                }
            }
        }
    }
}

/// NaN stays NaN.
#[inline(always)]
fn relu(x: f32) -> f32 {
    if x < 0.0 { 0.0 } else { x }
}

struct Mask<'a> {
    mean: &'a [f32],
    pitch: usize,
    x: &'a [f32],
    end: &'a [f32],
    gradient: &'a mut [f32],
}

impl Kernel for Mask<'_> {
    type Output = [Vec<f32>; 2];

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) -> [Vec<f32>; 2] {
        let n = self.mean.len();
        let mean = &self.mean[..n];
        let mut sums = [vec![0.0_f32; n], vec![0.0_f32; n]];
        let [total, product] = &mut sums;
        let (total, product) = (&mut total[..n], &mut product[..n]);
        let pitch = self.pitch;
        let pixels = rows(self.x, pitch, n).zip(rows(self.end, pitch, n));
        for ((x, end), gradient) in pixels.zip(rows_mut(self.gradient, pitch, n)) {
            for c in 0..n {
                // Read whether it is kept or not: a read that depends on `end` would keep the
                // compiler from taking several channels at a time.
                let g = gradient[c];
                let g = if end[c] > 0.0 { g } else { 0.0 };
                gradient[c] = g;
                total[c] += g;
                product[c] += g * (x[c] - mean[c]);
            }
        }
        sums
    }
}

struct Backward<'a> {
    mean: &'a [f32],
    pitch: usize,
    of_gradient: &'a [f32],
    of_x: &'a [f32],
    constant: &'a [f32],
    x: &'a [f32],
    gradient: &'a [f32],
    target: &'a mut [f32],
}

impl Kernel for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        let n = self.mean.len();
        let (of_gradient, of_x) = (&self.of_gradient[..n], &self.of_x[..n]);
        let constant = &self.constant[..n];
        let pitch = self.pitch;
        let pixels = rows(self.x, pitch, n).zip(rows(self.gradient, pitch, n));
        for ((x, g), out) in pixels.zip(rows_mut(self.target, pitch, n)) {
            for c in 0..n {
                out[c] = g[c] * of_gradient[c] + (x[c] - self.mean[c]) * of_x[c] + constant[c];
            }
        }
    }
}
