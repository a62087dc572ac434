//! The layered reflectance at one point.

use super::energy::energy;
use super::ggx::{SMALLEST, Spread, schlick, visibility};
use super::sheen::{sheen_lobe, sheen_table};

/// A direction or normal; need not be of unit length.
pub type Vector = [f32; 3];

/// A layered surface: an opaque base (diffuse under a dielectric interface, or a metal) with GGX
/// microfacets, under optional fuzz and an optional clear coat.
///
/// All roughness values are GGX alphas; squared roughness below 1e-8 is taken as 1e-8.
///
/// ```
/// use sps_simulate::Brdf;
///
/// let plaster = Brdf { albedo: [0.8; 3], alpha: [0.6, 0.6], ..Brdf::default() };
/// let [red, _, _] = plaster.eval([0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.3, 0.95]);
/// assert!(red > 0.7 / std::f32::consts::PI && red < 0.9 / std::f32::consts::PI);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brdf {
    /// Diffuse reflectance of a dielectric, or reflectance at normal incidence of a metal.
    pub albedo: [f32; 3],
    /// Whether the base is a metal.
    pub metal: bool,
    /// Reflectance of the dielectric interface at normal incidence.
    pub f0: f32,
    /// Roughness along the tangent and along the bitangent.
    pub alpha: [f32; 2],
    /// Strength of the fuzz; 0 is none.
    pub sheen: f32,
    /// Roughness of a clear coat of reflectance 0.04, if there is one.
    pub coat: Option<f32>,
}

impl Default for Brdf {
    /// A bare dielectric of medium grey and medium roughness.
    fn default() -> Self {
        Self {
            albedo: [0.5; 3],
            metal: false,
            f0: 0.04,
            alpha: [0.4, 0.4],
            sheen: 0.0,
            coat: None,
        }
    }
}

/// Reflectance of a clear coat at normal incidence.
pub(crate) const COAT_F0: f32 = 0.04;

/// Two directions in the tangent frame, above the surface, and what follows from them.
struct Pair {
    light: Vector,
    view: Vector,
    half: Vector,
    /// Cosine between either direction and the half vector.
    lh: f32,
}

impl Brdf {
    /// Reflectance per unit solid angle, in 1/sr, of light from `light` towards `view` off a point
    /// whose normal is `normal`; the tangent is the x axis made orthogonal to the normal.
    ///
    /// Black where either direction is below the surface, and where a vector has no direction
    /// (zero or not finite). Symmetric in the two directions, finite and non-negative everywhere.
    pub fn eval(&self, normal: Vector, light: Vector, view: Vector) -> [f32; 3] {
        Pair::new(normal, light, view).map_or([0.0; 3], |pair| self.eval_pair(&pair))
    }

    fn eval_pair(&self, pair: &Pair) -> [f32; 3] {
        let (nl, nv) = (pair.light[2], pair.view[2]);
        let spread = Spread::along(self.alpha.map(|alpha| (alpha * alpha).max(SMALLEST)));
        let lobe = pair.microfacets(spread);
        let mean_alpha2 = 0.5 * (spread.xx + spread.yy);
        let base = if self.metal {
            self.metal_base(pair, lobe, mean_alpha2)
        } else {
            self.dielectric_base(pair, lobe, mean_alpha2)
        };
        let fuzz = self.sheen * sheen_lobe(nl, nv, pair.half[2]);
        let under_fuzz = if self.sheen > 0.0 {
            let left = |c| (1.0 - self.sheen * sheen_table().at(c).0).max(0.0);
            left(nl) * left(nv)
        } else {
            1.0
        };
        let (coat, under_coat) = self.coat.map_or((0.0, 1.0), |alpha| {
            let a2 = (alpha * alpha).max(SMALLEST);
            let gloss = pair.microfacets(Spread::along([a2; 2]));
            let reflected = |c| {
                let e = energy().at(a2, c);
                COAT_F0 * e.scale + e.bias
            };
            (
                gloss * schlick(COAT_F0, pair.lh),
                (1.0 - reflected(nl)) * (1.0 - reflected(nv)),
            )
        });
        base.map(|b| coat + under_coat * (fuzz + under_fuzz * b))
    }

