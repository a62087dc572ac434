//! Directional albedo of the GGX lobe, under uniform light and under the dome.

use std::sync::LazyLock;

use super::super::numeric::mix;
use super::dome::DOME;

/// Nodes along each axis: the root of alpha, and the root of the cosine.
const ROUGHNESSES: usize = 28;
const COSINES: usize = 64;

/// Quadrature points along each dimension of the visible normals.
const POINTS: usize = 32;

/// Integrals over the lobe, split by Schlick's approximation into a part that scales with the
/// reflectance at normal incidence and a part that does not (Karis, SIGGRAPH courses 2013).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Energy {
    /// Under the dome whose axis is the view direction.
    pub(crate) dome_scale: f32,
    pub(crate) dome_bias: f32,
    /// Under light of unit radiance from everywhere.
    pub(crate) scale: f32,
    pub(crate) bias: f32,
}

/// [`Energy`] over roughness and cosine, and its hemispherical mean over roughness.
pub(crate) struct EnergyTable {
    nodes: Vec<[f32; 4]>,
    means: Vec<[f32; 2]>,
}

/// The instrument's table, integrated once per process (some tens of milliseconds).
pub(crate) fn energy() -> &'static EnergyTable {
    static TABLE: LazyLock<EnergyTable> = LazyLock::new(EnergyTable::integrate);
    &TABLE
}

impl EnergyTable {
    fn integrate() -> Self {
        let mut nodes = Vec::with_capacity(ROUGHNESSES * COSINES);
        for i in 0..ROUGHNESSES {
            let root = i as f64 / (ROUGHNESSES - 1) as f64;
            for j in 0..COSINES {
                let s = (j as f64 / (COSINES - 1) as f64).max(0.01);
                nodes.push(lobe_integrals(root * root, s * s).map(|v| v as f32));
            }
        }
        let rows = nodes.chunks_exact(COSINES);
        let means = rows.map(hemispherical_mean).collect();
        Self { nodes, means }
    }

    /// The integrals at squared roughness `alpha2` and cosine `cosine`, bilinear in the roots.
    #[inline]
    pub(crate) fn at(&self, alpha2: f32, cosine: f32) -> Energy {
        let (i, a) = node(alpha2.max(0.0).sqrt().sqrt(), ROUGHNESSES);
        let (j, b) = node(cosine.max(0.0).sqrt(), COSINES);
        let at = i * COSINES + j;
        let (top, bottom) = (
            &self.nodes[at..at + 2],
            &self.nodes[at + COSINES..at + COSINES + 2],
        );
        let mixed: [f32; 4] = std::array::from_fn(|k| {
            let upper = top[0][k] + (top[1][k] - top[0][k]) * b;
            let lower = bottom[0][k] + (bottom[1][k] - bottom[0][k]) * b;
            upper + (lower - upper) * a
        });
        Energy {
            dome_scale: mixed[0],
            dome_bias: mixed[1],
            scale: mixed[2],
            bias: mixed[3],
        }
    }

    /// The cosine-weighted mean over directions of `(scale, bias)`.
    pub(crate) fn mean(&self, alpha2: f32) -> (f32, f32) {
        let (i, a) = node(alpha2.max(0.0).sqrt().sqrt(), ROUGHNESSES);
        let (low, high) = (self.means[i], self.means[i + 1]);
        (mix(low[0], high[0], a), mix(low[1], high[1], a))
    }
}

/// The node below a place in 0 to 1, and how far beyond it the place lies.
#[inline]
pub(super) fn node(place: f32, count: usize) -> (usize, f32) {
    let last = (count - 1) as f32;
    let scaled = (place * last).clamp(0.0, last);
    let i = (scaled as usize).min(count - 2);
    (i, scaled - i as f32)
}

/// `2 E c dc` over the nodes of one roughness, by trapezoids in the root of the cosine.
fn hemispherical_mean(row: &[[f32; 4]]) -> [f32; 2] {
    let step = 1.0 / (COSINES - 1) as f64;
    let mut sums = [0.0f64; 2];
    for (j, node) in row.iter().enumerate() {
        let root = j as f64 * step;
        let end = if j + 1 == COSINES { 0.5 } else { 1.0 };
        let weight = end * step * 4.0 * root * root * root;
        sums[0] += weight * f64::from(node[2]);
        sums[1] += weight * f64::from(node[3]);
    }
    sums.map(|s| s as f32)
}

