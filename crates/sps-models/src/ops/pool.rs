//! Max pooling of feature maps, channels last.

use rayon::prelude::*;

use super::bands::{Threads, for_each_band};
use super::grid::{Grid, Size, Window, pixel, pixel_mut};
use super::simd::{Kernel, Lanes, Level};
use super::words::{Real, Word};

/// Writes to each pixel of `target` the largest values under the window.
///
/// The window sees the border of `from`, which must reach as far as the window's padding at the
/// lower ends; where it hangs over the border's upper end, it sees only what there is.
pub(crate) fn max_pool<W: Word>(
    threads: Threads,
    level: Level,
    window: &Window,
    (source, from): (&[W], &Grid),
    (target, to): (&mut [W], &Grid),
) {
    let starts = from.starts(window, to.size);
    let places = to.places();
    for_each_band(threads, to, target, |band| {
        level.run(Pool {
            window,
            source,
            from,
            to,
            starts: &starts[band.pixels.clone()],
            places: &places[band.pixels.clone()],
            first: band.pixels.start,
            target: band.target,
            origin: band.origin,
        });
    });
}

struct Pool<'a, W> {
    window: &'a Window,
    source: &'a [W],
    from: &'a Grid,
    to: &'a Grid,
    starts: &'a [usize],
    places: &'a [usize],
    /// The number of the first pixel.
    first: usize,
    target: &'a mut [W],
    origin: usize,
}

impl<W: Word> Kernel for Pool<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        let words = self.from.words;
        for (i, (&start, &place)) in self.starts.iter().zip(self.places).enumerate() {
            let place = place - self.origin;
            let out = &mut self.target[place..place + words];
            let reach = reach(self.window, self.from, self.to, self.first + i);
            let mut first = true;
            for t in 0..reach[0] {
                for y in 0..reach[1] {
                    for x in 0..reach[2] {
                        let from = start + self.from.index(0, [t, y, x]);
                        let pixel = &self.source[from..from + words];
                        if first {
                            out.copy_from_slice(pixel);
                        } else {
                            W::keep_larger(out, pixel);
                        }
                        first = false;
                    }
                }
            }
        }
    }
}

/// How far the window reaches at a pixel before the border ends.
#[inline(always)]
pub(super) fn reach(window: &Window, from: &Grid, to: &Grid, pixel: usize) -> Size {
    let [time, height, width] = to.size;
    let place = [
        pixel / (height * width) % time,
        pixel / width % height,
        pixel % width,
    ];
    std::array::from_fn(|axis| {
        let start = from.before[axis] - window.before[axis] + place[axis] * window.stride[axis];
        window.size[axis].min(from.extent(axis).saturating_sub(start))
    })
}

/// Writes the gradient of max pooling's input: each window's gradient goes to the first of its
/// largest values. The border of `from` gets its part too. `gradient` lies as `pooled` does, without
/// a border.
pub(crate) fn max_pool_backward<W: Real>(
    level: Level,
    window: &Window,
    (source, from): (&[W], &Grid),
    (pooled, to): (&[W], &Grid),
    gradient: &[W],
    target: &mut [W],
) {
    let one = Grid { frames: 1, ..*to };
    let starts = Grid { frames: 1, ..*from }.starts(window, to.size);
    let places = one.places();
    target
        .par_chunks_exact_mut(from.frame_len())
        .enumerate()
        .for_each(|(frame, target)| {
            let read = frame * from.frame_len()..(frame + 1) * from.frame_len();
            let write = frame * to.frame_len()..(frame + 1) * to.frame_len();
            let len = places.len() * to.pitch;
            level.run(PoolBackward {
                window,
                source: &source[read],
                from,
                pooled: &pooled[write],
                to,
                gradient: &gradient[frame * len..(frame + 1) * len],
                starts: &starts,
                places: &places,
                target,
            });
        });
}

/// One frame.
struct PoolBackward<'a, W> {
    window: &'a Window,
    source: &'a [W],
    from: &'a Grid,
    pooled: &'a [W],
    to: &'a Grid,
    gradient: &'a [W],
    starts: &'a [usize],
    places: &'a [usize],
    target: &'a mut [W],
}

impl<W: Real> Kernel for PoolBackward<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) {
        let channels = self.from.channels;
        let mut left = vec![0.0; channels];
        self.target.fill(W::default());
        for (i, (&start, &place)) in self.starts.iter().zip(self.places).enumerate() {
            let largest = pixel(&self.pooled[place..], channels);
            let own = &self.gradient[i * self.to.pitch..][..self.to.words];
            for (left, own) in left.iter_mut().zip(W::numbers(own)) {
                *left = own;
            }
            let reach = reach(self.window, self.from, self.to, i);
            for t in 0..reach[0] {
                for y in 0..reach[1] {
                    for x in 0..reach[2] {
                        let from = start + self.from.index(0, [t, y, x]);
                        let values = pixel(&self.source[from..], channels);
                        let target = pixel_mut(&mut self.target[from..], channels);
                        give::<W>((values, largest), &mut left, target);
                    }
                }
            }
        }
    }
}

/// Hands what is left of the gradient to the values that are the largest.
#[inline(always)]
fn give<W: Real>(
    (values, largest): (&[W::Number], &[W::Number]),
    left: &mut [f32],
    target: &mut [W::Number],
) {
    let pairs = values.iter().zip(largest);
    for ((value, largest), (left, target)) in pairs.zip(left.iter_mut().zip(target)) {
        let found = value == largest;
        let given = if found { *left } else { 0.0 };
        *target = W::narrowed(W::widened(*target) + given);
        *left = if found { 0.0 } else { *left };
    }
}
