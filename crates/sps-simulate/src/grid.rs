//! A square periodic map.

use std::ops::Index;

/// `n x n` values on one period of a surface; row `y`, column `x` is `data[y * n + x]`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Grid {
    n: usize,
    data: Vec<f32>,
}

impl Grid {
    pub(crate) fn filled(n: usize, value: f32) -> Self {
        Self {
            n,
            data: vec![value; n * n],
        }
    }

    /// Evaluates `f(x, y)` at each texel's centre, in units of the period (`0..1`).
    pub(crate) fn from_fn(n: usize, mut f: impl FnMut(f32, f32) -> f32) -> Self {
        let step = 1.0 / n as f32;
        let mut data = Vec::with_capacity(n * n);
        for y in 0..n {
            let v = (y as f32 + 0.5) * step;
            data.extend((0..n).map(|x| f((x as f32 + 0.5) * step, v)));
        }
        Self { n, data }
    }

    pub(crate) fn from_data(n: usize, data: Vec<f32>) -> Self {
        debug_assert_eq!(data.len(), n * n);
        Self { n, data }
    }

    pub(crate) fn n(&self) -> usize {
        self.n
    }

    pub(crate) fn data(&self) -> &[f32] {
        &self.data
    }

    pub(crate) fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    pub(crate) fn row(&self, y: usize) -> &[f32] {
        &self.data[y * self.n..(y + 1) * self.n]
    }

    pub(crate) fn map_in_place(&mut self, f: impl Fn(f32) -> f32) {
        for value in &mut self.data {
            *value = f(*value);
        }
    }

    /// Adds `scale * other`, which has the same size.
    pub(crate) fn add_scaled(&mut self, other: &Self, scale: f32) {
        for (value, extra) in self.data.iter_mut().zip(&other.data) {
            *value += scale * extra;
        }
    }

    pub(crate) fn mean(&self) -> f32 {
        (self.data.iter().map(|&v| f64::from(v)).sum::<f64>() / self.data.len() as f64) as f32
    }

    /// Root of the mean square about the mean.
    pub(crate) fn deviation(&self) -> f32 {
        let mean = f64::from(self.mean());
        let squares = self.data.iter().map(|&v| (f64::from(v) - mean).powi(2));
        (squares.sum::<f64>() / self.data.len() as f64).sqrt() as f32
    }

    /// Shifts to mean zero and scales to the given deviation; a constant map becomes zero.
    pub(crate) fn standardise(&mut self, deviation: f32) {
        let mean = self.mean();
        let now = self.deviation();
        let scale = if now > 1e-12 { deviation / now } else { 0.0 };
        self.map_in_place(|v| (v - mean) * scale);
    }

    /// Bilinear value at a place in units of the period; wraps.
    pub(crate) fn sample(&self, u: f32, v: f32) -> f32 {
        let n = self.n as f32;
        let (x, y) = (u * n - 0.5, v * n - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let wrap = |i: f32| (i as i32).rem_euclid(self.n as i32) as usize;
        let (i, j) = (wrap(x0), wrap(y0));
        let i1 = if i + 1 == self.n { 0 } else { i + 1 };
        let j1 = if j + 1 == self.n { 0 } else { j + 1 };
        let (top, bottom) = (self.row(j), self.row(j1));
        let a = top[i] + (top[i1] - top[i]) * fx;
        let b = bottom[i] + (bottom[i1] - bottom[i]) * fx;
        a + (b - a) * fy
    }
}

impl Index<usize> for Grid {
    type Output = f32;

    fn index(&self, at: usize) -> &f32 {
        &self.data[at]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampling_interpolates_and_wraps() {
        let grid = Grid::from_data(2, vec![0.0, 1.0, 2.0, 3.0]);
        assert_eq!(grid.sample(0.25, 0.25), 0.0);
        assert_eq!(grid.sample(0.5, 0.5), 1.5);
        assert_eq!(grid.sample(0.0, 0.25), 0.5);
        assert_eq!(grid.sample(1.25, -0.75), 0.0);
    }

    #[test]
    fn standardising_a_constant_gives_zero() {
        let mut grid = Grid::filled(4, 7.0);
        grid.standardise(1.0);
        assert!(grid.data().iter().all(|&v| v == 0.0));
    }
}
