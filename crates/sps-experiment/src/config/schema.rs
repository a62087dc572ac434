//! The keys of an experiment as they are written; `defaults.toml` and, of methods, `docs/config.md` say what
//! each means.

use std::fmt;
use std::path::PathBuf;
use std::sync::LazyLock;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use sps_dataset::{Property, SplitPlan};
use sps_metrics::Level;
use sps_models::encoders::Depths;
use sps_models::heads::HeadConfig;
use sps_models::training::TrainingConfig;
use sps_regress::kernel_ridge::{Kernel, KernelRidgeConfig};
use sps_regress::ridge::RidgeConfig;
use sps_regress::{RegressorKind, RegressorSettings};
use sps_viewselect::{AnySelector, TemporalRelations};

use crate::data::DataConfig;

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Config {
    pub description: String,
    pub seed: u64,
    pub reruns: usize,
    pub properties: Vec<Property>,
    pub data: DataConfig,
    pub split: Option<SplitPlan>,
    pub encoder: EncoderConfig,
    pub head: HeadConfig,
    pub ridge: RidgeConfig,
    pub kernel_ridge: KernelRidgeConfig,
    pub floors: Vec<MethodKind>,
    pub selection: SelectionConfig,
    #[serde(default)]
    pub methods: Vec<MethodConfig>,
    /// The methods of each sweep.
    #[serde(default)]
    pub sweep: Vec<Vec<MethodConfig>>,
    pub report: ReportConfig,
    pub train: TrainConfig,
    pub cache: CacheConfig,
}

impl Config {
    pub(super) fn regressors(&self) -> RegressorSettings {
        RegressorSettings {
            ridge: self.ridge.clone(),
            kernel_ridge: self.kernel_ridge.clone(),
        }
    }
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct EncoderConfig {
    pub name: String,
    pub onnx: Option<PathBuf>,
    pub outputs: Option<Vec<String>>,
    pub size: Option<usize>,
    pub mean: Option<[f32; 3]>,
    pub std: Option<[f32; 3]>,
    pub embeddings: Option<PathBuf>,
    pub depths: Depths,
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

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct MethodConfig {
    pub id: String,
    pub label: String,
    pub kind: MethodKind,
    pub file: Option<PathBuf>,
    #[serde(default)]
    pub members: Vec<MethodKind>,
    #[serde(default = "five")]
    pub folds: usize,
    pub paper: Option<String>,
    /// The top-level `encoder` with the method's own laid over it.
    pub encoder: EncoderConfig,
    /// The top-level `head` with the method's own laid over it.
    pub head: HeadConfig,
    #[serde(default)]
    pub views: ViewCount,
    pub selector: Option<AnySelector>,
    #[serde(default)]
    pub distinct: bool,
    pub refit: Option<RefitConfig>,
    pub relations: Option<TemporalRelations>,
    pub adaptive: Option<Adaptive>,
    pub test_surfaces: Option<usize>,
    pub training_surfaces: Option<usize>,
}

/// How many views an estimate looks at: a number, at least 1, or "all".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ViewCount {
    Number(usize),
    All,
}

impl fmt::Display for ViewCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::All => f.write_str("\"all\""),
        }
    }
}

impl Default for ViewCount {
    fn default() -> Self {
        Self::Number(1)
    }
}

impl<'de> Deserialize<'de> for ViewCount {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = toml::Value::deserialize(deserializer)?;
        if value.as_str() == Some("all") {
            return Ok(Self::All);
        }
        let number = value.as_integer().and_then(|n| usize::try_from(n).ok());
        let number = number.filter(|&number| number > 0).map(Self::Number);
        number
            .ok_or_else(|| D::Error::custom(format!("is {value}, expected at least 1, or \"all\"")))
    }
}

/// How sets of views are compared by regression that is fitted anew to each.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct RefitConfig {
    #[serde(default)]
    pub kernel: Kernel,
    pub pooled: Option<f64>,
    #[serde(default)]
    pub judged_on: JudgedOn,
}

