//! The physical parameters of one surface.

use super::latent::{Latent, Scores};
use super::material::{Material, Profile, material_of};
use super::stream::{Purpose, Stream};

/// Everything physical about one surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// The ranges that they were drawn from.
    pub(crate) profile: &'static Profile,
    /// Pitch of the structure, in mm.
    pub period_mm: f64,
    /// Root mean square height of the structure, in mm.
    pub relief_mm: f64,
    /// 0 is disordered, 1 is a perfect lattice.
    pub regularity: f64,
    /// Root mean square of the microrelief, in micrometres.
    pub micro_um: f64,
    /// Correlation length of the microrelief, in mm.
    pub micro_length_mm: f64,
    /// GGX roughness (alpha).
    pub alpha: f64,
    /// Strength of the fuzz lobe.
    pub sheen: f64,
    /// Indentation modulus, in kPa.
    pub modulus_kpa: f64,
    /// Loss tangent.
    pub loss: f64,
    /// Share of the stress that relaxes.
    pub relaxation: f64,
    /// Creep strain over elastic strain.
    pub creep: f64,
    /// Thickness, in mm.
    pub thickness_mm: f64,
    /// Thermal effusivity, in J m^-2 K^-1 s^-1/2.
    pub effusivity: f64,
    /// Work of adhesion, in mJ/m^2.
    pub adhesion: f64,
    /// Tackiness relative to a clean surface.
    pub tack: f64,
    /// Factor on adhesion of what lies on the surface, log-normal with a deviation of 0.9.
    pub deposit: f64,
    /// Thermal resistance of the contact, in m^2 K/W, log-normal with a deviation of 1.3.
    pub seating: f64,
}

impl Parameters {
    /// The parameters at the given scores.
    pub(crate) fn at(profile: &'static Profile, scores: &Scores) -> Self {
        let at = |latent: Latent| profile.ranges[latent as usize].at(scores.of(latent));
        Self {
            profile,
            period_mm: at(Latent::Period),
            relief_mm: at(Latent::Relief),
            regularity: at(Latent::Regularity),
            micro_um: at(Latent::Microrelief),
            micro_length_mm: at(Latent::Microlength),
            alpha: at(Latent::Gloss),
            sheen: at(Latent::Fuzz),
            modulus_kpa: at(Latent::Stiffness),
            loss: at(Latent::Damping),
            relaxation: at(Latent::Relaxation),
            creep: at(Latent::Creep),
            thickness_mm: at(Latent::Thickness),
            effusivity: at(Latent::Effusivity),
            adhesion: at(Latent::Adhesion),
            tack: at(Latent::Tack),
            deposit: libm::exp(0.9 * scores.of(Latent::Deposit)),
            seating: 1e-3 * libm::exp(1.3 * scores.of(Latent::Seating)),
        }
    }
}

/// One simulated surface, as drawn; independent of every other surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Specimen {
    pub(crate) seed: u64,
    pub(crate) index: u64,
    pub(crate) material: Material,
    pub(crate) profile: &'static Profile,
    /// The causes' own parts.
    pub(crate) own: Scores,
}

impl Specimen {
    pub(crate) fn draw(seed: u64, index: usize) -> Self {
        Self::of_material(seed, index, material_of(seed, index))
    }

    /// The surface that `index` would be, were it of this material.
    pub(crate) fn of_material(seed: u64, index: usize, material: Material) -> Self {
        let index = index as u64;
        let kinds = material.kinds();
        let mut stream = Stream::new(seed, Purpose::VARIANT, &[index]);
        let kind = stream.weighted(kinds.iter().map(|kind| kind.weight));
        Self {
            seed,
            index,
            material,
            profile: &kinds[kind],
            own: Scores::draw_own(&mut Stream::new(seed, Purpose::LATENTS, &[index])),
        }
    }

    pub(crate) fn parameters(&self) -> Parameters {
        Parameters::at(self.profile, &self.own.linked())
    }

    pub(crate) fn stream(&self, purpose: Purpose) -> Stream {
        Stream::new(self.seed, purpose, &[self.index])
    }
}
