//! Functions of one number that are the same on every machine.
//!
//! The standard library's `sin`, `exp`, `powf` and so on call the platform's math library, whose
//! last bits differ between machines. Those of the `libm` crate, which is plain arithmetic, are taken
//! throughout; `sqrt` is exact by IEEE 754.

/// The standard normal distribution function.
pub(crate) fn normal_cdf(z: f64) -> f64 {
    0.5 * libm::erfc(-z / std::f64::consts::SQRT_2)
}

/// `a` at `t = 0`, `b` at `t = 1`.
pub(crate) fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// 0 below `lo`, 1 above `hi`, with zero slope at both; `lo < hi`.
pub(crate) fn smoothstep(lo: f32, hi: f32, x: f32) -> f32 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
