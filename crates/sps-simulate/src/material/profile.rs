//! What a kind of material is, as ranges of physical parameters: a line of `ranges.csv`.

use std::sync::LazyLock;

use serde::Deserialize;
use serde::de::IntoDeserializer;
use serde::de::value::Error;

use super::super::numeric::normal_cdf;
use super::super::relief::Structure;
use super::Palette;

/// A range that a parameter is drawn from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Range {
    lo: f64,
    hi: f64,
}

impl Range {
    /// The value at a standard-normal score: uniform in the logarithm between the two ends, or
    /// uniform where the range starts at zero.
    pub(crate) fn at(self, score: f64) -> f64 {
        let p = normal_cdf(score);
        if self.lo > 0.0 {
            self.lo * libm::pow(self.hi / self.lo, p)
        } else {
            self.lo + (self.hi - self.lo) * p
        }
    }
}

/// One kind of one material; its fields are in the order of the columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Profile {
    pub(crate) material: &'static str,
    /// How many of 200 consecutive surfaces are of the material.
    pub(crate) per_block: usize,
    pub(crate) structure: Structure,
    /// Share of the kind in its material.
    pub(crate) weight: f64,
    pub(crate) palette: Palette,
    /// Roughness along the structure over roughness across it.
    pub(crate) anisotropy: f64,
    /// Reflectance at normal incidence of a dielectric; 0 for a metal, whose colour it is.
    pub(crate) f0: f64,
    /// Share of surfaces under a clear coat.
    pub(crate) coated: f64,
    /// Share of surfaces with a print or woven pattern of a second colour.
    pub(crate) printed: f64,
    /// Of what the first fifteen [latents](crate::latent::Latent) set, in their order.
    pub(crate) ranges: [Range; 15],
}

const TABLE: &str = include_str!("ranges.csv");

/// The kinds of each material.
pub(super) static KINDS: LazyLock<Vec<Vec<Profile>>> = LazyLock::new(|| {
    let kinds: Vec<Profile> = TABLE.lines().skip(1).map(Profile::read).collect();
    let of_one = kinds.chunk_by(|one, other| one.material == other.material);
    of_one.map(<[_]>::to_vec).collect()
});

impl Profile {
    fn read(line: &'static str) -> Self {
        let mut cells = line.split(',');
        let mut text = || cells.next().expect("a cell");
        let number = |text: &str| text.parse().expect("a number");
        Self {
            material: text(),
            per_block: text().parse().expect("a whole number"),
            structure: Structure::named(text()),
            weight: number(text()),
            palette: palette(text()),
            anisotropy: number(text()),
            f0: number(text()),
            coated: number(text()),
            printed: number(text()),
            ranges: std::array::from_fn(|_| {
                let (lo, hi) = text().split_once('-').expect("two numbers");
                let (lo, hi) = (number(lo), number(hi));
                Range { lo, hi }
            }),
        }
    }
}

/// The palette of this name.
fn palette(name: &'static str) -> Palette {
    let named: Result<Palette, Error> = Palette::deserialize(name.into_deserializer());
    named.expect("a palette that there is")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_read_whole_and_every_material_has_its_kinds() {
        assert_eq!(KINDS.len(), 45);
        // What the latents set, from `Period` to `Tack`.
        let ranges = "pitch mm,order,relief mm,micro um,micro length mm,alpha,sheen,modulus kPa,\
                      loss,relaxation,creep,thickness mm,effusivity,adhesion,tack";
        let head = TABLE.lines().next().unwrap();
        assert_eq!(head.splitn(10, ',').nth(9), Some(ranges));
        for line in TABLE.lines() {
            assert_eq!(line.split(',').count(), 24, "{line}");
        }
        for kinds in KINDS.iter() {
            let material = kinds[0].material;
            let weights: f64 = kinds.iter().map(|kind| kind.weight).sum();
            assert!((weights - 1.0).abs() < 1e-12, "{material}: {weights}");
            let share = kinds[0].per_block;
            assert!(kinds.iter().all(|kind| kind.per_block == share));
            let of_it = |line: &&str| line.split(',').next() == Some(material);
            let lines = TABLE.lines().filter(of_it).count();
            assert_eq!(lines, kinds.len(), "{material}: its lines stand together");
        }
    }
}
