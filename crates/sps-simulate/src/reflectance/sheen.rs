//! The fuzz of fabrics: a lobe of fibres that stand off the surface.
//!
//! Estevez and Kulla, "Production friendly microfacet sheen BRDF", SIGGRAPH courses 2017, with
//! roughness 1/4, for which the distribution is a polynomial: `(3 / pi) sin^4`.

use std::sync::LazyLock;

use super::super::numeric::mix;
use super::dome::DOME;
use super::energy::node;

const NODES: usize = 64;

/// The lobe for unit strength. `nh` is the cosine of the half vector.
#[inline]
pub(crate) fn sheen_lobe(nl: f32, nv: f32, nh: f32) -> f32 {
    let sin2 = (1.0 - nh * nh).max(0.0);
    let spread = 3.0 / std::f32::consts::PI * sin2 * sin2;
    spread / (4.0 * (nl + nv - nl * nv)).max(1e-4)
}

/// Directional albedo of the lobe over the cosine, under uniform light and under the dome.
pub(crate) struct SheenTable {
    nodes: Vec<[f32; 2]>,
    /// The albedo's cosine-weighted mean over directions.
    pub(crate) mean: f32,
}

/// The instrument's table, integrated once per process.
pub(crate) fn sheen_table() -> &'static SheenTable {
    static TABLE: LazyLock<SheenTable> = LazyLock::new(SheenTable::integrate);
    &TABLE
}

impl SheenTable {
    fn integrate() -> Self {
        let integrals = |i| lobe_integrals(i as f64 / (NODES - 1) as f64).map(|v| v as f32);
        let nodes: Vec<[f32; 2]> = (0..NODES).map(integrals).collect();
        let step = 1.0 / (NODES - 1) as f32;
        let terms = nodes.iter().enumerate();
        let terms = terms.map(|(i, [albedo, _])| 2.0 * step * step * i as f32 * albedo);
        let mean = terms.sum();
        Self { nodes, mean }
    }

    /// `(albedo, under the dome)` at a cosine, linear between nodes.
    #[inline]
    pub(crate) fn at(&self, cosine: f32) -> (f32, f32) {
        let (i, t) = node(cosine, NODES);
        let (low, high) = (self.nodes[i], self.nodes[i + 1]);
        (mix(low[0], high[0], t), mix(low[1], high[1], t))
    }
}

fn lobe_integrals(c: f64) -> [f64; 2] {
    const STEPS: usize = 48;
    let view = [(1.0 - c * c).sqrt(), 0.0, c];
    let mut sums = [0.0; 2];
    for i in 0..STEPS {
        let z = (i as f64 + 0.5) / STEPS as f64;
        let s = (1.0 - z * z).sqrt();
        for j in 0..STEPS {
            let phi = std::f64::consts::PI * (j as f64 + 0.5) / STEPS as f64;
            let light = [s * libm::cos(phi), s * libm::sin(phi), z];
            let axis = view[0] * light[0] + view[2] * light[2];
            let half = (2.0 + 2.0 * axis).max(1e-12).sqrt();
            let nh = ((light[2] + view[2]) / half).min(1.0);
            let value = f64::from(sheen_lobe(z as f32, c as f32, nh as f32)) * z;
            sums[0] += value;
            sums[1] += value * f64::from(DOME.radiance(axis as f32));
        }
    }
    sums.map(|v| v * std::f64::consts::TAU / (STEPS * STEPS) as f64)
}