/// `[dome scale, dome bias, scale, bias]` for a view at cosine `c`, by a product rule over the
/// normals visible from there (Heitz, JCGT 7(4), 2018).
fn lobe_integrals(alpha: f64, c: f64) -> [f64; 4] {
    let view = [(1.0 - c * c).sqrt(), 0.0, c];
    let mut sums = [0.0; 4];
    for i in 0..POINTS {
        // Denser towards the tail, which is long and may see a brighter part of the dome.
        let left = 1.0 - (i as f64 + 0.5) / POINTS as f64;
        let (u, share) = (1.0 - left * left * left, 3.0 * left * left);
        for j in 0..POINTS {
            // The lobe is symmetric about the plane of incidence: half the azimuth is enough.
            let phi = std::f64::consts::PI * (j as f64 + 0.5) / POINTS as f64;
            let h = visible_normal(alpha, view, u, phi);
            let vh = view[0] * h[0] + view[2] * h[2];
            let light: [f64; 3] = std::array::from_fn(|k| 2.0 * vh * h[k] - view[k]);
            if light[2] <= 0.0 || vh <= 0.0 {
                continue;
            }
            let weight = share * shadowing_given_masking(alpha, light[2], c);
            let m = 1.0 - vh.min(1.0);
            let graze = m * m * m * m * m;
            let axis = view[0] * light[0] + view[2] * light[2];
            let radiance = f64::from(DOME.radiance(axis as f32));
            let (scale, bias) = (weight * (1.0 - graze), weight * graze);
            let terms = [radiance * scale, radiance * bias, scale, bias];
            for (sum, term) in sums.iter_mut().zip(terms) {
                *sum += term;
            }
        }
    }
    sums.map(|s| s / (POINTS * POINTS) as f64)
}

/// The normal at `(u, phi)` of the distribution of normals visible from `view`: a spherical cap
/// around the stretched view (Dupuy and Benyoub, CGF 42(8), 2023). `phi` in 0 to pi is measured
/// from the plane of incidence.
fn visible_normal(alpha: f64, view: [f64; 3], u: f64, phi: f64) -> [f64; 3] {
    let (x, z) = (alpha * view[0], view[2]);
    let length = (x * x + z * z).sqrt();
    let (x, z) = (x / length, z / length);
    let up = 1.0 - u * (1.0 + z);
    let side = (1.0 - up * up).max(0.0).sqrt();
    let cap = [side * libm::cos(phi) + x, side * libm::sin(phi), up + z];
    let h = [alpha * cap[0], alpha * cap[1], cap[2].max(0.0)];
    let norm = (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]).sqrt().max(1e-300);
    h.map(|c| c / norm)
}

/// `G2 / G1` of height-correlated Smith masking.
fn shadowing_given_masking(alpha: f64, nl: f64, nv: f64) -> f64 {
    let lambda = |c: f64| {
        let tan2 = (1.0 - c * c).max(0.0) / (c * c);
        0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
    };
    let (l, v) = (lambda(nl), lambda(nv));
    (1.0 + v) / (1.0 + v + l)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// The dome reflected by a lobe of reflectance `f0`, by a grid of half vectors drawn from the
    /// distribution itself (the table draws from the visible ones).
    fn reflected(alpha: f64, cosine: f64, f0: f64) -> f64 {
        let (steps, turns) = (1200, 120);
        let v = [(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
        let mut sum = 0.0;
        for i in 0..steps {
            // Denser towards the tail.
            let left = 1.0 - (f64::from(i) + 0.5) / f64::from(steps);
            let (u, share) = (1.0 - left * left * left, 3.0 * left * left);
            let slope = alpha * (u / (1.0 - u)).sqrt();
            let hz = 1.0 / (1.0 + slope * slope).sqrt();
            for j in 0..turns {
                let phi = TAU * (f64::from(j) + 0.5) / f64::from(turns);
                let h = [slope * hz * phi.cos(), slope * hz * phi.sin(), hz];
                let vh = v[0] * h[0] + v[2] * h[2];
                let light: [f64; 3] = std::array::from_fn(|k| 2.0 * vh * h[k] - v[k]);
                if vh <= 0.0 || light[2] <= 0.0 {
                    continue;
                }
                let root = |c: f64| (alpha * alpha + (1.0 - alpha * alpha) * c * c).sqrt();
                let nl = light[2];
                let masking = 2.0 * nl * cosine / (nl * root(cosine) + cosine * root(nl));
                let fresnel = f0 + (1.0 - f0) * (1.0 - vh).powi(5);
                let axis: f64 = (0..3).map(|k| v[k] * light[k]).sum();
                let radiance = f64::from(DOME.radiance(axis as f32));
                sum += share * fresnel * masking * radiance * vh / (cosine * hz);
            }
        }
        sum / f64::from(steps * turns)
    }

    #[test]
    fn the_dome_in_the_lobe_agrees_with_quadrature() {
        for alpha in [0.01, 0.045, 0.13, 0.27, 0.52, 0.93] {
            for cosine in [0.22, 0.4, 0.63, 0.81, 0.97] {
                for f0 in [0.04, 0.6, 1.0] {
                    let e = energy().at((alpha * alpha) as f32, cosine as f32);
                    let found = f0 * f64::from(e.dome_scale) + f64::from(e.dome_bias);
                    let expected = reflected(alpha, cosine, f0);
                    let error = (found / expected - 1.0).abs();
                    assert!(
                        error < 0.005,
                        "alpha {alpha}, cosine {cosine}, f0 {f0}: {found} {expected}"
                    );
                }
            }
        }
    }
}
