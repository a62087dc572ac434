//! What pattern a photograph shows, whatever its colours, and how alike patterns are.

use crate::Frame;

/// The shorter side of a photograph whose pattern is described.
pub(crate) const SIDE: usize = 256;

/// The grey image is described as it is and halved up to four times.
const SCALES: usize = 5;

/// Four directions, and along each the slope and the curvature.
const BANDS: usize = SCALES * 4 * 2;

/// Grey values with a standard deviation below one level of 8 bits show no pattern.
const FAINTEST: f64 = 1.0 / 255.0;

/// An energy this far below the largest of its photograph, 60 dB, counts as no lower.
const LOWEST: f64 = 1e-6;

/// The energies of a pattern in decibels, less their mean.
pub(crate) type Pattern = Vec<f64>;

/// Describes the pattern of a photograph by the energies of its grey values' first and second
/// differences in four directions at five scales, in decibels less their mean: neither contrast
/// nor brightness nor hue moves them. `None` where grey values hardly differ.
pub(crate) fn pattern(frame: &Frame) -> Option<Pattern> {
    let mut grey = Grey::of(frame);
    let mut energies = Vec::with_capacity(BANDS);
    if !(FAINTEST..).contains(&grey.deviation()) {
        return None;
    }
    for scale in 0..SCALES {
        if scale > 0 {
            grey = grey.halved();
        }
        for neighbour in [1, grey.width, grey.width + 1, grey.width - 1] {
            energies.extend(grey.energies(neighbour));
        }
    }
    let largest = energies.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let decibels = |energy: f64| 10.0 * (energy / largest).max(LOWEST).log10();
    let decibels: Pattern = energies.into_iter().map(decibels).collect();
    let mean = mean(&decibels);
    Some(decibels.into_iter().map(|band| band - mean).collect())
}

/// The patterns as unit vectors, so that the scalar product of two is how alike they are, from -1 to
/// 1: each less the mean of all, and whitened by the covariance of all, which is shrunk to a
/// multiple of the identity as if as many patterns more as there are bands had shown that.
///
/// `None` where there is no pattern, and where it is the mean.
pub(crate) fn unit_vectors(patterns: Vec<Option<Pattern>>) -> Vec<Option<Vec<f64>>> {
    let found: Vec<&Pattern> = patterns.iter().flatten().collect();
    let count = found.len() as f64;
    let total = |of: &dyn Fn(&Pattern) -> f64| found.iter().map(|pattern| of(pattern)).sum::<f64>();
    let means: Pattern = (0..BANDS).map(|band| total(&|p| p[band]) / count).collect();
    let product = |a: usize, b: usize| total(&|p| (p[a] - means[a]) * (p[b] - means[b]));
    let row = |a: usize| (0..=a).map(|b| product(a, b)).collect();
    let mut factor: Vec<Vec<f64>> = (0..BANDS).map(row).collect();
    let variances = (0..BANDS).map(|band| factor[band][band] / count);
    let shrunk_to = variances.sum::<f64>();
    for (band, row) in factor.iter_mut().enumerate() {
        row[band] += shrunk_to;
    }
    cholesky(&mut factor);
    let unit = |pattern: Pattern| {
        let centred = pattern.iter().zip(&means).map(|(band, mean)| band - mean);
        let mut whitened: Vec<f64> = Vec::with_capacity(BANDS);
        for (value, row) in centred.zip(&factor) {
            let (diagonal, before) = row.split_last()?;
            whitened.push((value - dot(before, &whitened)) / diagonal);
        }
        let length = dot(&whitened, &whitened).sqrt();
        (length > 0.0).then(|| whitened.iter().map(|value| value / length).collect())
    };
    patterns.into_iter().map(|p| p.and_then(unit)).collect()
}

/// The scalar product over the places that both have.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Puts in the place of the lower triangle of a matrix, row by row, that of its Cholesky factor.
fn cholesky(rows: &mut [Vec<f64>]) {
    for at in 0..rows.len() {
        let (above, rest) = rows.split_at_mut(at);
        let row = &mut rest[0];
        for column in 0..at {
            let left = row[column] - dot(&above[column][..column], row);
            row[column] = left / above[column][column];
        }
        row[at] = (row[at] - dot(&row[..at], &row[..at])).sqrt();
    }
}

struct Grey {
    width: usize,
    height: usize,
    values: Vec<f64>,
}

impl Grey {
    /// The luma of Rec. 709.
    fn of(frame: &Frame) -> Self {
        let weights = [0.2126, 0.7152, 0.0722];
        let pixels = frame.data.as_chunks::<3>().0.iter();
        let luma = pixels.map(|rgb| dot(&weights, &rgb.map(f64::from)));
        Self {
            width: frame.width,
            height: frame.height,
            values: luma.collect(),
        }
    }

