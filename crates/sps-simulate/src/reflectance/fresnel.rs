//! Fresnel reflectance.

/// Schlick's approximation (Computer Graphics Forum 13(3), 1994): reflectance at an angle whose
/// cosine is `c`, given that at normal incidence.
pub(crate) fn schlick(f0: f32, c: f32) -> f32 {
    f0 + (1.0 - f0) * grazing(c)
}

/// `(1 - c)^5`.
pub(crate) fn grazing(c: f32) -> f32 {
    let m = (1.0 - c).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// The mean of Schlick's reflectance over the hemisphere, weighted by the cosine.
pub(crate) fn average(f0: f32) -> f32 {
    f0 + (1.0 - f0) / 21.0
}
