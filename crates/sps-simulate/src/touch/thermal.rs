//! Heat drawn from the warm finger.

use super::super::parameters::Parameters;

/// Thermal effusivity of the finger's skin and of the stage under a thin sample, in
/// J m^-2 K^-1 s^-1/2 (silicone rubber; aluminium under a film of air).
const SKIN: f64 = 620.0;
const STAGE: f64 = 1500.0;

/// Conductivity of the air in the gaps, in W m^-1 K^-1.
const AIR: f64 = 0.026;

/// Share of the relief's height that stays open under the soft skin.
const OPEN: f64 = 0.04;

/// Times of the two readings after contact, in s.
const EARLY_S: f64 = 1.0;
const LATE_S: f64 = 12.0;

/// Diffusivity of everything that is not a metal, in mm^2/s.
const DIFFUSIVITY: f64 = 0.12;

/// Logarithm of the flux soon after contact.
pub(super) fn cooling(p: &Parameters) -> f64 {
    libm::log(flux(p, p.effusivity, EARLY_S))
}

/// Logarithm of the flux that persists. A sample thinner than the heat has reached passes it on
/// to the stage.
pub(super) fn persistence(p: &Parameters) -> f64 {
    let reach = (DIFFUSIVITY * LATE_S).sqrt();
    let through = libm::exp(-p.thickness_mm / reach);
    let behind = p.effusivity + through * 0.25 * STAGE;
    libm::log(flux(p, behind, LATE_S))
}

/// Flux per kelvin between two half-spaces in contact through a thin layer of air: their
/// admittances `e / sqrt(pi t)` and the layer in series.
fn flux(p: &Parameters, effusivity: f64, seconds: f64) -> f64 {
    let admittance = |e: f64| e / (std::f64::consts::PI * seconds).sqrt();
    let gap = p.seating + OPEN * p.relief_mm * 1e-3 / AIR;
    1.0 / (1.0 / admittance(SKIN) + 1.0 / admittance(effusivity) + gap)
}
