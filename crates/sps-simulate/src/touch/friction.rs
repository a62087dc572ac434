//! Friction and adhesion of a rubber finger.

use super::super::parameters::Parameters;
use super::texture::Spectrum;

/// Young's modulus of the finger's skin, in kPa, and its loss tangent.
const SKIN_KPA: f64 = 250.0;
const SKIN_LOSS: f64 = 0.15;

/// Mean pressure under the finger, in kPa: 1 N on 1 cm^2.
const PRESSURE_KPA: f64 = 10.0;

/// Shear strength of the contact at a work of adhesion of 40 mJ/m^2, in kPa.
const SHEAR_KPA: f64 = 7.0;

/// Share of the resolved mean square slope that the soft skin does not follow.
const CONFORMED: f64 = 0.8;

/// The contact of skin and surface.
pub(super) struct Contact<'a> {
    surface: &'a Parameters,
    /// Real over apparent area of contact.
    area: f64,
    /// Work of adhesion times tack, relative to a clean surface of 40 mJ/m^2.
    stick: f64,
    /// Root mean square slope of the macrotexture.
    waviness: f64,
    roughness: f64,
}

impl<'a> Contact<'a> {
    /// Persson's contact fraction `erf(sqrt(2) p / (E* h'))`, `h'` the root mean square slope, in
    /// which the unresolved part is what the camera sees as gloss (J. Chem. Phys. 115, 2001).
    pub(super) fn of(p: &'a Parameters, spectrum: &Spectrum) -> Self {
        let (all, large) = spectrum.mean_square_slopes();
        let slope = (CONFORMED * all + p.alpha * p.alpha).sqrt();
        let stiffness = 1.0 / (0.75 / SKIN_KPA + 0.9 / p.modulus_kpa);
        let argument = std::f64::consts::SQRT_2 * PRESSURE_KPA / (stiffness * slope.max(1e-3));
        Self {
            surface: p,
            area: libm::erf(argument),
            stick: p.adhesion / 40.0 * libm::pow(p.tack * p.deposit, 0.3),
            waviness: large.sqrt(),
            roughness: spectrum.micro_roughness(),
        }
    }

    /// Logarithm of the sliding friction: shearing of the contact, hysteresis of skin and body
    /// over the waves, and drag of fibres.
    pub(super) fn sliding(&self) -> f64 {
        let shear = SHEAR_KPA * libm::pow(self.stick, 0.5) * self.area / PRESSURE_KPA;
        let hysteresis = 0.5 * (SKIN_LOSS + self.surface.loss) * self.waviness.min(1.5);
        libm::log(0.06 + shear + hysteresis + 0.1 * self.surface.sheen)
    }

    /// Logarithm of what must be overcome before sliding: a contact that has grown, and skin that
    /// has settled between asperities.
    pub(super) fn stiction(&self) -> f64 {
        let growth = 0.5 + 2.0 * self.surface.relaxation;
        let grown = self.area * libm::pow(self.stick, 0.5) * growth;
        let settled = 0.05 * (self.roughness + 8.5).max(0.0);
        libm::log(0.03 + 0.6 * grown + settled)
    }

    /// Logarithm of the effort to part skin and surface (Fuller and Tabor, Proc. R. Soc. A 345,
    /// 1975: roughness lowers it). Mostly what lies on the surface, which no camera sees.
    pub(super) fn tack(&self) -> f64 {
        let energy = self.surface.adhesion * self.surface.tack;
        0.5 * libm::log(energy)
            + libm::log(self.surface.deposit)
            + 0.25 * libm::log(self.area + 0.05)
    }
}
