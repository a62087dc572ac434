//! Deformation under load: a sphere on a viscoelastic layer.

use super::super::parameters::Parameters;

/// Radius of the fingertip in mm, and its load in N.
const RADIUS_MM: f64 = 7.0;
const LOAD_N: f64 = 1.0;

/// Depths that the instrument does not resolve, in mm.
const FLOOR_MM: f64 = 8e-3;

/// Hertz's depth of the indentation, in mm, `(9 F^2 / (16 R E*^2))^(1/3)` on a half-space,
/// `E* = E / (1 - 0.3^2)`, held back by the stage as it nears three quarters of the thickness.
pub(super) fn depth(p: &Parameters) -> f64 {
    // N/mm^2 is 1000 kPa.
    let modulus = p.modulus_kpa * 1e-3 / 0.91;
    let cubed = 9.0 * LOAD_N * LOAD_N / (16.0 * RADIUS_MM * modulus * modulus);
    let free = libm::pow(cubed, 1.0 / 3.0);
    let room = 0.75 * p.thickness_mm;
    free * room / (free + room)
}

/// Logarithm of the depth.
pub(super) fn compliance(depth: f64) -> f64 {
    libm::log(depth + FLOOR_MM)
}

/// Logarithm of the depth at the scale of the skin: what gives way locally is the body's top and its
/// pile.
pub(super) fn local_deformation(depth: f64, pile: f64) -> f64 {
    let give = depth / (depth + 0.3);
    libm::log(libm::pow(depth, 0.8) + 1.2 * pile * give + FLOOR_MM)
}

/// Logarithm of a share of the depth.
pub(super) fn log_share(depth: f64, share: f64) -> f64 {
    libm::log(depth * share + 0.2 * FLOOR_MM)
}
