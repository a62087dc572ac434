//! Deformation under load: a sphere on a viscoelastic layer.

use super::super::numeric;
use super::super::parameters::Parameters;

/// Radius of the fingertip in mm, and its load in N.
const RADIUS_MM: f64 = 7.0;
const LOAD_N: f64 = 1.0;

/// Depths that the instrument does not resolve, in mm.
const FLOOR_MM: f64 = 8e-3;

/// A pressed surface.
pub(super) struct Press {
    /// Depth of the indentation, in mm.
    depth: f64,
    pile: f64,
    loss: f64,
    relaxation: f64,
    creep: f64,
}

impl Press {
    /// Hertz's depth `(9 F^2 / (16 R E*^2))^(1/3)` on a half-space, `E* = E / (1 - 0.3^2)`, held
    /// back by the stage as it nears three quarters of the thickness.
    pub(super) fn of(p: &Parameters) -> Self {
        // N/mm^2 is 1000 kPa.
        let modulus = p.modulus_kpa * 1e-3 / 0.91;
        let cubed = 9.0 * LOAD_N * LOAD_N / (16.0 * RADIUS_MM * modulus * modulus);
        let free = numeric::pow(cubed, 1.0 / 3.0);
        let room = 0.75 * p.thickness_mm;
        Self {
            depth: free * room / (free + room),
            pile: p.relief_mm,
            loss: p.loss,
            relaxation: p.relaxation,
            creep: p.creep,
        }
    }

    /// Logarithm of the depth.
    pub(super) fn compliance(&self) -> f64 {
        numeric::ln(self.depth + FLOOR_MM)
    }

    /// Logarithm of the depth at the scale of the skin: what gives way locally is the body's top
    /// and its pile.
    pub(super) fn local_deformation(&self) -> f64 {
        let give = self.depth / (self.depth + 0.3);
        numeric::ln(numeric::pow(self.depth, 0.8) + 1.2 * self.pile * give + FLOOR_MM)
    }

    /// Logarithm of the energy lost in a press and release, for a standard linear solid.
    pub(super) fn damping(&self) -> f64 {
        numeric::ln(self.depth * self.loss + 0.2 * FLOOR_MM)
    }

    /// Logarithm of the depth-weighted fall of the force at constant depth.
    pub(super) fn relaxation(&self) -> f64 {
        numeric::ln(self.depth * self.relaxation + 0.2 * FLOOR_MM)
    }

    /// Logarithm of the depth that is gained at constant force.
    pub(super) fn yielding(&self) -> f64 {
        numeric::ln(self.depth * self.creep + 0.2 * FLOOR_MM)
    }
}
