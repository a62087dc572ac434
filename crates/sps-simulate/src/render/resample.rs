//! Averages texels onto a coarser grid.

use super::maps::{CHANNELS, Texel};

/// The mean of `n x n` texels over the areas of `m x m`, `m` at most `n`; returns the new size.
pub(super) fn resample(n: usize, data: Vec<Texel>, m: usize) -> (usize, Vec<Texel>) {
    if m >= n {
        return (n, data);
    }
    let spans = spans(n, m);
    let mut narrow = Vec::with_capacity(n * m);
    for row in data.chunks_exact(n) {
        for span in &spans {
            let mut sum = [0.0; CHANNELS];
            for (texel, &weight) in row[span.start..].iter().zip(&span.weights) {
                accumulate(&mut sum, texel, weight);
            }
            narrow.push(sum);
        }
    }
    let mut out = vec![[0.0; CHANNELS]; m * m];
    for (span, row) in spans.iter().zip(out.chunks_exact_mut(m)) {
        for (k, &weight) in span.weights.iter().enumerate() {
            let source = &narrow[(span.start + k) * m..(span.start + k + 1) * m];
            for (sum, texel) in row.iter_mut().zip(source) {
                accumulate(sum, texel, weight);
            }
        }
    }
    (m, out)
}

#[inline]
fn accumulate(sum: &mut Texel, texel: &Texel, weight: f32) {
    for (s, t) in sum.iter_mut().zip(texel) {
        *s += weight * t;
    }
}

/// The texels that a new texel covers, with the share of each.
struct Span {
    start: usize,
    weights: Vec<f32>,
}

fn spans(n: usize, m: usize) -> Vec<Span> {
    let ratio = n as f64 / m as f64;
    let span = |j: usize| {
        let (lo, hi) = (j as f64 * ratio, (j + 1) as f64 * ratio);
        let start = lo as usize;
        let end = (hi.ceil() as usize).min(n);
        let covered = |i: usize| hi.min((i + 1) as f64) - lo.max(i as f64);
        let weights = (start..end).map(|i| (covered(i) / ratio) as f32);
        Span {
            start,
            weights: weights.collect(),
        }
    };
    (0..m).map(span).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_kept_and_halving_is_a_box() {
        let n = 8;
        let texel = |i| [(i * i % 17) as f32; CHANNELS];
        let data: Vec<Texel> = (0..n * n).map(texel).collect();
        let mean = data.iter().map(|t| t[3]).sum::<f32>() / (n * n) as f32;
        for m in [4, 5, 7] {
            let (_, out) = resample(n, data.clone(), m);
            let found = out.iter().map(|t| t[3]).sum::<f32>() / (m * m) as f32;
            assert!((found - mean).abs() < 1e-4, "{m}: {found} {mean}");
        }
        let (_, half) = resample(n, data.clone(), 4);
        let expected = 0.25 * (data[0][0] + data[1][0] + data[8][0] + data[9][0]);
        assert_eq!(half[0][0], expected);
    }
}
