//! An experiment as the runner works with it: every value has been checked.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use glob::Pattern;
use sps_dataset::Property;
use sps_estimator::Regression;
use sps_metrics::Level;

use super::encoder::encoder;
use super::layers::{ConfigError, Layers, Setting};
use super::method::{Method, methods, written};
use super::schema::{Config, SpeedConfig, TrainConfig};
use crate::data::{self, DataSpec, Protocol};
use crate::files::read_text;
use crate::work::Work;

const DEFAULTS: &str = include_str!("defaults.toml");

/// A checked experiment.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// The name of its file.
    pub name: String,
    pub(crate) description: String,
    pub(crate) seed: u64,
    pub(crate) reruns: usize,
    /// None: all that the dataset has.
    pub(crate) properties: Vec<Property>,
    /// What it runs on.
    pub data: DataSpec,
    pub(crate) protocol: Protocol,
    pub(crate) methods: Vec<Method>,
    /// Parts of the training surfaces between which selections are cross-validated; 1: none.
    pub(crate) selection_folds: usize,
    pub(crate) interval_level: Level,
    /// Indices of the methods that all others are compared with.
    pub(crate) against: Vec<usize>,
    pub(crate) speed: Option<SpeedConfig>,
    pub(crate) train: TrainConfig,
    /// Index of the method that is fitted as a model: the one that `train` names, or else the last that is no floor.
    pub(crate) fitted: usize,
    pub(crate) cache: PathBuf,
    /// What is done of it; all, unless the command line says otherwise.
    pub work: Work,
    /// Every key with its value, as TOML.
    pub resolved: String,
}

impl Experiment {
    /// Reads the experiment at `path` with `settings` over it.
    ///
    /// # Errors
    /// A file that cannot be read; a key or value that cannot be meant, with its line.
    pub fn read(path: &Path, settings: &[Setting]) -> Result<Self> {
        Self::parse(path, &read_text(path)?, settings)
    }

    /// Reads the experiment that `text` is, called after `path` and said in errors to be there, with
    /// `settings` over it.
    ///
    /// # Errors
    /// As [`Experiment::read`].
    pub fn parse(path: &Path, text: &str, settings: &[Setting]) -> Result<Self> {
        let defaults = DEFAULTS.parse()?;
        let layers = Layers::new(&defaults, path, text, settings)?;
        let config: Config = layers.read()?;
        Ok(Self::check(path, &layers, config)?)
    }

    /// What its first method fits, where it fits anything.
    pub fn regression(&self) -> Option<&Regression> {
        self.methods.first()?.estimator.regression()
    }

    /// Keeps the methods whose ids match one of the patterns.
    ///
    /// # Errors
    /// A pattern that matches none.
    pub fn keep_only(&mut self, patterns: &[Pattern]) -> Result<()> {
        let ids: Vec<&str> = self.methods.iter().map(|method| &method.id[..]).collect();
        for pattern in patterns {
            ensure!(
                ids.iter().any(|id| pattern.matches(id)),
                "--only {pattern}: no such method; there are {}",
                ids.join(", ")
            );
        }
        let is_kept = |at: &usize| patterns.iter().any(|pattern| pattern.matches(ids[*at]));
        let kept: Vec<usize> = (0..ids.len()).filter(is_kept).collect();
        let place = |at: &usize| kept.binary_search(at).ok();
        self.against = self.against.iter().filter_map(place).collect();
        if self.against.is_empty() {
            self.against.push(0);
        }
        self.fitted = place(&self.fitted).unwrap_or_default();
        self.methods = kept.iter().map(|&at| self.methods[at].clone()).collect();
        Ok(())
    }

    fn check(path: &Path, layers: &Layers<'_>, config: Config) -> Result<Self, ConfigError> {
        layers.require(config.reruns > 0, "reruns", "must be at least 1")?;
        encoder(layers, "encoder", &config.encoder)?;
        let (written, listed) = written(&config);
        layers.require(listed > 0, "methods", "lists no method")?;
        let folds = config.selection.folds > 0;
        layers.require(folds, "selection.folds", "must be at least 1")?;
        let share = config.train.calibration > 0.0 && config.train.calibration < 1.0;
        layers.require(share, "train.calibration", "must lie between 0 and 1")?;
        let position = |key: &str, id: &str| {
            let ids: Vec<&str> = written.iter().map(|one| &one.method.id[..]).collect();
            let position = ids.iter().position(|&other| other == id);
            position.ok_or_else(|| {
                let problem = format!("no method `{id}`; there are {}", ids.join(", "));
                layers.error(key, problem)
            })
        };
        let against = match config.report.against.as_slice() {
            [] => vec![0],
            ids => {
                let found = ids.iter().map(|id| position("report.against", id));
                found.collect::<Result<_, _>>()?
            }
        };
        let fitted = match config.train.method.as_str() {
            "" => listed - 1,
            id => position("train.method", id)?,
        };
        let (data, protocol) = data::of_config(layers, &config)?;
        let name = path.file_stem().unwrap_or_default();
        Ok(Self {
            name: name.to_string_lossy().into_owned(),
            methods: methods(layers, &config, &written, protocol)?,
            data,
            protocol,
            selection_folds: config.selection.folds,
            interval_level: config.report.level,
            against,
            speed: speed(layers, config.report.speed)?,
            train: config.train,
            fitted,
            cache: config.cache.folder,
            work: Work::All,
            description: config.description,
            seed: config.seed,
            reruns: config.reruns,
            properties: config.properties,
            resolved: layers.to_toml(),
        })
    }
}