    fn deviation(&self) -> f64 {
        let mean = mean(&self.values);
        let squares: Vec<f64> = self.values.iter().map(|v| (v - mean).powi(2)).collect();
        self::mean(&squares).sqrt()
    }

    /// The means of squares of two by two; an odd last row or column is left out.
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let pair = |at: usize| self.values[at] + self.values[at + 1];
        let value = |y: usize, x: usize| {
            let at = 2 * y * self.width + 2 * x;
            (pair(at) + pair(at + self.width)) / 4.0
        };
        let values = (0..height).flat_map(|y| (0..width).map(move |x| (y, x)));
        Self {
            width,
            height,
            values: values.map(|(y, x)| value(y, x)).collect(),
        }
    }

    /// The mean squares of the first and the second differences between pixels and their neighbours
    /// `neighbour` values before and behind, over all pixels inside the border.
    fn energies(&self, neighbour: usize) -> [f64; 2] {
        let (mut slope, mut curvature) = (0.0, 0.0);
        for y in 1..self.height - 1 {
            let row = y * self.width;
            for at in row + 1..row + self.width - 1 {
                let (before, behind) = (self.values[at - neighbour], self.values[at + neighbour]);
                slope += (behind - before).powi(2);
                curvature += (2.0 * self.values[at] - before - behind).powi(2);
            }
        }
        let pixels = ((self.width - 2) * (self.height - 2)) as f64;
        [slope / pixels, curvature / pixels]
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    fn frame(rgb: impl Fn(usize, usize) -> [f32; 3]) -> Frame {
        let places = (0..256).flat_map(|y| (0..258).map(move |x| (y, x)));
        Frame {
            width: 258,
            height: 256,
            data: places.flat_map(|(y, x)| rgb(y, x)).collect(),
        }
    }

    /// Waves across, of which 32 fit into the pixels inside the border.
    fn wave(x: usize) -> f32 {
        (TAU * x as f64 / 8.0).sin() as f32
    }

    #[test]
    fn curvature_of_a_wave_stands_to_its_slope_as_in_closed_form() {
        let shown = pattern(&frame(|_, x| [0.5 + 0.2 * wave(x); 3])).unwrap();
        // (2 - 2 cos w)^2 / (2 sin w)^2 = tan^2(w / 2), for w = 2 pi / 8.
        let expected = 20.0 * (TAU / 16.0).tan().log10();
        assert!((shown[1] - shown[0] - expected).abs() < 1e-4, "{shown:?}");
        // Nothing changes down the wave, and both diagonals see what a row sees.
        assert!((shown[2] - shown[3]).abs() < 1e-9 && shown[0] - shown[2] > 50.0);
        assert!((shown[4] - shown[0]).abs() < 1e-4 && (shown[6] - shown[0]).abs() < 1e-4);
    }

    #[test]
    fn brightness_contrast_and_hue_change_nothing() {
        let value = |y: usize, x: usize| wave(x) * wave(3 * y) + 0.3 * wave(2 * x + y);
        let grey = pattern(&frame(|y, x| [0.5 + 0.2 * value(y, x); 3])).unwrap();
        for (mean, contrast) in [
            ([0.2, 0.2, 0.2], [0.05, 0.05, 0.05]),
            ([0.8, 0.4, 0.1], [0.1, 0.2, 0.02]),
            ([0.5, 0.5, 0.5], [-0.2, -0.1, -0.3]),
        ] {
            let coloured = frame(|y, x| [0, 1, 2].map(|c| mean[c] + contrast[c] * value(y, x)));
            let coloured = pattern(&coloured).unwrap();
            let furthest = grey.iter().zip(&coloured).map(|(a, b)| (a - b).abs());
            assert!(furthest.fold(0.0, f64::max) < 1e-3, "{mean:?}");
        }
    }

    #[test]
    fn grey_values_that_hardly_differ_or_are_no_numbers_show_no_pattern() {
        assert_eq!(pattern(&frame(|_, _| [0.4; 3])), None);
        assert_eq!(pattern(&frame(|_, x| [0.4 + 0.005 * wave(x); 3])), None);
        assert!(pattern(&frame(|_, x| [0.4 + 0.006 * wave(x); 3])).is_some());
        assert_eq!(pattern(&frame(|_, x| [f32::NAN * wave(x); 3])), None);
    }

    #[test]
    fn a_cholesky_factor_is_the_textbooks() {
        let mut rows = vec![vec![4.0], vec![12.0, 37.0], vec![-16.0, -43.0, 98.0]];
        cholesky(&mut rows);
        assert_eq!(rows, [vec![2.0], vec![6.0, 1.0], vec![-8.0, 5.0, 3.0]]);
    }
}
