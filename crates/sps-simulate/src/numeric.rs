//! Transcendental functions that are the same on every machine.
//!
//! The standard library's `sin`, `exp`, `powf` and so on call the platform's math library, whose
//! last bits differ between machines. These come from the `libm` crate, which is plain arithmetic.
//! Its functions are within one unit in the last place; `sqrt` is exact by IEEE 754.

pub(crate) fn sqrt(x: f64) -> f64 {
    x.sqrt()
}

pub(crate) fn ln(x: f64) -> f64 {
    libm::log(x)
}

pub(crate) fn exp(x: f64) -> f64 {
    libm::exp(x)
}

pub(crate) fn sin(x: f64) -> f64 {
    libm::sin(x)
}

pub(crate) fn cos(x: f64) -> f64 {
    libm::cos(x)
}

pub(crate) fn pow(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}

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
