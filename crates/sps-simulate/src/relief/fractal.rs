//! Random fields with a chosen power spectrum.

use std::sync::LazyLock;

use super::super::grid::Grid;
use super::super::numeric::mix;
use super::super::stream::Stream;
use super::fourier::Fourier;

/// A von Karman spectrum, `S(k) ~ (1 + (l k)^2)^-(h + 1)`: flat above the correlation length `l`,
/// self-affine with Hurst exponent `h` below it (Persson et al., J. Phys. Condens. Matter 17, 2005).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fractal {
    /// Correlation length in units of the period.
    pub(crate) length: f64,
    /// Hurst exponent, 0 to 1: near 1 is smooth, near 0 is jagged.
    pub(crate) hurst: f64,
    /// How many times longer the features are along `direction` than across.
    pub(crate) stretch: f64,
    /// Radians from the x axis.
    pub(crate) direction: f64,
}

impl Fractal {
    pub(crate) const fn isotropic(length: f64, hurst: f64) -> Self {
        Self {
            length,
            hurst,
            stretch: 1.0,
            direction: 0.0,
        }
    }

    /// The same, with features `stretch` times longer along a direction, in radians from the x axis, than across.
    pub(crate) const fn stretched(self, stretch: f64, direction: f64) -> Self {
        Self {
            stretch,
            direction,
            ..self
        }
    }
}

/// Rings of wave vectors that the variance is counted over, whatever the size of the map, so that
/// a finer map of the same surface only adds detail.
const REFERENCE_RINGS: i32 = 127;

/// Two independent fields of mean zero and, up to 127 cycles per period, unit deviation.
///
/// The wave vectors are visited in rings of growing frequency, so a map of another size has the
/// same draws in the rings that both hold.
pub(crate) fn pair(n: usize, fractal: Fractal, stream: &mut Stream) -> (Grid, Grid) {
    let amplitude = Amplitude::new(fractal, n);
    let phases: &[(f32, f32)] = &PHASES;
    let (mut re, mut im) = (vec![0.0; n * n], vec![0.0; n * n]);
    // A power of two, so that a negative wave number wraps by its low bits.
    let low_bits = n as i32 - 1;
    let mut power = 0.0;
    for radius in 1..n as i32 / 2 {
        let counts = radius <= REFERENCE_RINGS;
        amplitude.ring(radius, |kx, ky, size| {
            let (c, s) = phases[(stream.bits() >> 22) as usize];
            let at = (ky & low_bits) as usize * n + (kx & low_bits) as usize;
            re[at] = size * c;
            im[at] = size * s;
            if counts {
                power += f64::from(size * size);
            }
        });
    }
    for radius in n as i32 / 2..=REFERENCE_RINGS {
        amplitude.ring(radius, |_, _, size| {
            power += f64::from(size * size);
        });
    }
    Fourier::new(n).inverse_2d(&mut re, &mut im);
    // Each of the two fields takes half the power of every coefficient and of its mirror image.
    let scale = (1.0 / (0.5 * power).sqrt()) as f32;
    let [re, im] = [re, im].map(|field| {
        let mut grid = Grid::from_data(n, field);
        grid.map_in_place(|value| value * scale);
        grid
    });
    (re, im)
}

/// Unit vectors around the circle.
static PHASES: LazyLock<Vec<(f32, f32)>> = LazyLock::new(|| {
    let angles = (0..1024).map(|i| std::f64::consts::TAU * f64::from(i) / 1024.0);
    angles.map(unit).collect()
});

/// The unit vector at an angle from the x axis.
pub(super) fn unit(angle: f64) -> (f32, f32) {
    (libm::cos(angle) as f32, libm::sin(angle) as f32)
}

/// Entries of the table for each step of the root of the wave number.
const PER_ROOT: f32 = 32.0;

/// The root of the spectrum, tabulated over the root of the stretched wave number: dense where it
/// bends, sparse where it is a power law.
struct Amplitude {
    table: Vec<f32>,
    along: (f32, f32),
    stretch: f32,
}

impl Amplitude {
    fn new(fractal: Fractal, n: usize) -> Self {
        let rings = (n / 2).max(REFERENCE_RINGS as usize + 1);
        let highest = rings as f64 * 1.5 * fractal.stretch.max(1.0);
        let entries = (highest.sqrt() * f64::from(PER_ROOT)) as usize + 2;
        let exponent = -0.5 * (fractal.hurst + 1.0);
        let table = (0..entries)
            .map(|i| {
                let root = i as f64 / f64::from(PER_ROOT);
                let k = std::f64::consts::TAU * root * root * fractal.length;
                libm::pow(1.0 + k * k, exponent) as f32
            })
            .collect();
        Self {
            table,
            along: unit(fractal.direction),
            stretch: fractal.stretch as f32,
        }
    }

    /// Calls `f` with each wave vector whose larger component is `radius`, and its amplitude.
    fn ring(&self, radius: i32, mut f: impl FnMut(i32, i32, f32)) {
        // Opposite wave vectors have the same, so two of the square's four sides tell all.
        let r = radius as f32;
        let (top, right) = (self.edge(radius, |k| (k, r)), self.edge(radius, |k| (r, k)));
        let place = |k: i32| (k + radius) as usize;
        for kx in -radius..=radius {
            f(kx, -radius, top[place(-kx)]);
            f(kx, radius, top[place(kx)]);
        }
        for ky in 1 - radius..radius {
            f(-radius, ky, right[place(-ky)]);
            f(radius, ky, right[place(ky)]);
        }
    }

    /// The amplitudes at the wave vectors `at(-radius)` to `at(radius)`. The roots of a whole edge
    /// are taken in a loop of their own, so that they are taken several at once.
    fn edge(&self, radius: i32, at: impl Fn(f32) -> (f32, f32)) -> Vec<f32> {
        let mut edge: Vec<f32> = (-radius..=radius)
            .map(|k| {
                let (x, y) = at(k as f32);
                let along = (x * self.along.0 + y * self.along.1) * self.stretch;
                let across = y * self.along.0 - x * self.along.1;
                (along * along + across * across).sqrt().sqrt() * PER_ROOT
            })
            .collect();
        for place in &mut edge {
            let i = (*place as usize).min(self.table.len() - 2);
            let t = (*place - i as f32).min(1.0);
            *place = mix(self.table[i], self.table[i + 1], t);
        }
        edge
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::stream::Purpose;
    use super::*;

    #[test]
    fn has_unit_deviation_and_no_mean() {
        let mut stream = Stream::new(3, Purpose::RELIEF, &[0]);
        let (a, b) = pair(256, Fractal::isotropic(0.05, 0.7), &mut stream);
        for grid in [a, b] {
            assert!(grid.mean().abs() < 1e-4);
            let deviation = grid.deviation();
            assert!((deviation - 1.0).abs() < 0.15, "{deviation}");
        }
    }

    #[test]
    fn a_finer_map_only_adds_detail() {
        let draw = |n| {
            let mut stream = Stream::new(3, Purpose::RELIEF, &[1]);
            pair(n, Fractal::isotropic(0.2, 0.9), &mut stream).0
        };
        let (coarse, fine) = (draw(64), draw(128));
        let mut worst = 0.0f32;
        for i in 0..50 {
            let (u, v) = (0.02 * i as f32, 0.013 * i as f32);
            worst = worst.max((coarse.sample(u, v) - fine.sample(u, v)).abs());
        }
        assert!(worst < 0.2, "{worst}");
    }
}
