//! `results.json`: what an experiment measured. Keys are only ever added.

mod costs;
mod gains;
mod intervals;
mod judged;
mod means;
mod notes;
#[cfg(test)]
mod schema;
mod score;
mod scores;
pub mod speed;

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use sps_dataset::Unit;

pub use costs::Costs;
pub use gains::{Gain, Gains};
pub use intervals::{AdaptiveResult, GivenIntervals};
pub(crate) use judged::{Judged, Numbers};
pub use means::Means;
pub(crate) use score::{MethodOutcomes, Scoring, score};
pub use scores::{Kind, PropertyScores};
pub use speed::Speed;

use crate::files::{read_text, write_atomically};
use speed::{Point, best_within, looking, points};

/// A value per property code.
pub type PerProperty<T> = BTreeMap<String, T>;

/// A value, or `null` with its reason in the notes.
pub type Number = Option<f64>;

/// The version of `results.json`: it rises when keys are added, which is all that ever happens.
pub(crate) const SCHEMA: u32 = 4;

/// At the top of `results.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Provenance {
    /// Version of this file: it rises when keys are added, which is all that ever happens.
    pub schema: u32,
    /// Hash of the sources that decide what a trial comes to, and of `Cargo.lock`. Trials of
    /// other sources are computed again.
    pub source_hash: String,
    /// BLAKE3 of `config.toml` in the folder of the run: the config with its defaults and all that
    /// was set on the command line.
    pub config_hash: String,
    /// BLAKE3 of the data: of each surface its name, group, material, averaged readings and
    /// the frame straight down, and the roll angles of the views.
    pub data_hash: String,
    /// Keys every random stream of the experiment.
    pub seed: u64,
    /// Seed of the simulated surfaces; `null` where the data is on disk.
    pub data_seed: Option<u64>,
    /// Model of the processor.
    pub cpu: String,
    /// Threads that computed; no result but times and memory depends on them.
    pub threads: usize,
    /// What the encoders of the methods compute in. Everything after an encoder is in f32, the
    /// scores in f64.
    pub precision: Vec<String>,
}

/// The whole of `results.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Results {
    /// What it was computed from and with.
    #[serde(flatten)]
    pub provenance: Provenance,
    /// The name of the config's file.
    pub experiment: String,
    /// As the config describes it.
    pub description: String,
    /// What it ran on.
    pub dataset: Dataset,
    /// Codes of the estimated properties, in the order of the reports.
    pub properties: Vec<String>,
    /// What they are called and measured in, and how far their values differ.
    #[serde(default)]
    pub described: PerProperty<Described>,
    /// Of the intervals.
    pub interval_level: f64,
    /// What intervals count beside units and reruns: units held out for each that is trained on
    /// where reruns part one set of surfaces, 0 where they train on surfaces of their own. `null`
    /// in files whose intervals are over units alone.
    pub test_per_training: Number,
    /// Ids of the methods that all others are compared with.
    pub against: Vec<String>,
    /// In the order of the config, floors last.
    pub methods: Vec<MethodResult>,
    /// Speed against error, where the config asks for it.
    pub speed: Option<Speed>,
    /// What holds for the whole run, for example values out of range in the data.
    pub notes: Vec<String>,
}

/// What is known of a property beside its code.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Described {
    /// Empty where it has no name but its code.
    pub name: String,
    /// Empty where its values have none.
    pub unit: String,
    /// Standard deviation of its values over all surfaces.
    pub std: f64,
    /// The lowest and the highest of these values; `null` where there is none.
    pub range: Option<[f64; 2]>,
}

/// What the experiment ran on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Dataset {
    /// As the dataset calls itself.
    pub name: String,
    /// Whether its images and values come from the simulator.
    pub simulated: bool,
    /// Whether it is the paper's own dataset.
    pub published_sps: bool,
    /// How many surfaces there are.
    pub surfaces: usize,
    /// Surfaces that each rerun was trained on, on average.
    pub training_surfaces: usize,
    /// What splits, folds, calibration and intervals keep together: `surface`, `group` or
    /// `material`.
    #[cfg_attr(test, schemars(with = "Option<String>"))]
    pub unit: Option<Unit>,
    /// How many of them there are.
    pub units: usize,
    /// Views of each surface.
    pub views: usize,
    /// Their roll angles in degrees, in order.
    pub view_angles_deg: Vec<f64>,
    /// Name and origin of the encoder's weights.
    pub encoder: String,
    /// R² that a perfect reader of the images could reach, per property; simulated data alone.
    pub ceiling_one_view: PerProperty<f64>,
    /// The same, for a reader of all views.
    pub ceiling_all_views: PerProperty<f64>,
}

impl Dataset {
    /// Whether the paper's printed numbers may stand beside it: of its own surfaces, and of those that
    /// are simulated after them.
    pub fn is_after_the_paper(&self) -> bool {
        self.simulated || self.published_sps
    }

    /// Whether what is held out are whole groups or materials, whose mean is far from that of the others.
    pub fn holds_out_groups(&self) -> bool {
        matches!(self.unit, Some(Unit::Group | Unit::Material))
    }

    /// What intervals are over, in the plural.
    pub fn units_in_words(&self) -> String {
        self.unit.unwrap_or(Unit::Surface).to_string()
    }
}