/// Which surfaces say what a set is worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum JudgedOn {
    /// The training surfaces, each left out in turn.
    #[default]
    Training,
    /// Those held out, in hindsight: no method, but what was there to be had.
    HeldOut,
}

/// A surface has been looked at enough at the first number of views whose interval is so narrow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Adaptive {
    pub width: f64,
    #[serde(default = "ninety_percent")]
    pub level: Level,
    #[serde(default = "a_fifth")]
    pub calibration: f64,
}

fn ninety_percent() -> Level {
    Level::P90
}

fn a_fifth() -> f64 {
    0.2
}

fn five() -> usize {
    5
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum MethodKind {
    #[default]
    Head,
    /// A regressor that takes embeddings as rows of numbers.
    Rows(RegressorKind),
    /// Several kinds, weighed by how well each does out of fold.
    Stacked,
    /// The mean of the training readings.
    Mean,
    /// The mean of the training readings of the surface's own material: what a perfect reader of
    /// labels would say.
    LabelMean,
    /// What another system estimates, from a file.
    Predictions,
}

impl<'de> Deserialize<'de> for MethodKind {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        static NAMES: LazyLock<Vec<&'static str>> =
            LazyLock::new(|| MethodKind::all().map(MethodKind::name).collect());
        let name = String::deserialize(deserializer)?;
        let found = Self::all().find(|kind| kind.name() == name);
        found.ok_or_else(|| D::Error::unknown_variant(&name, &NAMES))
    }
}

impl MethodKind {
    fn all() -> impl Iterator<Item = Self> {
        use MethodKind::{Head, LabelMean, Mean, Predictions, Stacked};
        let rows = RegressorKind::ALL.into_iter().map(Self::Rows);
        [Head]
            .into_iter()
            .chain(rows)
            .chain([Stacked, Mean, LabelMean, Predictions])
    }

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Head => "head",
            Self::Rows(kind) => kind.name(),
            Self::Stacked => "stacked",
            Self::Mean => "mean",
            Self::LabelMean => "label-mean",
            Self::Predictions => "predictions",
        }
    }

    /// Whether it looks at the embeddings of views.
    pub(crate) const fn looks(self) -> bool {
        !matches!(self, Self::Mean | Self::LabelMean | Self::Predictions)
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct ReportConfig {
    pub level: Level,
    pub against: Vec<String>,
    pub speed: SpeedConfig,
}

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
    pub level: Level,
    pub keep_photographs: bool,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct CacheConfig {
    pub folder: PathBuf,
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::de::DeserializeOwned;
    use sps_base::names::UnknownName;

    /// The keys of a table, by what serde says of one that it has not.
    fn keys<T: DeserializeOwned>() -> Vec<String> {
        keys_in::<T>("")
    }

    /// The keys of a table inside.
    fn keys_in<T: DeserializeOwned>(heading: &str) -> Vec<String> {
        let text = format!("{heading}\nno-such-key = 1");
        let error = toml::from_str::<T>(&text).err().unwrap();
        UnknownName::of_serde(error.message()).unwrap().expected
    }

    #[test]
    fn the_page_in_docs_names_every_key_of_methods_and_splits() {
        let page = include_str!("../../../../docs/config.md");
        let methods = keys::<MethodConfig>();
        assert!(methods.len() > 12, "{methods:?}");
        let inside = [
            keys::<RefitConfig>(),
            keys::<TemporalRelations>(),
            keys::<Adaptive>(),
        ];
        let splits = ["random", "k-fold", "leave-one-out"]
            .map(|plan| keys_in::<SplitPlan>(&format!("[{plan}]")));
        for key in methods.iter().chain(inside.iter().chain(&splits).flatten()) {
            let row = |line: &str| line.starts_with('|') && line.contains(&format!("| `{key}` |"));
            let has_row = page.lines().any(row);
            assert!(has_row, "docs/config.md has no row for `{key}`");
        }
    }
}
