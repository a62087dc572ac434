//! Which material a surface is.

use super::super::stream::{Purpose, Stream};
use super::Material;

/// Surfaces in a block.
pub(crate) const BLOCK: usize = 200;

/// The material of surface `index`.
///
/// Each block of 200 consecutive surfaces holds every material exactly in its share, in an order
/// drawn for that block alone: so a surface does not depend on how many others there are, a set
/// of 400 has the paper's composition instead of a noisy draw from it, and the rare materials
/// neither vanish nor crowd.
pub(crate) fn material_of(seed: u64, index: usize) -> Material {
    let of_material = |material: Material| std::iter::repeat_n(material, material.per_block());
    let mut places: Vec<Material> = Material::all().flat_map(of_material).collect();
    let mut stream = Stream::new(seed, Purpose::ASSIGNMENT, &[(index / BLOCK) as u64]);
    for last in (1..places.len()).rev() {
        places.swap(last, stream.index(last + 1));
    }
    places[index % BLOCK]
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn a_block_is_full() {
        let total: usize = Material::all().map(Material::per_block).sum();
        assert_eq!(total, BLOCK);
    }

    #[test]
    fn four_hundred_surfaces_have_the_papers_shares_and_labels() {
        #[derive(serde::Deserialize)]
        struct Published {
            materials: BTreeMap<String, f64>,
        }
        let text = include_str!("../../../sps-report/src/published.toml");
        let published: Published = toml::from_str(text).unwrap();

        let mut counts = BTreeMap::<String, usize>::new();
        for index in 0..400 {
            let label = material_of(5, index).label();
            *counts.entry(label.to_owned()).or_default() += 1;
        }
        let mut labels = BTreeMap::<String, usize>::new();
        for (label, count) in counts {
            let label = if count < 6 { "other".to_owned() } else { label };
            *labels.entry(label).or_default() += count;
        }
        let expected: Vec<&String> = published.materials.keys().collect();
        assert_eq!(labels.keys().collect::<Vec<_>>(), expected);
        for (label, share) in published.materials {
            let found = labels[&label] as f64 / 400.0;
            let near = (found - share).abs() <= 0.005;
            assert!(near, "{label}: {found} against {share}");
        }
    }
}
