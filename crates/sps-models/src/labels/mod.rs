//! Labels for the auxiliary classifier (paper, section 4.1, "Classification Objective").
//!
//! Three kinds, as in the paper's ablation: material classes, clusters of tactile values, and
//! clusters of visual and tactile values together. All are formed from the training surfaces of a
//! rerun alone.
//!
//! ```
//! use sps_models::labels::{LabelSource, label};
//! use sps_regress::{Embeddings, Readings, TrainingData};
//!
//! let rows = [Some(31.0), Some(78.0), None, Some(30.0), Some(80.0)].map(|reading| vec![reading]);
//! let readings = Readings::new(vec!["friction".into()], &rows)?;
//! let visual = Embeddings::new(vec![0.0; 10], [5, 1, 2])?;
//! let tables = TrainingData::new(&visual, &readings);
//!
//! let source = LabelSource::TactileCluster { clusters: 2, standardise_tactile: true };
//! let labels = label(&source, &tables, &[0, 1, 2, 3, 4], 7, 0)?;
//! let of = labels.of();
//! assert!(of[0] == of[3] && of[1] == of[4] && of[0] != of[1]);
//! assert_eq!((labels.classes(), of[2]), (2, None)); // not touched, not labelled
//! # Ok::<(), sps_models::Error>(())
//! ```

#[cfg(feature = "clusters")]
mod clusters;
#[cfg(all(test, feature = "clusters"))]
mod tests;

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

#[cfg(feature = "clusters")]
use clusters::{beside, cluster, spread_out, tactile, visual};
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
        let (clusters, components) = match *self {
            Self::Material {} => (1, 1),
            Self::TactileCluster { clusters, .. } => (clusters, 1),
            Self::VisuoTactileCluster {
                clusters,
                components,
                ..
            } => (clusters, components),
        };
        require(clusters > 0, "clusters", clusters, "at least 1")?;
        require(components > 0, "components", components, "at least 1")
    }
}

/// One label for each of some surfaces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Labels {
    classes: usize,
    of: Vec<Option<u32>>,
}

impl Labels {
    /// How many classes; a class need not have a member.
    pub fn classes(&self) -> usize {
        self.classes
    }

    /// The class of each surface, in the order in which the surfaces were given. `None` is a
    /// surface that could not be labelled: it takes no part in the classification loss.
    pub fn of(&self) -> &[Option<u32>] {
        &self.of
    }
}

/// Labels the surfaces of `training` (indices into the tables), from these surfaces alone.
///
/// Of several views of a surface the middle one counts (the lower of two), which is the nadir of a symmetrical
/// sequence. A missing tactile value counts as its property's mean. A surface without any tactile value has
/// no label from tactile clusters, and one by sight alone from visuo-tactile clusters. The same
/// (source, tables, surfaces, seed, rerun) gives the same labels on any number of threads.
///
/// # Errors
///
/// No surfaces, indices outside the tables, no tactile readings or materials where they are
/// needed, a count of zero; clusters without the feature `clusters`.
#[cfg_attr(not(feature = "clusters"), expect(unused_variables))]
pub fn label(
    source: &LabelSource,
    tables: &TrainingData<'_>,
    training: &[usize],
    seed: u64,
    rerun: u64,
) -> Result<Labels> {
    source.check()?;
    if training.is_empty() {
        return Err(Error::input("surfaces to label", "none", "at least one"));
    }
    check_indices("labelled surface", training, tables.readings.surfaces())?;
    match source {
        LabelSource::Material {} => by_material(tables.materials, training),
        #[cfg(feature = "clusters")]
        LabelSource::TactileCluster {
            clusters,
            standardise_tactile,
        } => {
            let (touched, points) =
                tactile(tables.readings, training, *standardise_tactile, false)?;
            let (of, classes) = cluster(points, *clusters, seed, rerun)?;
            Ok(spread_out(training.len(), &touched, &of, classes))
        }
        #[cfg(feature = "clusters")]
        LabelSource::VisuoTactileCluster {
            clusters,
            components,
            standardise_tactile,
        } => {
            check_indices("labelled surface", training, tables.embeddings.surfaces())?;
            let (all, touch) = tactile(tables.readings, training, *standardise_tactile, true)?;
            let sight = visual(tables.embeddings, training, *components)?;
            let (of, classes) = cluster(beside(&sight, &touch)?, *clusters, seed, rerun)?;
            Ok(spread_out(training.len(), &all, &of, classes))
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
    let class = |&surface: &usize| names.binary_search(&&materials[surface]).ok();
    let classes = training.iter().map(class);
    Ok(Labels {
        classes: names.len(),
        of: classes.map(|class| class.map(|c| c as u32)).collect(),
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
