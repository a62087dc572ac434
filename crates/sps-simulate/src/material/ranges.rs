//! What each kind of each material is: `ranges.csv`, a line for each.

use std::str::Split;
use std::sync::LazyLock;

use serde::Deserialize;
use serde::de::IntoDeserializer;
use serde::de::value::Error;

use super::Material;
use super::profile::{Profile, Range, Structure};

const TABLE: &str = include_str!("ranges.csv");

/// The kinds of each of [`Material::ALL`], each with its weight.
pub(super) static KINDS: LazyLock<Vec<Vec<(f64, Profile)>>> = LazyLock::new(|| {
    let kinds = |material: &Material| {
        let lines = TABLE.lines().filter_map(|line| line.split_once(','));
        let own = lines.filter(|(label, _)| *label == material.label());
        own.map(|(_, cells)| Cells(cells.split(',')).kind())
            .collect()
    };
    Material::ALL.iter().map(kinds).collect()
});

/// The cells of a line after its material, in the order of the header.
struct Cells(Split<'static, char>);

impl Cells {
    fn kind(mut self) -> (f64, Profile) {
        let structure = self.text();
        let weight = self.number();
        let profile = Profile {
            structure: match structure.strip_prefix("woven ") {
                Some(weave) => Structure::Woven(named(weave)),
                None => named(structure),
            },
            palette: named(self.text()),
            period_mm: self.range(),
            relief_mm: self.range(),
            regularity: self.range(),
            micro_um: self.range(),
            micro_length_mm: self.range(),
            alpha: self.range(),
            anisotropy: self.number(),
            sheen: self.range(),
            f0: self.number(),
            coated: self.number(),
            printed: self.number(),
            modulus_kpa: self.range(),
            loss: self.range(),
            relaxation: self.range(),
            creep: self.range(),
            thickness_mm: self.range(),
            effusivity: self.range(),
            adhesion: self.range(),
            tack: self.range(),
        };
        (weight, profile)
    }

    fn text(&mut self) -> &'static str {
        self.0.next().expect("a cell")
    }

    fn number(&mut self) -> f64 {
        self.text().parse().expect("a number")
    }

    /// `LOWEST-HIGHEST`
    fn range(&mut self) -> Range {
        let ends = self.text().split_once('-').expect("two numbers");
        let [lo, hi] = [ends.0, ends.1].map(|end| end.parse().expect("a number"));
        Range { lo, hi }
    }
}

/// The variant of this name.
fn named<T: Deserialize<'static>>(name: &'static str) -> T {
    let named: Result<T, Error> = T::deserialize(name.into_deserializer());
    named.expect("a name that there is")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_read_whole_and_every_material_has_its_kinds() {
        assert_eq!(KINDS.len(), Material::ALL.len());
        let read: usize = KINDS.iter().map(Vec::len).sum();
        assert_eq!(TABLE.lines().count(), read + 1);
        for line in TABLE.lines() {
            assert_eq!(line.split(',').count(), 23, "{line}");
        }
        for (kinds, material) in KINDS.iter().zip(Material::ALL) {
            let weights: f64 = kinds.iter().map(|(weight, _)| weight).sum();
            assert!((weights - 1.0).abs() < 1e-12, "{material:?}: {weights}");
        }
    }
}
