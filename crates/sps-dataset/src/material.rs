use std::collections::BTreeMap;

use crate::Surface;

/// The name of the label that gathers rare materials.
pub const OTHER: &str = "other";

/// Materials with fewer surfaces are [`OTHER`] in the paper (figure 2).
pub const FEWEST_PER_MATERIAL: usize = 6;

/// A class label per surface, from its material.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaterialLabels {
    names: Vec<String>,
    labels: Vec<usize>,
}

impl MaterialLabels {
    /// Labels each surface by its material; materials with fewer than `fewest` surfaces, and
    /// those without a name, share the label [`OTHER`], which comes last. The others are sorted by
    /// name. The paper's rule is [`FEWEST_PER_MATERIAL`].
    pub fn of(surfaces: &[Surface], fewest: usize) -> Self {
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        for surface in surfaces {
            *counts.entry(&surface.material).or_default() += 1;
        }
        counts.retain(|name, count| *count >= fewest && !["", OTHER].contains(name));
        let mut names: Vec<String> = counts.keys().map(|&name| name.to_owned()).collect();
        let other = names.len();
        let label = |surface: &Surface| names.binary_search(&surface.material).unwrap_or(other);
        let labels: Vec<usize> = surfaces.iter().map(label).collect();
        if labels.contains(&other) {
            names.push(OTHER.to_owned());
        }
        Self { names, labels }
    }

    /// The name of each label.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The label of each surface, as an index into [`Self::names`].
    pub fn labels(&self) -> &[usize] {
        &self.labels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surfaces(materials: &[(&str, usize)]) -> Vec<Surface> {
        let repeated = materials.iter();
        let repeated = repeated.flat_map(|&(name, count)| vec![name; count]);
        let surfaces = repeated.enumerate().map(|(i, material)| Surface {
            id: i.to_string(),
            material: material.to_owned(),
            group: i.to_string(),
        });
        surfaces.collect()
    }

    #[test]
    fn fewer_than_six_are_other() {
        let all = surfaces(&[("wood", 6), ("fur", 5), ("denim", 7), ("", 9), ("other", 8)]);
        let labels = MaterialLabels::of(&all, FEWEST_PER_MATERIAL);
        assert_eq!(labels.names(), ["denim", "wood", "other"]);
        let expected = [vec![1; 6], vec![2; 5], vec![0; 7], vec![2; 9], vec![2; 8]].concat();
        assert_eq!(labels.labels(), expected);
    }

    #[test]
    fn no_other_where_every_material_is_common() {
        let labels = MaterialLabels::of(&surfaces(&[("wood", 6)]), FEWEST_PER_MATERIAL);
        assert_eq!(labels.names().len(), 1);
        assert_eq!(labels.labels(), [0; 6]);
        assert_eq!(MaterialLabels::of(&[], 6).names(), [""; 0]);
    }
}