    /// Single scattering, and the light that bounces between facets (Kulla and Conty, SIGGRAPH
    /// courses 2017).
    fn metal_base(&self, pair: &Pair, lobe: f32, alpha2: f32) -> [f32; 3] {
        let table = energy();
        let lost = |c| {
            let e = table.at(alpha2, c);
            (1.0 - e.scale - e.bias).max(0.0)
        };
        let lost = lost(pair.light[2]) * lost(pair.view[2]);
        let (scale, bias) = table.mean(alpha2);
        let mean = scale + bias;
        let leaving = std::f32::consts::PI * (1.0 - mean).max(1e-4);
        self.albedo
            .map(|f0| lobe * schlick(f0, pair.lh) + multiple_colour(f0, mean) * lost / leaving)
    }

    /// The interface, and diffuse light that crossed it twice.
    fn dielectric_base(&self, pair: &Pair, lobe: f32, alpha2: f32) -> [f32; 3] {
        let (nl, nv) = (pair.light[2], pair.view[2]);
        let table = energy();
        let crossed = |c| {
            let e = table.at(alpha2, c);
            1.0 - self.f0 * e.scale - e.bias
        };
        let (scale, bias) = table.mean(alpha2);
        let diffuse =
            crossed(nl) * crossed(nv) / ((1.0 - self.f0 * scale - bias) * std::f32::consts::PI);
        let gloss = lobe * schlick(self.f0, pair.lh);
        self.albedo.map(|albedo| gloss + albedo * diffuse)
    }
}

/// What is left of light that meets facets of reflectance `f0` until it leaves, where white ones
/// have the mean directional albedo `mean`.
#[inline]
pub(crate) fn multiple_colour(f0: f32, mean: f32) -> f32 {
    // The mean of Schlick's reflectance over the hemisphere, weighted by the cosine.
    let f = f0 + (1.0 - f0) / 21.0;
    f * f * mean / (1.0 - f * (1.0 - mean))
}

impl Pair {
    fn new(normal: Vector, light: Vector, view: Vector) -> Option<Self> {
        let frame = frame(normalised(normal)?);
        let light = normalised(light)?;
        let light = frame.map(|axis| dot(light, axis));
        let view = normalised(view)?;
        let view = frame.map(|axis| dot(view, axis));
        if light[2] <= 0.0 || view[2] <= 0.0 {
            return None;
        }
        let sum: Vector = std::array::from_fn(|i| light[i] + view[i]);
        let half = normalised(sum)?;
        // Half of the sum's length is the cosine, and is symmetric to the last bit.
        let lh = (0.5 * dot(sum, sum).sqrt()).min(1.0);
        Some(Self {
            light,
            view,
            half,
            lh,
        })
    }

    /// `D G / (4 cos cos)` of a centred slope distribution.
    fn microfacets(&self, a: Spread) -> f32 {
        let [hx, hy, hz] = self.half;
        // As `slope_density` over the cosine to the fourth, without a division by the cosine.
        let q = hx * hx / a.xx + hy * hy / a.yy + hz * hz;
        let density = 1.0 / (std::f32::consts::PI * (a.xx * a.yy).sqrt() * q * q);
        let through = |d: Vector| d[0] * d[0] * a.xx + d[1] * d[1] * a.yy;
        let (light, view) = (self.light, self.view);
        density * visibility(light[2], view[2], through(light), through(view))
    }
}

/// The tangent, the bitangent and the normal.
fn frame(normal: Vector) -> [Vector; 3] {
    let [x, y, z] = normal;
    // The x axis without its part along the normal, or the y axis where nothing is left.
    let tangent = normalised([1.0 - x * x, -x * y, -x * z])
        .filter(|_| x.abs() < 0.999)
        .or_else(|| normalised([-y * x, 1.0 - y * y, -y * z]))
        .unwrap_or([0.0, 1.0, 0.0]);
    [tangent, cross(normal, tangent), normal]
}

fn dot(a: Vector, b: Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// `None` for vectors without a direction.
fn normalised(v: Vector) -> Option<Vector> {
    let largest = v.iter().fold(0.0f32, |m, c| m.max(c.abs()));
    if !largest.is_finite() || largest < 1e-30 || v.iter().any(|c| c.is_nan()) {
        return None;
    }
    let scaled = v.map(|c| c / largest);
    let length = dot(scaled, scaled).sqrt();
    Some(scaled.map(|c| c / length))
}
