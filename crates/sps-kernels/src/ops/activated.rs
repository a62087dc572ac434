//! The way back through an activation.

use sps_base::parallel;

use super::bands::{Band, bands};
use super::grid::{Grid, pixel, pixel_mut};
use super::product::Activation;
use super::simd::Level;
use super::words::Real;

/// Parts of a frame, each with a sum of its own: as many however many threads there are.
const PARTS: usize = 8;

/// Writes the gradient of what was activated into `target`, which keeps its border, from that of the activated
/// numbers; returns its sums, `(channels)`, taken in f32 along each row and joined in f64.
///
/// The numbers and their gradient begin with the channels that the target has; the gradient lies as they do, but
/// without a border.
pub(crate) fn activation_gradient<W: Real>(
    level: Level,
    activation: Activation,
    (numbers, from): (&[W], &Grid),
    gradient: &[W],
    (target, to): (&mut [W], &Grid),
) -> Vec<f64> {
    let ([least, most], n) = (activation.limits(), to.channels);
    let back = |band: Band<'_, W>| {
        level.run(
            #[inline(always)]
            move || {
                let (mut sums, mut of_row) = (vec![0.0_f64; n], vec![0.0_f32; n]);
                let rows = band.rows(to);
                let width = to.size[2].max(1);
                let (sources, places) = (from.places_of(rows.clone()), to.places_of(rows));
                for (number, (&source, &place)) in
                    band.pixels.clone().zip(sources.iter().zip(&places))
                {
                    let y = pixel(&numbers[source..], n);
                    let gradient = pixel(&gradient[number * from.pitch..], n);
                    let out = pixel_mut(&mut band.target[place - band.origin..], n);
                    let of_row = &mut of_row[..n];
                    for c in 0..n {
                        let y = W::widened(y[c]);
                        // Read whether it passes or not, which leaves no branch.
                        let g = W::widened(gradient[c]);
                        let g = if y > least && y < most { g } else { 0.0 };
                        out[c] = W::narrowed(g);
                        of_row[c] += g;
                    }
                    if (number + 1).is_multiple_of(width) {
                        for (sum, of_row) in sums.iter_mut().zip(of_row) {
                            *sum += f64::from(*of_row);
                            *of_row = 0.0;
                        }
                    }
                }
                sums
            },
        )
    };
    let mut sums = vec![0.0; to.channels];
    for part in parallel::map(bands(PARTS, 1, to, target), back) {
        for (sum, part) in sums.iter_mut().zip(part) {
            *sum += part;
        }
    }
    sums
}
