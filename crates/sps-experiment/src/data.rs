//! The surfaces that an experiment runs on.

use std::path::Path;

use anyhow::{Context, Result};
use sps_dataset::{
    DatasetFolder, FrameFormat, NearTwins, Origin, OutOfRange, Property, RollAngle, Source,
    TactileSettings, WriteOptions, Written, write_dataset,
};
use sps_simulate::{Ceilings, Simulator, SimulatorSpec, ceilings};
use tracing::info;

use crate::config::DataSpec;
use crate::files::write_atomically;
use crate::progress::Progress;

/// Work that can be done on any source.
pub(crate) trait WithSource {
    type Output;

    fn call<S: Source>(self, source: &S, about: About) -> Result<Self::Output>;
}

/// What is known of a source beside its surfaces.
#[derive(Clone, Debug)]
pub(crate) struct About {
    pub simulated: bool,
    pub published_sps: bool,
    /// Where it comes from and under which licence, as far as it says.
    pub origin: String,
    /// How readings of one surface become one value.
    pub tactile: TactileSettings,
    /// The known limit of simulated data.
    pub ceilings: Option<Ceilings>,
    /// What a reader of results must know of the data.
    pub notes: Vec<String>,
}

/// Surfaces that the ceilings are measured on: the standard error is then about 0.01.
const CEILING_SURFACES: usize = 4000;

/// Opens the data and hands it to `work`.
pub(crate) fn with_source<W: WithSource>(data: &DataSpec, work: W) -> Result<W::Output> {
    match data {
        DataSpec::Simulated { spec, indices } => {
            let (surfaces, views) = (spec.surfaces, spec.views);
            info!(
                "simulated: {surfaces} surfaces in {views} views, rendered when they are looked at"
            );
            let source = Simulator::of(spec.clone(), indices).context("data.simulated")?;
            work.call(&source, about_simulated(spec))
        }
        DataSpec::Folder {
            path,
            read,
            published_sps,
            near_twins,
        } => {
            let mut source = DatasetFolder::open(path, read)?;
            let mut notes = out_of_range_notes(source.out_of_range());
            if let Some(likeness) = *near_twins {
                let note = keep_near_twins_together(&mut source, likeness)?;
                info!("{note}");
                notes.push(note);
            }
            let about = About {
                simulated: source.origin() == Some(Origin::Simulator),
                published_sps: *published_sps || source.origin() == Some(Origin::Paper),
                origin: source.manifest().source.clone(),
                tactile: read.tactile,
                ceilings: None,
                notes,
            };
            info!("{}: {} surfaces", source.name(), source.surfaces().len());
            work.call(&source, about)
        }
    }
}

/// Writes simulated surfaces into `folder` as a dataset, with the limit of what can be known of them in
/// `ceilings.json`, or goes on where that was stopped.
///
/// # Errors
/// Numbers that no simulator has; a folder that cannot be written to.
pub fn simulate(spec: &SimulatorSpec, format: FrameFormat, folder: &Path) -> Result<Written> {
    let simulator = Simulator::new(spec.clone())?;
    let options = WriteOptions {
        format,
        description: "Simulated surfaces; no value in it was measured".to_owned(),
        source: format!("sps simulator, seed {}", spec.seed),
    };
    let progress = Progress::new("surfaces", spec.surfaces);
    let written = write_dataset(&simulator, folder, &options, |_, _| progress.advance(1))?;
    let ceilings = ceilings(spec.seed, CEILING_SURFACES, spec.locations);
    let mut text = serde_json::to_string_pretty(&ceilings).context("ceilings")?;
    text.push('\n');
    write_atomically(&folder.join("ceilings.json"), text.as_bytes())?;
    Ok(written)
}

fn about_simulated(spec: &SimulatorSpec) -> About {
    About {
        simulated: true,
        published_sps: false,
        origin: String::new(),
        tactile: TactileSettings::default(),
        ceilings: Some(ceilings(spec.seed, CEILING_SURFACES, spec.locations)),
        notes: Vec::new(),
    }
}

fn keep_near_twins_together(source: &mut DatasetFolder, likeness: f64) -> Result<String> {
    let NearTwins { groups, largest } = source.keep_near_twins_together(likeness)?;
    let surfaces = source.surfaces().len();
    Ok(format!(
        "near twins share a group (`data.folder.near-twins`): surfaces whose patterns, seen in grey, \
         have a likeness of {likeness} or more; {surfaces} surfaces make {groups} groups, and the \
         largest has {largest}"
    ))
}

fn out_of_range_notes(found: &[(Property, OutOfRange)]) -> Vec<String> {
    found
        .iter()
        .filter(|(_, count)| count.below + count.above > 0)
        .map(|(property, count)| {
            format!(
                "{property}: {} readings below its range and {} above",
                count.below, count.above
            )
        })
        .collect()
}

/// The view that looks straight down.
pub(crate) fn nadir<S: Source>(source: &S) -> Result<usize> {
    source
        .nearest_view(RollAngle::NADIR)
        .context("the dataset has no views")
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Groups;

    impl WithSource for Groups {
        type Output = (Vec<String>, Vec<String>);

        fn call<S: Source>(self, source: &S, about: About) -> Result<Self::Output> {
            let groups = source.surfaces().iter().map(|s| s.group.clone());
            Ok((groups.collect(), about.notes))
        }
    }

    #[test]
    fn near_twins_share_a_group_and_the_notes_say_so() {
        let seen = |near_twins| {
            let data = DataSpec::Folder {
                path: concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/tiny-dataset").into(),
                read: Box::default(),
                published_sps: false,
                near_twins,
            };
            with_source(&data, Groups).unwrap()
        };
        let (own, notes) = seen(None);
        assert!(
            !notes.iter().any(|note| note.contains("twins")),
            "{notes:?}"
        );
        // No two patterns are equal, and two surfaces have one group in the dataset.
        let (groups, notes) = seen(Some(1.0));
        assert_eq!(groups, own);
        let said = "a likeness of 1 or more; 6 surfaces make 5 groups, and the largest has 2";
        assert!(notes.iter().any(|note| note.ends_with(said)), "{notes:?}");
        // The least likeness joins all.
        let (groups, _) = seen(Some(-1.0));
        assert!(groups.iter().all(|group| *group == own[0]), "{groups:?}");
    }
}
