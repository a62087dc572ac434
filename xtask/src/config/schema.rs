//! The keys of an experiment as they are written; `defaults.toml` says what each means.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use sps_dataset::simulate::SimulatorSpec;
use sps_dataset::{ReadSettings, SplitPlan};
use sps_models::heads::HeadConfig;
use sps_models::ridge::RidgeConfig;
use sps_models::training::TrainingConfig;
use sps_viewselect::{
    Equidistant, Exhaustive, Greedy, Nadir, Nvs, Random, TemporalRelations, VbNvs,
};

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Config {
    pub description: String,
    pub seed: u64,
    pub reruns: usize,
    pub properties: Vec<String>,
    pub data: DataConfig,
    #[serde(default)]
    pub split: SplitPlan,
    pub encoder: EncoderConfig,
    #[cfg_attr(
        not(test),
        expect(dead_code, reason = "checked here; the methods inherit it")
    )]
    pub head: HeadConfig,
    pub ridge: RidgeConfig,
    pub selection: SelectionConfig,
    #[serde(default)]
    pub methods: Vec<MethodConfig>,
    #[serde(default)]
    pub sweep: Vec<SweepConfig>,
    pub report: ReportConfig,
    pub train: TrainConfig,
    pub cache: CacheConfig,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct DataConfig {
    pub from: DataOrigin,
    pub simulated: SimulatorSpec,
    pub folder: FolderConfig,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum DataOrigin {
    Simulator,
    Folder,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct FolderConfig {
    pub path: PathBuf,
    pub published_sps: bool,
    pub read: ReadSettings,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct EncoderConfig {
    pub name: String,
    pub weights: String,
    pub precision: String,
    pub frames: usize,
    pub resize: usize,
    pub trainable: bool,
    pub training: TrainingConfig,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct SelectionConfig {
    pub folds: usize,
}

/// A method for each of several numbers of views and each of several kinds.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct SweepConfig {
    /// What the ids of its methods begin with; number of views and kind follow.
    pub id: String,
    /// What their labels begin with.
    pub label: String,
    /// The top-level `encoder` with the sweep's own laid over it.
    pub encoder: EncoderConfig,
    /// The top-level `head` with the sweep's own laid over it.
    pub head: HeadConfig,
    pub kinds: Vec<MethodKind>,
    pub views: Vec<usize>,
    /// All views as well.
    #[serde(default)]
    pub all_views: bool,
    /// Chooses the views where there are several.
    #[serde(default = "equidistant")]
    pub selector: SelectorConfig,
}

fn equidistant() -> SelectorConfig {
    SelectorConfig::Equidistant(Equidistant::default())
}

/// One row of the report.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct MethodConfig {
    /// Names the method in files; unique.
    pub id: String,
    /// Names it in the report.
    pub label: String,
    pub kind: MethodKind,
    /// The printed row that stands beside it in the report.
    pub paper: Option<String>,
    /// The top-level `encoder` with the method's own laid over it.
    pub encoder: EncoderConfig,
    /// The top-level `head` with the method's own laid over it.
    pub head: HeadConfig,
    /// Views of a surface that an estimate looks at: 1 is the view straight down, more are chosen
    /// by the selector.
    #[serde(default = "one")]
    pub views: usize,
    /// All views, instead.
    #[serde(default)]
    pub all_views: bool,
    /// Chooses the views, for each property and rerun.
    pub selector: Option<SelectorConfig>,
    /// Whether the selector may not choose a view twice.
    #[serde(default)]
    pub distinct: bool,
    /// Related views of a temporal relation network, instead.
    pub relations: Option<TemporalRelations>,
    /// Looks at the selected views one at a time, and at no more than a surface needs.
    pub adaptive: Option<AdaptiveConfig>,
}

/// When a surface has been looked at enough.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct AdaptiveConfig {
    /// The width of an interval that is narrow enough, in standard deviations of the training
    /// readings.
    pub width: f64,
    /// Share of surfaces that an interval must hold.
    #[serde(default = "ninety_percent")]
    pub level: f64,
    /// Share of the training surfaces that the intervals are calibrated on.
    #[serde(default = "a_fifth")]
    pub calibration: f64,
}

fn ninety_percent() -> f64 {
    0.9
}

fn a_fifth() -> f64 {
    0.2
}

fn one() -> usize {
    1
}

/// A selector of `sps-viewselect` with its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub(crate) enum SelectorConfig {
    Random(Random),
    Equidistant(Equidistant),
    Nadir(Nadir),
    Nvs(Nvs),
    VbNvs(VbNvs),
    Greedy(Greedy),
    Exhaustive(Exhaustive),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum MethodKind {
    Head,
    Ridge,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct ReportConfig {
    pub level: f64,
    pub resamples: usize,
    pub against: Vec<String>,
    pub speed: SpeedConfig,
}

/// Speed against error.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct SpeedConfig {
    pub front: bool,
    pub within_error: f64,
    pub within_seconds: f64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct TrainConfig {
    pub method: String,
    pub calibration: f64,
    pub level: f64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct CacheConfig {
    pub folder: PathBuf,
}
