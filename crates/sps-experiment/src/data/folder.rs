//! A dataset on disk.

use std::path::PathBuf;

use anyhow::Result;
use serde::Deserialize;
use sps_dataset::{
    DatasetFolder, KFold, NearTwins, Origin, OutOfRange, Property, RandomSplit, ReadSettings,
    Source, SplitPlan, Unit,
};
use tracing::info;

use super::{About, Checked, DataSpec, Opened, Protocol};
use crate::config::Layers;

/// How it is read.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct FolderConfig {
    /// Its folder.
    pub path: PathBuf,
    /// Whether it is the paper's own dataset.
    pub published_sps: bool,
    /// How alike surfaces are that are kept together; 0: groups are the dataset's own.
    pub near_twins: f64,
    /// How tables and frames are read.
    pub read: ReadSettings,
}

impl FolderConfig {
    pub(super) fn checked(&self, layers: &Layers<'_>, split: Option<SplitPlan>) -> Checked {
        let named = !self.path.as_os_str().is_empty();
        layers.require(named, "data.folder.path", "names no folder")?;
        let (key, likeness) = ("data.folder.near-twins", self.near_twins);
        let problem = format!(
            "is {likeness}, expected a likeness above 0 and at most 1, or 0 to keep the dataset's groups"
        );
        layers.require((0.0..=1.0).contains(&likeness), key, &problem)?;
        let problem =
            "makes groups, which `split` parts: expected `by = \"group\"` there, or no `by`";
        layers.require(likeness == 0.0 || !parts_groups(split), key, problem)?;
        let data = DataSpec::Folder(Box::new(self.clone()));
        Ok((data, Protocol::Split(split.unwrap_or_default())))
    }

    /// Opens it; frames are decoded when they are looked at.
    pub(super) fn open(&self) -> Result<Opened> {
        let mut source = DatasetFolder::open(&self.path, &self.read)?;
        let mut notes = out_of_range_notes(source.out_of_range());
        if self.near_twins != 0.0 {
            let likeness = self.near_twins;
            let NearTwins { groups, largest } = source.keep_near_twins_together(likeness)?;
            let surfaces = source.surfaces().len();
            let note = format!(
                "near twins share a group (`data.folder.near-twins`): surfaces whose patterns, seen in \
                 grey, have a likeness of {likeness} or more; {surfaces} surfaces make {groups} groups, \
                 and the largest has {largest}"
            );
            info!("{note}");
            notes.push(note);
        }
        let about = About {
            simulated: source.origin() == Some(Origin::Simulator),
            published_sps: self.published_sps || source.origin() == Some(Origin::Paper),
            origin: source.manifest().source.clone(),
            decode: self.read.images.clone(),
            tactile: self.read.tactile,
            notes,
            ..About::default()
        };
        info!("{}: {} surfaces", source.name(), source.surfaces().len());
        Ok((Box::new(source), about))
    }
}

/// Whether a plan says that something else than groups stays whole.
fn parts_groups(plan: Option<SplitPlan>) -> bool {
    let (SplitPlan::Random(RandomSplit { by, .. })
    | SplitPlan::KFold(KFold { by, .. })
    | SplitPlan::LeaveOneOut { by }) = plan.unwrap_or_default();
    by.is_some_and(|unit| unit != Unit::Group)
}

fn out_of_range_notes(found: &[(Property, OutOfRange)]) -> Vec<String> {
    let found = found.iter().filter(|(_, n)| n.below + n.above > 0);
    let note = |(property, OutOfRange { below, above }): &(Property, OutOfRange)| {
        format!("{property}: {below} readings below its range and {above} above")
    };
    found.map(note).collect()
}
