//! Passes over the pixels of a map that is normed, forward and backward: with an activation, and with the end of a
//! residual branch, `activation(norm(x) * gate + shortcut)`.

use super::bands::{Band, Threads, for_each_band};
use super::batch_norm::{FrameSums, Norm, Slopes};
use super::grid::{Grid, pixel, pixel_mut, rows, rows_mut};
use super::product::Activation;
use super::simd::Level;
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
        let (places, added) = (&places[..], &added[..]);
        let (pitch, limits) = (from.pitch, activation.limits());
        for_each_band(Threads::All, to, target, |mut band| {
            let range = band.pixels.start * pitch..band.pixels.end * pitch;
            let onto = onto.map(|(gate, shortcut)| {
                let shortcut = match shortcut {
                    Shortcut::Normed(x, norm) => Shortcut::Normed(&x[range.clone()], norm),
                    plain @ Shortcut::Plain(..) => plain,
                };
                (&gate[band.frames.start * from.channels..], shortcut)
            });
            let x = &x[range];
            level.run(
                #[inline(always)]
                move || self.apply_to_band((x, pitch), onto, [places, added], &mut band, limits),
            );
        });
    }

    /// The same for a band, whose pixels of `x` lie `pitch` words apart. `places` has every pixel of the whole target,
    /// `added` every one of a plain shortcut.
    #[inline(always)]
    fn apply_to_band<W: Real>(
        &self,
        (x, pitch): (&[W], usize),
        onto: Option<(&[f32], Shortcut<'_, W>)>,
        [places, added]: [&[usize]; 2],
        band: &mut Band<'_, W>,
        limits: [f32; 2],
    ) {
        let (n, mean, factor, beta) = self.channels();
        let (target, origin, range) = (&mut *band.target, band.origin, band.pixels.clone());
        let pixels = rows(x, pitch, n).zip(&places[range.clone()]);
        match onto {
            None => {
                for (x, &place) in pixels {
                    let out = pixel_mut(&mut target[place - origin..], n);
                    for c in 0..n {
                        let y = (W::widened(x[c]) - mean[c]) * factor[c] + beta[c];
                        out[c] = W::narrowed(within(limits, y));
                    }
                }
            }
            Some((gate, Shortcut::Plain(memory, _))) => {
                let gate = &gate[..n];
                for ((x, place), &added) in pixels.zip(&added[range]) {
                    let out = pixel_mut(&mut target[place - origin..], n);
                    let shortcut = pixel(&memory[added..], n);
                    for c in 0..n {
                        let y = (W::widened(x[c]) - mean[c]) * factor[c] + beta[c];
                        let end = y * gate[c] + W::widened(shortcut[c]);
                        out[c] = W::narrowed(within(limits, end));
                    }
                }
            }
            Some((gate, Shortcut::Normed(shortcut, norm))) => {
                let gate = &gate[..n];
                let (_, m, f, b) = norm.channels();
                let (m, f, b) = (&m[..n], &f[..n], &b[..n]);
                for ((x, place), shortcut) in pixels.zip(rows(shortcut, pitch, n)) {
                    let out = pixel_mut(&mut target[place - origin..], n);
                    for c in 0..n {
                        let y = (W::widened(x[c]) - mean[c]) * factor[c] + beta[c];
                        let z = (W::widened(shortcut[c]) - m[c]) * f[c] + b[c];
                        out[c] = W::narrowed(within(limits, y * gate[c] + z));
                    }
                }
            }
        }
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
        let (pitch, [least, most]) = (grid.pitch, activation.limits());
        FrameSums::of::<W>(grid, &mut [], |range, _| {
            let (x, gradient) = (&x[range.clone()], &gradient[range]);
            level.run(
                #[inline(always)]
                move || {
                    let (n, mean, factor, beta) = self.channels();
                    let mut sums = [vec![0.0_f32; n], vec![0.0_f32; n]];
                    let [total, product] = &mut sums;
                    let (total, product) = (&mut total[..n], &mut product[..n]);
                    for (x, gradient) in rows(x, pitch, n).zip(rows(gradient, pitch, n)) {
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
                },
            )
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
        let (pitch, [least, most]) = (grid.pitch, activation.limits());
        FrameSums::of(grid, gradient, |range, gradient| {
            let places = &places[range.start / pitch..range.end / pitch];
            let x = &x[range];
            level.run(
                #[inline(always)]
                move || {
                    let (n, mean, ..) = self.channels();
                    let mut sums = [vec![0.0_f32; n], vec![0.0_f32; n]];
                    let [total, product] = &mut sums;
                    let (total, product) = (&mut total[..n], &mut product[..n]);
                    let pixels = rows(x, pitch, n).zip(places);
                    for ((x, &place), gradient) in pixels.zip(rows_mut(gradient, pitch, n)) {
                        let end = pixel(&end[place..], n);
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
                },
            )
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
        let (pitch, limits) = (to.pitch, activation.map(Activation::limits));
        for_each_band(Threads::All, to, target, |band| {
            let range = band.pixels.start * pitch..band.pixels.end * pitch;
            let (x, gradient) = (&x[range.clone()], &gradient[range]);
            let (places, frame) = (&places[band.pixels], band.frames.start);
            let (target, origin) = (band.target, band.origin);
            level.run(
                #[inline(always)]
                move || {
                    let (n, mean, factor, beta) = self.channels();
                    let of_gradient = of_frame(&slopes.of_gradient, frame, n);
                    let constant = of_frame(&slopes.constant, frame, n);
                    let of_x = &slopes.of_x[..n];
                    let pixels = rows(x, pitch, n).zip(rows(gradient, pitch, n));
                    for ((x, gradient), &place) in pixels.zip(places) {
                        let out = pixel_mut(&mut target[place - origin..], n);
                        if let Some([least, most]) = limits {
                            for c in 0..n {
                                let deviation = W::widened(x[c]) - mean[c];
                                let y = deviation * factor[c] + beta[c];
                                // Read whether it passes or not, which leaves no branch.
                                let g = W::widened(gradient[c]);
                                let g = if y > least && y < most { g } else { 0.0 };
                                let slope = g * of_gradient[c] + deviation * of_x[c] + constant[c];
                                out[c] = W::narrowed(slope);
                            }
                        } else {
                            for c in 0..n {
                                let deviation = W::widened(x[c]) - mean[c];
                                let g = W::widened(gradient[c]);
                                let slope = g * of_gradient[c] + deviation * of_x[c] + constant[c];
                                out[c] = W::narrowed(slope);
                            }
                        }
                    }
                },
            );
        });
    }
}

/// NaN stays NaN.
#[inline(always)]
fn within([least, most]: [f32; 2], x: f32) -> f32 {
    let x = if x < least { least } else { x };
    if x > most { most } else { x }
}

/// A frame's numbers of `n` channels, of values that are the same in every frame or each frame's own.
#[inline(always)]
fn of_frame(values: &[f32], frame: usize, n: usize) -> &[f32] {
    let own = usize::from(values.len() > n);
    &values[own * frame * n..][..n]
}