/// One method over all properties and reruns.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MethodResult {
    /// In files.
    pub id: String,
    /// In reports.
    pub label: String,
    /// As the config names it: `head`, `ridge`, `stacked` and so on.
    pub kind: String,
    /// Its encoder, in words; empty where it looks at nothing.
    pub encoder: String,
    /// What its encoder computes in, `f32`, `bf16` or `int8`; empty where it looks at nothing.
    pub precision: String,
    /// That were asked for; the notes name those that came to nothing.
    pub reruns: usize,
    /// Surfaces that each rerun was trained on, on average.
    pub training_surfaces: usize,
    /// Different surfaces that it was scored on, all reruns together, and units of them.
    pub held_out_surfaces: usize,
    /// Units of these surfaces.
    pub held_out_units: usize,
    /// Per property.
    #[serde(flatten)]
    pub scores: PropertyScores,
    /// Over the properties.
    #[serde(flatten)]
    pub means: Means,
    /// Against other methods.
    #[serde(flatten)]
    pub gains: Gains,
    /// The printed row beside it, if the config names one.
    pub paper: Option<String>,
    /// What estimates and training cost.
    #[serde(flatten)]
    pub costs: Costs,
    /// Where it looks at no more views than it needs.
    pub adaptive: Option<AdaptiveResult>,
    /// Where its estimates came with intervals.
    pub intervals: Option<GivenIntervals>,
    /// Per property, the mean truth of each split's training part: R² is about it.
    pub training_means: PerProperty<Vec<f64>>,
    /// Of networks: the mean squared error of their estimates in training, epoch by epoch, in units of the
    /// readings' variance; over all properties and reruns.
    #[serde(default)]
    pub training_losses: Vec<f64>,
    /// Per property, the views of each rerun.
    pub selected_views: PerProperty<Vec<Vec<usize>>>,
    /// Where a selector chose them: how it went, per property and rerun.
    pub selections: PerProperty<Vec<SelectionResult>>,
    /// What a reader must know, with the reason of every `null`.
    pub notes: Vec<String>,
}

/// How the selection of views went for one property and rerun. Losses are those of the frozen
/// estimator on the training part, in units of the variance of its readings; where no loss was
/// asked for they are `null`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SelectionResult {
    /// Of the views that were chosen.
    pub loss: Number,
    /// Mean loss of random sets.
    pub random_loss: Number,
    /// The lowest loss of all sets, where an exhaustive search is a method of the experiment.
    pub optimum_loss: Number,
    /// Distance to the optimum as a share of the distance of random sets to it.
    pub regret: Number,
    /// Mean angle between two of the views; `null` for one view.
    pub mean_angle_between_deg: Number,
    /// Sets whose loss was asked for, and those that it was computed for.
    pub evaluations: u64,
    /// Sets that a loss was computed for; the others were known.
    pub computed: u64,
    /// How long the selection took.
    pub seconds: f64,
    /// Of some rounds: evaluations so far, mean loss of the round, lowest loss so far.
    pub curve: Vec<(u64, f64, f64)>,
}

impl Results {
    /// The method of that id.
    pub fn method(&self, id: &str) -> Option<&MethodResult> {
        self.methods.iter().find(|method| method.id == id)
    }

    /// The best method of those that look at a photograph; of all where none does.
    pub fn best(&self) -> Option<&MethodResult> {
        let best = |points: &[Point]| best_within(points, f64::INFINITY);
        let best = best(&looking(&self.methods)).or_else(|| best(&points(&self.methods)))?;
        self.methods.get(best.method)
    }

    /// The methods that all others are compared with.
    pub fn compared_with(&self) -> Vec<&MethodResult> {
        let against = self.against.iter();
        against.filter_map(|id| self.method(id)).collect()
    }

    /// What the intervals are and count.
    pub fn intervals_in_words(&self) -> String {
        let percent = 100.0 * self.interval_level;
        let units = self.dataset.units_in_words();
        match self.test_per_training {
            Some(_) => format!("{percent:.0} % intervals over {units} and reruns"),
            None => format!("{percent:.0} % intervals over {units} alone, not over reruns"),
        }
    }

    /// The unit of a property; empty where it has none.
    pub fn unit_of(&self, code: &str) -> &str {
        let known = self.described.get(code);
        known.map_or("", |known| known.unit.as_str())
    }

    /// The unit that all properties share; `None` where they differ.
    pub fn shared_unit(&self) -> Option<&str> {
        let mut units = self.properties.iter().map(|code| self.unit_of(code));
        let first = units.next()?;
        units.all(|unit| unit == first).then_some(first)
    }

    /// Whether any method has a percentage error.
    pub fn has_percentages(&self) -> bool {
        let mut methods = self.methods.iter();
        methods.any(|method| method.means.median_percent_error_mean.is_some())
    }

    /// Whether any method has all eight of the paper's list.
    pub fn has_top8(&self) -> bool {
        let mut methods = self.methods.iter();
        methods.any(|method| method.means.median_percent_error_top8.is_some())
    }

    /// Writes `results.json` into `folder`.
    pub(crate) fn write(&self, folder: &Path) -> Result<()> {
        let mut text = serde_json::to_string_pretty(self)?;
        text.push('\n');
        write_atomically(&folder.join("results.json"), text.as_bytes())
    }

    /// Reads `results.json`, which is at `path` or in this folder.
    ///
    /// # Errors
    /// A file that cannot be read or is damaged.
    pub fn read(path: &Path) -> Result<Self> {
        let inside = path.join("results.json");
        let path = if path.is_dir() { &inside } else { path };
        let text = read_text(path)?;
        serde_json::from_str(&text).with_context(|| format!("{} is damaged", path.display()))
    }
}
