//! What a kind of material is, as ranges of physical parameters.

use serde::{Deserialize, Serialize};

use super::super::numeric;
use super::Palette;

/// A range that a parameter is drawn from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Range {
    /// Lowest value.
    pub lo: f64,
    /// Highest value.
    pub hi: f64,
}

impl Range {
    /// The value at a standard-normal score: uniform in the logarithm between the two ends, or
    /// uniform where the range starts at zero.
    pub fn at(self, score: f64) -> f64 {
        let p = numeric::normal_cdf(score);
        if self.lo > 0.0 {
            self.lo * numeric::pow(self.hi / self.lo, p)
        } else {
            self.lo + (self.hi - self.lo) * p
        }
    }
}

/// How warp and weft cross.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Weave {
    /// Over one, under one.
    Plain,
    /// Over three, under one, shifted by one each row: diagonal lines.
    Twill,
    /// Over four, under one, scattered: long floats.
    Satin,
    /// Plain with threads in pairs.
    Basket,
}

/// What the height field is built of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Structure {
    /// Nothing but its microrelief.
    Smooth,
    /// A fired glaze: faint waves, specks and a net of fine cracks.
    Glazed,
    /// Fine parallel scratches.
    Brushed,
    /// Two sets of crossing threads.
    Woven(Weave),
    /// Rows of stitches.
    Knitted,
    /// Standing loops of yarn.
    Looped,
    /// Tufts of cut yarn.
    Tufted,
    /// Long aligned hair.
    Haired,
    /// Matted fibres.
    Fibrous,
    /// Parallel ridges.
    Ribbed,
    /// Domes parted by creases.
    Pebbled,
    /// Pits in a body.
    Porous,
    /// Packed grains.
    Granular,
    /// Packed grains of several minerals, ground flat.
    Speckled,
    /// Warped veins, ground flat.
    Veined,
    /// Growth rings and pores.
    Grained,
    /// A repeated raised motif.
    Embossed,
}

/// The ranges of one kind of one material.
///
/// A surface's parameter is [`Range::at`] its latent score. The sources of the ranges are in the
/// repository's `docs/simulator.md`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Profile {
    /// What the height field is built of.
    pub structure: Structure,
    /// Thread, stitch, tuft, cell, ring or motif pitch, in mm.
    pub period_mm: Range,
    /// Root mean square of the structure's height, in mm.
    pub relief_mm: Range,
    /// 0 is disordered, 1 is a perfect lattice.
    pub regularity: Range,
    /// Root mean square of the microrelief, in micrometres.
    pub micro_um: Range,
    /// Correlation length of the microrelief, in mm.
    pub micro_length_mm: Range,
    /// GGX roughness (alpha) of what is too fine to resolve.
    pub alpha: Range,
    /// Roughness along the structure over roughness across it.
    pub anisotropy: f64,
    /// Strength of the fuzz lobe.
    pub sheen: Range,
    /// Reflectance at normal incidence of a dielectric; 0 for a metal, whose colour it is.
    pub f0: f64,
    /// Share of surfaces under a clear coat.
    pub coated: f64,
    /// Family of colours.
    pub palette: Palette,
    /// Share of surfaces with a print or woven pattern of a second colour.
    pub printed: f64,
    /// Indentation modulus, in kPa.
    pub modulus_kpa: Range,
    /// Loss tangent at 1 to 10 Hz.
    pub loss: Range,
    /// Share of the stress that relaxes within seconds.
    pub relaxation: Range,
    /// Creep strain over elastic strain within seconds.
    pub creep: Range,
    /// Thickness on the rigid stage, in mm.
    pub thickness_mm: Range,
    /// Thermal effusivity, in J m^-2 K^-1 s^-1/2.
    pub effusivity: Range,
    /// Work of adhesion against silicone rubber, in mJ/m^2.
    pub adhesion: Range,
    /// Tackiness of deposits and plasticiser, relative to a clean surface.
    pub tack: Range,
}
