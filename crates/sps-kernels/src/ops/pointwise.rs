//! Passes over the pixels of a map that is normed, forward and backward: with an activation, and with the end of a
//! residual branch, `activation(norm(x) * gate + shortcut)`.

use super::bands::{Band, Threads, for_each_band};
use super::batch_norm::{FrameSums, Norm, Slopes};
use super::grid::{Grid, pixel, pixel_mut, rows, rows_mut};
use super::product::Activation;
use super::simd::{Kernel, Lanes, Level};
use super::words::Real;

/// What is added to a gated branch.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Shortcut<'a, W = f32> {
    /// A feature map as it is, with any border.
    Plain(&'a [W], &'a Grid),
    /// A feature map that is normed first, without a border.
    Normed(&'a [W], &'a Norm),
}

impl Norm {
    /// Writes `y`, activated, from `x`, which has no border, into channels that the target begins
    /// with: first multiplied with a gate, `(frames, channels)`, and added to a shortcut where there is one.
    pub(crate) fn apply<W: Real>(
        &self,
        level: Level,
        (x, from): (&[W], &Grid),
        onto: Option<(&[f32], Shortcut<'_, W>)>,
        (target, to): (&mut [W], &Grid),
        activation: Activation,
    ) {
        let places = to.places();
        let added = match onto {
            Some((_, Shortcut::Plain(_, grid))) => grid.places(),
            _ => Vec::new(),
        };
        for_each_band(Threads::All, to, target, |band| {
            let range = band.pixels.start * from.pitch..band.pixels.end * from.pitch;
            let onto = onto.map(|(gate, shortcut)| {
                let shortcut = match shortcut {
                    Shortcut::Normed(x, norm) => Shortcut::Normed(&x[range.clone()], norm),
                    plain @ Shortcut::Plain(..) => plain,
                };
                (&gate[band.frames.start * from.channels..], shortcut)
            });
            level.run(Apply {
                norm: self,
                pitch: from.pitch,
                x: &x[range],
                onto,
                added: &added,
                places: &places,
                band,
                limits: activation.limits(),
            });
        });
    }

    /// Sums over each frame, from which every gradient follows: see [`FrameSums`].
    ///
    /// The output was activated so.
    pub(crate) fn sums<W: Real>(
        &self,
        level: Level,
        x: &[W],
        gradient: &[W],
        grid: &Grid,
        activation: Activation,
    ) -> FrameSums {
        FrameSums::of::<W>(grid, &mut [], |range, _| {
            level.run(Sums {
                norm: self,
                pitch: grid.pitch,
                x: &x[range.clone()],
                gradient: &gradient[range],
                limits: activation.limits(),
            })
        })
    }

    /// Sets the gradient of a branch's end to 0 where the activation let nothing through, and sums it over each
    /// frame, alone and times `x - mean`.
    pub(crate) fn mask<W: Real>(
        &self,
        level: Level,
        (x, grid): (&[W], &Grid),
        (end, from): (&[W], &Grid),
        gradient: &mut [W],
        activation: Activation,
    ) -> FrameSums {
        let places = from.places();
        let pitch = grid.pitch;
        FrameSums::of(grid, gradient, |range, gradient| {
            level.run(Mask {
                mean: &self.mean,
                pitch,
                x: &x[range.clone()],
                end,
                places: &places[range.start / pitch..range.end / pitch],
                limits: activation.limits(),
                gradient,
            })
        })
    }

    /// The gradient of `x` from that of `y` by `slopes`; both lie as the target does but have no
    /// border. The target's stays as it is. `activation`: what `y` went through, but where the gradient is
    /// [masked](Self::mask).
    pub(crate) fn backward<W: Real>(
        &self,
        level: Level,
        slopes: &Slopes,
        [x, gradient]: [&[W]; 2],
        (target, to): (&mut [W], &Grid),
        activation: Option<Activation>,
    ) {
        let places = to.places();
        let channels = self.mean.len();
        for_each_band(Threads::All, to, target, |band| {
            let range = band.pixels.start * to.pitch..band.pixels.end * to.pitch;
            let of_frame = |values: &[f32]| {
                // The same in every frame, or each frame's own.
                let own = usize::from(values.len() > channels);
                own * band.frames.start * channels
            };
            level.run(Backward {
                norm: self,
                pitch: to.pitch,
                of_gradient: &slopes.of_gradient[of_frame(&slopes.of_gradient)..],
                of_x: &slopes.of_x,
                constant: &slopes.constant[of_frame(&slopes.constant)..],
                x: &x[range.clone()],
                gradient: &gradient[range],
                places: &places,
                band,
                limits: activation.map(Activation::limits),
            });
        });
    }
}

struct Apply<'a, 'b, W> {
    norm: &'a Norm,
    pitch: usize,
    x: &'a [W],
    onto: Option<(&'a [f32], Shortcut<'a, W>)>,
    /// Where each pixel of all of a plain shortcut lies.
    added: &'a [usize],
    /// Where each pixel of the whole target lies.
    places: &'a [usize],
    band: Band<'b, W>,
    limits: [f32; 2],
}

impl<W: Real> Kernel for Apply<'_, '_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        let (n, mean, factor, beta) = self.norm.channels();
        let (target, origin, range) = (self.band.target, self.band.origin, self.band.pixels);
        let pixels = rows(self.x, self.pitch, n).zip(&self.places[range.clone()]);
        match self.onto {
            None => {
                for (x, &place) in pixels {
                    let out = pixel_mut(&mut target[place - origin..], n);
                    for c in 0..n {
                        let y = (W::widened(x[c]) - mean[c]) * factor[c] + beta[c];
                        out[c] = W::narrowed(within(self.limits, y));
                    }
                }
            }
            Some((gate, Shortcut::Plain(memory, _))) => {
                let gate = &gate[..n];
                for ((x, place), &added) in pixels.zip(&self.added[range]) {
                    let out = pixel_mut(&mut target[place - origin..], n);
                    let shortcut = pixel(&memory[added..], n);
                    for c in 0..n {
                        let y = (W::widened(x[c]) - mean[c]) * factor[c] + beta[c];
                        let end = y * gate[c] + W::widened(shortcut[c]);
                        out[c] = W::narrowed(within(self.limits, end));
                    }
                }
            }
            Some((gate, Shortcut::Normed(shortcut, norm))) => {
                let gate = &gate[..n];
                let (_, m, f, b) = norm.channels();
                let (m, f, b) = (&m[..n], &f[..n], &b[..n]);
                for ((x, place), shortcut) in pixels.zip(rows(shortcut, self.pitch, n)) {
                    let out = pixel_mut(&mut target[place - origin..], n);
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

struct Sums<'a, W> {
    norm: &'a Norm,
    pitch: usize,
    x: &'a [W],
    gradient: &'a [W],
    limits: [f32; 2],
}

impl<W: Real> Kernel for Sums<'_, W> {
    type Output = [Vec<f32>; 2];

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) -> [Vec<f32>; 2] {
        let (n, mean, factor, beta) = self.norm.channels();
        let [least, most] = self.limits;
        let mut sums = [vec![0.0_f32; n], vec![0.0_f32; n]];
        let [total, product] = &mut sums;
        let (total, product) = (&mut total[..n], &mut product[..n]);
        let pixels = rows(self.x, self.pitch, n);
        for (x, gradient) in pixels.zip(rows(self.gradient, self.pitch, n)) {
            for c in 0..n {
                let deviation = W::widened(x[c]) - mean[c];
                let y = deviation * factor[c] + beta[c];
                // Read whether it passes or not, which leaves no branch.
                let g = W::widened(gradient[c]);
                let g = if y > least && y < most { g } else { 0.0 };
                total[c] += g;
                product[c] += g * deviation;
            }
        }
        sums
    }
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

struct Backward<'a, 'b, W> {
    norm: &'a Norm,
    pitch: usize,
    of_gradient: &'a [f32],
    of_x: &'a [f32],
    constant: &'a [f32],
    x: &'a [W],
    gradient: &'a [W],
    /// Where each pixel of the whole target lies.
    places: &'a [usize],
    band: Band<'b, W>,
    limits: Option<[f32; 2]>,
}

impl<W: Real> Kernel for Backward<'_, '_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        let (n, mean, factor, beta) = self.norm.channels();
        let (of_gradient, of_x) = (&self.of_gradient[..n], &self.of_x[..n]);
        let constant = &self.constant[..n];
        let Band { target, origin, .. } = self.band;
        let pixels = rows(self.x, self.pitch, n).zip(rows(self.gradient, self.pitch, n));
        for ((x, gradient), &place) in pixels.zip(&self.places[self.band.pixels]) {
            let out = pixel_mut(&mut target[place - origin..], n);
            if let Some([least, most]) = self.limits {
                for c in 0..n {
                    let deviation = W::widened(x[c]) - mean[c];
                    let y = deviation * factor[c] + beta[c];
                    // Read whether it passes or not, which leaves no branch.
                    let g = W::widened(gradient[c]);
                    let g = if y > least && y < most { g } else { 0.0 };
                    out[c] = W::narrowed(g * of_gradient[c] + deviation * of_x[c] + constant[c]);
                }
            } else {
                for c in 0..n {
                    let deviation = W::widened(x[c]) - mean[c];
                    let g = W::widened(gradient[c]);
                    out[c] = W::narrowed(g * of_gradient[c] + deviation * of_x[c] + constant[c]);
                }
            }
        }
    }
}
