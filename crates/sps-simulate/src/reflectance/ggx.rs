//! The GGX distribution of microfacet slopes (Walter et al., EGSR 2007), anisotropic and off
//! centre, with Smith's height-correlated masking and shadowing (Heitz, JCGT 3(2), 2014); Fresnel
//! reflectance by Schlick's approximation (Computer Graphics Forum 13(3), 1994).

/// Squared roughness as a symmetric matrix in slope space: alpha squared along each axis and the
/// mixed term.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spread {
    pub(crate) xx: f32,
    pub(crate) yy: f32,
    pub(crate) xy: f32,
}

impl Spread {
    /// Of these squared roughnesses along the axes.
    pub(crate) fn along([xx, yy]: [f32; 2]) -> Self {
        Self { xx, yy, xy: 0.0 }
    }
}

/// The smallest squared roughness; below it the lobe is a mirror to f32.
pub(crate) const SMALLEST: f32 = 1e-8;

/// Density of microfacet slopes at `(dx, dy)` from the mean slope.
#[inline]
pub(crate) fn slope_density(dx: f32, dy: f32, a: Spread) -> f32 {
    let xx = a.xx.max(SMALLEST);
    let yy = a.yy.max(SMALLEST);
    let determinant = (xx * yy - a.xy * a.xy).max(1e-4 * xx * yy);
    let inverse = 1.0 / determinant;
    let t = (dx * dx * yy + dy * dy * xx - 2.0 * dx * dy * a.xy) * inverse;
    let reach = 1.0 + t.max(0.0);
    determinant.sqrt() * inverse / (std::f32::consts::PI * reach * reach)
}

/// Masking and shadowing over `4 cos cos`. `ql` and `qv` are the directions' tangential parts
/// through the spread matrix: `alpha^2 sin^2` where it is isotropic.
#[inline]
pub(crate) fn visibility(nl: f32, nv: f32, ql: f32, qv: f32) -> f32 {
    let denominator = nl * (qv + nv * nv).sqrt() + nv * (ql + nl * nl).sqrt();
    0.5 / denominator.max(1e-7)
}

/// Reflectance at an angle whose cosine is `c`, given that at normal incidence.
pub(crate) fn schlick(f0: f32, c: f32) -> f32 {
    let m = (1.0 - c).clamp(0.0, 1.0);
    let m2 = m * m;
    f0 + (1.0 - f0) * (m2 * m2 * m)
}
