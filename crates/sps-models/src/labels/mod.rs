//! Labels for the auxiliary classifier (paper, section 4.1, "Classification Objective").
//!
//! Three kinds, as in the paper's ablation: material classes, clusters of tactile values, and
//! clusters of visual and tactile values together. All are formed from the training surfaces of a
//! rerun alone.

#[cfg(feature = "clusters")]
mod clusters;
#[cfg(all(test, feature = "clusters"))]
mod tests;

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

#[cfg(feature = "clusters")]
use clusters::{beside, cluster, tactile, visual};
use sps_regress::{TrainingData, check_indices};

use crate::error::{Error, Result, require};

/// Where the labels come from.
///
/// The paper does not print the number of clusters or of components. 15 clusters are as many as
/// its material classes, so that the three kinds of label differ in kind and not in number; 15
/// components are as many as there are tactile properties, so that after standardising sight and
/// touch weigh the same.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    tag = "source",
    rename_all = "kebab-case",
    rename_all_fields = "kebab-case",
    deny_unknown_fields
)]
pub enum LabelSource {
    /// The surface's material. Every material of the data set is a class, also one without a
    /// training surface.
    Material {},
    /// k-means on the tactile values (Yuan et al. 2017).
    TactileCluster {
        /// How many clusters; fewer when there are fewer distinct surfaces.
        #[serde(default = "default_clusters")]
        clusters: usize,
        /// Each property to zero mean and unit variance first. On by default: left as measured,
        /// the properties with the widest range decide alone.
        #[serde(default = "default_true")]
        standardise_tactile: bool,
    },
    /// k-means on visual features, reduced by PCA and standardised, beside the tactile values.
    VisuoTactileCluster {
        /// How many clusters; fewer when there are fewer distinct surfaces.
        #[serde(default = "default_clusters")]
        clusters: usize,
        /// Principal components of the visual features; fewer when there are fewer.
        #[serde(default = "default_components")]
        components: usize,
        /// Each property to zero mean and unit variance first. On by default: values from 0 to
        /// 100 beside features of unit variance would decide alone, and the labels would be those
        /// of the tactile clusters.
        #[serde(default = "default_true")]
        standardise_tactile: bool,
    },
}

fn default_clusters() -> usize {
    15
}

fn default_components() -> usize {
    15
}

fn default_true() -> bool {
    true
}

impl LabelSource {
    /// Refuses counts of zero, and clusters where there are none.
    pub(crate) fn check(&self) -> Result<()> {
        let known = cfg!(feature = "clusters") || *self == Self::Material {};
        let expected = "a build with the feature `clusters` of sps-models";
        require(known, "labels", "clusters", expected)?;
        if let Self::VisuoTactileCluster { components, .. } = *self {
            require(components > 0, "components", components, "at least 1")?;
        }
        match *self {
            Self::Material {} => Ok(()),
            Self::TactileCluster { clusters, .. } | Self::VisuoTactileCluster { clusters, .. } => {
                require(clusters > 0, "clusters", clusters, "at least 1")
            }
        }
    }
}

/// One label for each of some surfaces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Labels {
    /// How many classes; a class need not have a member.
    pub(crate) classes: usize,
    /// The class of each surface, in the order in which the surfaces were given. `None` is a
    /// surface that could not be labelled: it takes no part in the classification loss.
    pub(crate) of: Vec<Option<u32>>,
}

/// Labels the surfaces of `training` (indices into the tables), from these surfaces alone.
///
/// Of several views of a surface the middle one counts (the lower of two), which is the nadir of a symmetrical
/// sequence. A missing tactile value counts as its property's mean. A surface without any tactile value has
/// no label from tactile clusters, and one by sight alone from visuo-tactile clusters. The same
/// (source, tables, surfaces, seed, rerun) gives the same labels on any number of threads.
#[cfg_attr(not(feature = "clusters"), expect(unused_variables))]
pub(crate) fn label(
    source: &LabelSource,
    tables: &TrainingData<'_>,
    training: &[usize],
    seed: u64,
    rerun: u64,
) -> Result<Labels> {
    source.check()?;
    let some = !training.is_empty();
    require(some, "surfaces to label", "none", "at least one")?;
    check_indices("labelled surface", training, tables.readings.surfaces())?;
    match source {
        LabelSource::Material {} => by_material(tables.materials, training),
        #[cfg(feature = "clusters")]
        &LabelSource::TactileCluster {
            clusters,
            standardise_tactile,
        } => {
            let (rows, points) = tactile(tables.readings, training, standardise_tactile, false)?;
            cluster(training.len(), &rows, points, clusters, (seed, rerun))
        }
        #[cfg(feature = "clusters")]
        &LabelSource::VisuoTactileCluster {
            clusters,
            components,
            standardise_tactile,
        } => {
            check_indices("labelled surface", training, tables.embeddings.surfaces())?;
            let (rows, touch) = tactile(tables.readings, training, standardise_tactile, true)?;
            let sight = visual(tables.embeddings, training, components)?;
            let points = beside(&sight, &touch)?;
            cluster(training.len(), &rows, points, clusters, (seed, rerun))
        }
        #[cfg(not(feature = "clusters"))]
        // Refused by the check.
        _ => by_material(tables.materials, training),
    }
}

fn by_material(materials: Option<&[String]>, training: &[usize]) -> Result<Labels> {
    let missing = || Error::input("materials", "none", "one for each surface, for its label");
    let materials = materials.ok_or_else(missing)?;
    check_indices("labelled surface", training, materials.len())?;
    let names: BTreeSet<&String> = materials.iter().collect();
    let names: Vec<&String> = names.into_iter().collect();
    let class = |&surface: &usize| Some(names.binary_search(&&materials[surface]).ok()? as u32);
    Ok(Labels {
        classes: names.len(),
        of: training.iter().map(class).collect(),
    })
}

#[cfg(all(test, not(feature = "clusters")))]
mod tests {
    use super::*;

    #[test]
    fn clusters_are_refused_by_the_name_of_their_feature() {
        LabelSource::Material {}.check().unwrap();
        let clusters = LabelSource::TactileCluster {
            clusters: 15,
            standardise_tactile: true,
        };
        let error = clusters.check().unwrap_err();
        assert!(error.to_string().contains("feature `clusters`"), "{error}");
    }
}
