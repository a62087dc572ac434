//! An inverse discrete Fourier transform whose bits do not depend on the machine.
//!
//! Fast crates choose their instructions by CPU feature, and with them the order of rounding. This
//! one is radix 2, in f32, with twiddle factors from `libm`.

use super::fractal::unit;

/// A complex number as (real, imaginary).
pub(crate) type Complex = (f32, f32);

/// The transform of one power-of-two length.
pub(crate) struct Fourier {
    n: usize,
    twiddles: Vec<Complex>,
    reversed: Vec<usize>,
}

impl Fourier {
    /// `n` is a power of two, at least 2.
    pub(crate) fn new(n: usize) -> Self {
        debug_assert!(n.is_power_of_two() && n >= 2);
        let step = std::f64::consts::TAU / n as f64;
        let twiddles = (0..n / 2).map(|k| unit(step * k as f64)).collect();
        let shift = usize::BITS - n.trailing_zeros();
        let reversed = (0..n).map(|i| i.reverse_bits() >> shift).collect();
        Self {
            n,
            twiddles,
            reversed,
        }
    }

    /// `out[x] = sum over k of in[k] exp(2 pi i k x / n)`, on rows of `lanes` interleaved signals:
    /// element `k` of signal `s` is `data[k * lanes + s]`.
    fn inverse_lanes(&self, re: &mut [f32], im: &mut [f32], lanes: usize) {
        for i in 0..self.n {
            let j = self.reversed[i];
            if i < j {
                for s in 0..lanes {
                    re.swap(i * lanes + s, j * lanes + s);
                    im.swap(i * lanes + s, j * lanes + s);
                }
            }
        }
        let mut half = 1;
        while half < self.n {
            let stride = self.n / (2 * half);
            for block in (0..self.n).step_by(2 * half) {
                for k in 0..half {
                    let twiddle = self.twiddles[k * stride];
                    let a = (block + k) * lanes;
                    butterfly(re, im, a, a + half * lanes, lanes, twiddle);
                }
            }
            half *= 2;
        }
    }

    /// The two-dimensional inverse transform of `n x n` values, in place.
    pub(crate) fn inverse_2d(&self, re: &mut Vec<f32>, im: &mut Vec<f32>) {
        self.inverse_lanes(re, im, self.n);
        *re = transposed(re, self.n);
        *im = transposed(im, self.n);
        self.inverse_lanes(re, im, self.n);
        *re = transposed(re, self.n);
        *im = transposed(im, self.n);
    }
}

/// One butterfly on `lanes` signals at once; the contiguous lanes are what vectorises.
fn butterfly(re: &mut [f32], im: &mut [f32], a: usize, b: usize, lanes: usize, w: Complex) {
    let (re_a, re_b) = re.split_at_mut(b);
    let (im_a, im_b) = im.split_at_mut(b);
    let (re_a, re_b) = (&mut re_a[a..a + lanes], &mut re_b[..lanes]);
    let (im_a, im_b) = (&mut im_a[a..a + lanes], &mut im_b[..lanes]);
    for s in 0..lanes {
        let (x, y) = (re_b[s], im_b[s]);
        let (tr, ti) = (x * w.0 - y * w.1, x * w.1 + y * w.0);
        re_b[s] = re_a[s] - tr;
        im_b[s] = im_a[s] - ti;
        re_a[s] += tr;
        im_a[s] += ti;
    }
}

fn transposed(data: &[f32], n: usize) -> Vec<f32> {
    const TILE: usize = 16;
    let mut out = vec![0.0; n * n];
    for y0 in (0..n).step_by(TILE) {
        for x0 in (0..n).step_by(TILE) {
            for y in y0..(y0 + TILE).min(n) {
                for x in x0..(x0 + TILE).min(n) {
                    out[x * n + y] = data[y * n + x];
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_sum_by_definition() {
        let n = 8;
        let number = |i| (((i * 7) % 11) as f32 - 5.0, ((i * 5) % 13) as f32 - 6.0);
        let input: Vec<Complex> = (0..n * n).map(number).collect();
        let mut re: Vec<f32> = input.iter().map(|c| c.0).collect();
        let mut im: Vec<f32> = input.iter().map(|c| c.1).collect();
        Fourier::new(n).inverse_2d(&mut re, &mut im);
        for y in 0..n {
            for x in 0..n {
                let (mut sum_re, mut sum_im) = (0.0, 0.0);
                for ky in 0..n {
                    for kx in 0..n {
                        let turn = ((kx * x + ky * y) % n) as f64 / n as f64;
                        let angle = std::f64::consts::TAU * turn;
                        let (a, b) = input[ky * n + kx];
                        let (a, b) = (f64::from(a), f64::from(b));
                        sum_re += a * angle.cos() - b * angle.sin();
                        sum_im += a * angle.sin() + b * angle.cos();
                    }
                }
                assert!((f64::from(re[y * n + x]) - sum_re).abs() < 2e-4);
                assert!((f64::from(im[y * n + x]) - sum_im).abs() < 2e-4);
            }
        }
    }
}