/// What is asked about speed and error; none where it is not.
fn speed(layers: &Layers<'_>, asked: SpeedConfig) -> Result<Option<SpeedConfig>, ConfigError> {
    for (key, value) in [
        ("report.speed.within-error", asked.within_error),
        ("report.speed.within-seconds", asked.within_seconds),
    ] {
        let number = value.is_finite() && value >= 0.0;
        layers.require(number, key, "must be a number from 0 on")?;
    }
    Ok(asked.front.then_some(asked))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::fuzz::{Damage, damaged, fuzz, nested};
    use proptest::sample::select;
    use sps_dataset::TactileSettings;
    use sps_models::heads::HeadConfig;
    use sps_models::training::TrainingConfig;
    use sps_regress::kernel_ridge::KernelRidgeConfig;
    use sps_regress::ridge::RidgeConfig;
    use sps_simulate::SimulatorSpec;

    pub(in crate::config) fn read(text: &str) -> Result<Experiment> {
        Experiment::parse(Path::new("folder/test.toml"), text, &[])
    }

    pub(in crate::config) const METHOD: &str =
        "[[methods]]\nid = \"a\"\nlabel = \"A\"\nkind = \"ridge\"\n";

    /// Holds that [`METHOD`] with these keys is refused.
    pub(in crate::config) fn below(keys: &str, parts: &[&str]) {
        refused(&format!("{METHOD}{keys}"), parts);
    }

    /// Holds that the config is refused, and that the message has all these parts.
    pub(in crate::config) fn refused(text: &str, parts: &[&str]) {
        let message = read(text).unwrap_err().to_string();
        for part in parts {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }

    #[test]
    fn the_written_defaults_are_those_of_the_crates() {
        let config: Config = toml::from_str(DEFAULTS).unwrap();
        let simulated = SimulatorSpec {
            surfaces: config.data.simulated.surfaces,
            ..SimulatorSpec::default()
        };
        assert_eq!(config.data.simulated.spec(), simulated);
        assert_eq!(config.data.folder.read.tactile, TactileSettings::default());
        assert_eq!(config.head, HeadConfig::default());
        assert_eq!(config.ridge, RidgeConfig::default());
        assert_eq!(config.kernel_ridge, KernelRidgeConfig::default());
        assert_eq!(config.encoder.training, TrainingConfig::default());
    }

    #[test]
    fn some_methods_may_be_kept() {
        let text = "[report]\nagainst = [\"b-3\"]\n[[sweep]]\nid = \"b\"\nkind = \"ridge\"\n\
            grid = { views = [1, 3] }\n";
        let kept = |patterns: &[&str]| {
            let mut experiment = read(&format!("{text}{METHOD}")).unwrap();
            let patterns = patterns.iter().map(|text| Pattern::new(text).unwrap());
            experiment.keep_only(&patterns.collect::<Vec<_>>())?;
            let ids = experiment.methods.iter().map(|method| method.id.clone());
            anyhow::Ok((ids.collect::<Vec<_>>().join(" "), experiment.against))
        };
        assert_eq!(kept(&["b*"]).unwrap(), ("b-1 b-3".to_owned(), vec![1]));
        assert_eq!(kept(&["a", "*-1"]).unwrap(), ("a b-1".to_owned(), vec![0]));
        let error = kept(&["b*", "c*"]).unwrap_err().to_string();
        let begins = "--only c*: no such method; there are a, b-1";
        assert!(error.starts_with(begins), "{error}");
    }

    #[test]
    fn an_experiment_takes_its_name_from_its_file() {
        let experiment = read(METHOD).unwrap();
        assert_eq!((experiment.name.as_str(), experiment.reruns), ("test", 3));
    }

    #[test]
    fn only_random_weights_are_normed_by_each_batch_unless_asked_for() {
        for (keys, expected) in [
            ("", true),
            ("weights = \"untrained\"", false),
            (
                "weights = \"untrained\"\ntraining.running-statistics = true",
                true,
            ),
            ("training.running-statistics = false", false),
        ] {
            let encoder = format!("[encoder]\ntrainable = true\n{keys}\n{METHOD}");
            let encoder = &read(&encoder).unwrap().methods[0].encoder;
            let training = encoder.training.as_ref().unwrap();
            assert_eq!(training.running_statistics, Some(expected), "{keys}");
        }
    }

    #[test]
    fn what_cannot_be_meant_is_refused_at_its_line() {
        refused("", &["lists no method"]);
        let above = |keys: &str, parts: &[&str]| refused(&format!("{keys}\n{METHOD}"), parts);
        above("reruns = 0", &["line 1", "at least 1"]);
        above(METHOD.trim_end(), &["line 6", "two methods", "`a`"]);
        let parts = ["line 1", "`properties.0`", "for example `a-b`"];
        above("properties = [\"a b\"]", &parts);
        above("[encoder]\nname = \"vgg\"", &["line 2", "vgg"]);
        above("[report]\nlevel = 95.0", &["line 2", "95"]);
        above("[train]\nmethod = \"b\"", &["line 2", "no method `b`"]);
        above("[data]\nfrom = \"folder\"", &["names no folder"]);
        let folder = "[data]\nfrom = \"folder\"\n[data.folder]\npath = \"x\"\nnear-twins = ";
        let parts = ["line 5", "near-twins", "is 1.5", "at most 1"];
        above(&format!("{folder}1.5"), &parts);
        let parts = ["line 5", "near-twins", "by = \"group\""];
        let split = "[split.k-fold]\nby = \"surface\"";
        above(&format!("{folder}0.75\n{split}"), &parts);
        below("kind = \"head\"", &["duplicate key"]);
        let parts = ["line 5", "did you mean `ablation.1`"];
        below("paper = \"ablatoin.1\"", &parts);
        let nvs = "selector = { kind = \"nvs\", evaluation = 3 }";
        below(nvs, &["line 5", "evaluation"]);
        let i3d = |keys: &str, parts: &[&str]| {
            below(&format!("[methods.encoder]\nname = \"i3d\"\n{keys}"), parts);
        };
        i3d("frames = 0", &["line 7", "at least 1"]);
        let heads = "trainable = true\n[methods.encoder.training.objective]\nkind = \"heads\"\n\
            input = { kind = \"late-fusion\", views = 3 }";
        i3d(heads, &["line 8", "sees one sequence"]);
        let built_in = "efficientnet-lite-body";
        let parts = ["line 5", "encoder.weights", "resnet18", built_in];
        below("encoder.name = \"resnet18\"", &parts);
        let encoder = |keys: &str, parts: &[&str]| below(&format!("encoder = {{ {keys} }}"), parts);
        encoder("size = 224", &["line 5", "encoder.size", "needs `onnx`"]);
        let files = "onnx = \"a.onnx\", embeddings = \"a.npy\"";
        let parts = ["line 5", "encoder.embeddings", "beside `onnx`"];
        encoder(files, &parts);
        for key in [
            "trainable = true",
            "precision = \"bf16\"",
            "depths = \"last\"",
            "weights = \"a\"",
        ] {
            let parts = ["line 5", &key[..5], "no meaning beside"];
            encoder(&format!("onnx = \"a.onnx\", {key}"), &parts);
        }
        let head = METHOD.replace("ridge", "head");
        refused(&format!("{head}head.epochs = 0"), &["line 5", "epochs"]);
    }

    #[test]
    fn any_damage_to_a_config_is_an_error_with_a_place() {
        let read = |text: &str| {
            if let Err(error) = read(text) {
                assert!(error.to_string().contains("test.toml"), "{error}");
            }
        };
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        let names = ["ablation", "end-to-end", "friction-photos", "view-counts"];
        let texts =
            names.map(|name| std::fs::read_to_string(folder.join(format!("{name}.toml"))).unwrap());
        let mut texts = texts.to_vec();
        texts.push(format!("{DEFAULTS}\n{METHOD}"));
        let input = (select(texts), Damage::some());
        fuzz("experiments", &input, |(text, damages)| {
            let text = damaged(text.into_bytes(), &damages);
            read(&String::from_utf8_lossy(&text));
        });
        nested("experiments", |text| {
            read(&text);
            read(&format!("{METHOD}{text}"));
        });
    }
}
