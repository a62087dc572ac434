//! An experiment as the runner works with it: every value has been checked.

use std::path::{Path, PathBuf};

use anyhow::Result;
use sps_base::names::nearest;
use sps_dataset::Property;
use sps_metrics::{Bootstrap, Level};
use sps_models::encoders::{EncoderKind, I3d, Precision};
use sps_models::training::TrainingConfig;

use super::adaptive::{self, Adaptive};
use super::data::{DataSpec, Protocol, data};
use super::estimator::{self, Estimator};
use super::locate::{ConfigError, Layers, Setting};
use super::looks::{self, Looks};
use super::schema::{Config, EncoderConfig, MethodConfig, SelectorConfig};
use super::sweep::{self, Written};
use crate::files::read_text;
use crate::report::paper;

const DEFAULTS: &str = include_str!("defaults.toml");

/// A checked experiment.
#[derive(Clone, Debug)]
pub(crate) struct Experiment {
    /// The name of its file.
    pub name: String,
    pub description: String,
    pub seed: u64,
    pub reruns: usize,
    /// None: all that the dataset has.
    pub properties: Vec<Property>,
    pub data: DataSpec,
    pub protocol: Protocol,
    pub methods: Vec<Method>,
    /// Parts of the training surfaces between which selections are cross-validated; 1: none.
    pub selection_folds: usize,
    pub bootstrap: Bootstrap,
    pub interval_level: Level,
    /// Indices of the methods that all others are compared with.
    pub against: Vec<usize>,
    /// What is asked about speed and error; none where it is not.
    pub speed: Option<SpeedSpec>,
    pub train: TrainSpec,
    pub cache: PathBuf,
    /// Every key with its value, as TOML.
    pub resolved: String,
}

/// The two questions about speed and error.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SpeedSpec {
    /// Share of the best error that the fastest method may lie above it.
    pub within_error: f64,
    /// Seconds per surface that the method of least error may take.
    pub within_seconds: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct EncoderSpec {
    pub network: Network,
    pub weights: WeightsSpec,
    pub precision: Precision,
    /// Pixels of the shorter side.
    pub resize: Option<usize>,
    /// How it is trained on the training part of each rerun; `None` leaves it as it is.
    pub training: Option<TrainingConfig>,
}

/// What turns frames into embeddings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Network {
    /// A network that takes one frame.
    Images(EncoderKind),
    /// I3D, which takes a sequence of so many.
    Sequences { frames: usize },
}

impl Network {
    /// The network of this name; `frames` is the length of a sequence.
    pub(crate) fn named(name: &str, frames: usize) -> Result<Self, sps_models::Error> {
        if name == I3d::NAME {
            return Ok(Self::Sequences { frames });
        }
        name.parse().map(Self::Images)
    }

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Images(kind) => kind.name(),
            Self::Sequences { .. } => I3d::NAME,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum WeightsSpec {
    /// Those that come with the project.
    BuiltIn,
    /// Random ones.
    Untrained,
    File(PathBuf),
}

impl WeightsSpec {
    /// `built-in`, `untrained`, or a file.
    pub(crate) fn named(name: &str) -> Self {
        match name {
            "built-in" => Self::BuiltIn,
            "untrained" => Self::Untrained,
            path => Self::File(PathBuf::from(path)),
        }
    }
}

/// One row of the report.
#[derive(Clone, Debug)]
pub(crate) struct Method {
    pub id: String,
    pub label: String,
    pub encoder: EncoderSpec,
    pub estimator: Estimator,
    /// The views that an estimate looks at.
    pub looks: Looks,
    /// Whether it looks at them one at a time, and at no more than needed.
    pub adaptive: Option<Adaptive>,
    /// The printed row beside it.
    pub paper: Option<String>,
    /// Scored on the first so many of the held-out surfaces; `None`: on all.
    pub test_surfaces: Option<usize>,
    /// Trained on so many of a rerun's training surfaces; `None`: on all.
    pub training_surfaces: Option<usize>,
}

impl Method {
    /// What its encoder computes in; none where it looks at nothing.
    pub(crate) fn precision(&self) -> Option<String> {
        (self.looks != Looks::Nothing).then(|| self.encoder.precision.to_string())
    }

    /// Those of the held-out surfaces that the method is scored on.
    pub(crate) fn scored_on<'a>(&self, held_out: &'a [usize]) -> &'a [usize] {
        let count = self.test_surfaces.unwrap_or(held_out.len());
        &held_out[..count.min(held_out.len())]
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct TrainSpec {
    /// Index of the method to fit.
    pub method: usize,
    pub calibration: f64,
    pub level: Level,
}

impl Experiment {
    /// Reads the experiment at `path` with `settings` over it.
    pub(crate) fn read(path: &Path, settings: &[Setting]) -> Result<Self> {
        let text = read_text(path)?;
        let defaults = DEFAULTS.parse()?;
        let layers = Layers::new(&defaults, path, &text, settings)?;
        let config: Config = layers.read()?;
        Ok(Self::check(path, &layers, config)?)
    }

    fn check(path: &Path, layers: &Layers<'_>, config: Config) -> Result<Self, ConfigError> {
        let resolved = layers.to_toml();
        let properties = config.properties.iter().enumerate().map(|(index, code)| {
            code.parse::<Property>()
                .map_err(|error| layers.error(&format!("properties.{index}"), error.to_string()))
        });
        require(layers, config.reruns > 0, "reruns", "must be at least 1")?;
        encoder(layers, "encoder", &config.encoder)?;
        let written = sweep::written(&config);
        let listed = !sweep::asked_for(&config).is_empty();
        require(layers, listed, "methods", "lists no method")?;
        let folds = config.selection.folds > 0;
        require(layers, folds, "selection.folds", "must be at least 1")?;
        let interval_level = level(layers, "report.level", config.report.level)?;
        let (data, protocol) = data(layers, &config)?;
        Ok(Self {
            name: path
                .file_stem()
                .map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            seed: config.seed,
            reruns: config.reruns,
            properties: properties.collect::<Result<_, _>>()?,
            methods: methods(layers, &config, &written, protocol)?,
            data,
            protocol,
            selection_folds: config.selection.folds,
            bootstrap: Bootstrap::new(config.seed)
                .with_level(interval_level)
                .with_resamples(config.report.resamples),
            interval_level,
            against: against(layers, &config, &written)?,
            speed: speed(layers, &config)?,
            train: train(layers, &config, &written)?,
            cache: config.cache.folder,
            description: config.description,
            resolved,
        })
    }
}

fn require(layers: &Layers<'_>, holds: bool, key: &str, problem: &str) -> Result<(), ConfigError> {
    if holds {
        Ok(())
    } else {
        Err(layers.error(key, problem))
    }
}

fn level(layers: &Layers<'_>, key: &str, value: f64) -> Result<Level, ConfigError> {
    Level::new(value).map_err(|error| layers.error(key, error.to_string()))
}

/// The encoder of the table at `key`.
fn encoder(
    layers: &Layers<'_>,
    key: &str,
    encoder: &EncoderConfig,
) -> Result<EncoderSpec, ConfigError> {
    let network = Network::named(&encoder.name, encoder.frames);
    let network = network.map_err(|error| {
        let problem = format!("{error}, {}", I3d::NAME);
        layers.error(&format!("{key}.name"), problem)
    })?;
    if let Network::Sequences { frames } = network {
        let at = |field: &str| format!("{key}.{field}");
        require(layers, frames > 0, &at("frames"), "must be at least 1")?;
        let frozen = !encoder.trainable;
        require(layers, frozen, &at("trainable"), "i3d is not trained here")?;
    }
    let precision = encoder.precision.parse();
    let precision = precision.map_err(|error: sps_models::Error| {
        layers.error(&format!("{key}.precision"), error.to_string())
    })?;
    check_training(layers, &format!("{key}.training"), &encoder.training)?;
    Ok(EncoderSpec {
        network,
        weights: WeightsSpec::named(&encoder.weights),
        precision,
        resize: (encoder.resize > 0).then_some(encoder.resize),
        training: encoder.trainable.then(|| encoder.training.clone()),
    })
}

/// Refuses a training that cannot be, at the line of its first such key.
pub(super) fn check_training(
    layers: &Layers<'_>,
    table: &str,
    training: &TrainingConfig,
) -> Result<(), ConfigError> {
    match training.check() {
        Ok(()) => Ok(()),
        Err(sps_models::Error::Input {
            what,
            found,
            expected,
        }) => {
            let problem = format!("is {found}, expected {expected}");
            Err(layers.error(&format!("{table}.{what}"), problem))
        }
        Err(other) => Err(layers.error(table, other.to_string())),
    }
}

fn methods(
    layers: &Layers<'_>,
    config: &Config,
    written: &[Written],
    protocol: Protocol,
) -> Result<Vec<Method>, ConfigError> {
    let mut methods: Vec<Method> = Vec::new();
    for Written { at, method } in written {
        let key = |field: &str| format!("{at}.{field}");
        if methods.iter().any(|other| other.id == method.id) {
            let problem = format!("two methods have the id `{}`", method.id);
            return Err(layers.error(&key("id"), problem));
        }
        if let Some(name) = method
            .paper
            .as_deref()
            .filter(|name| paper::row(name).is_none())
        {
            return Err(layers.error(&key("paper"), unknown_row(name)));
        }
        let looks = looks::of(config, method)
            .map_err(|(field, problem)| layers.error(&key(field), problem))?;
        methods.push(Method {
            id: method.id.clone(),
            label: method.label.clone(),
            encoder: encoder(layers, &key("encoder"), &method.encoder)?,
            estimator: estimator::of(config, method)
                .map_err(|(field, problem)| layers.error(&key(field), problem))?,
            adaptive: adaptive::of(method, &looks)
                .map_err(|(field, problem)| layers.error(&key(field), problem))?,
            looks,
            paper: method.paper.clone(),
            test_surfaces: test_surfaces(method, protocol)
                .map_err(|problem| layers.error(&key("test-surfaces"), problem))?,
            training_surfaces: training_surfaces(method)
                .map_err(|problem| layers.error(&key("training-surfaces"), problem))?,
        });
    }
    Ok(methods)
}

fn test_surfaces(method: &MethodConfig, protocol: Protocol) -> Result<Option<usize>, String> {
    let Some(count) = method.test_surfaces else {
        return Ok(None);
    };
    match protocol {
        Protocol::TestSurfaces(all) if (1..=all.test).contains(&count) => Ok(Some(count)),
        Protocol::TestSurfaces(all) => Err(format!("is {count}, expected 1 to {}", all.test)),
        Protocol::Split(_) => Err("needs surfaces that exist for scoring alone".to_owned()),
    }
}

fn training_surfaces(method: &MethodConfig) -> Result<Option<usize>, String> {
    let learned = method.adaptive.is_some() || method.relations.is_some();
    let fixed = method
        .selector
        .as_ref()
        .is_none_or(SelectorConfig::is_fixed);
    match method.training_surfaces {
        None => Ok(None),
        Some(0) => Err("must be at least 1".to_owned()),
        Some(_) if learned || !fixed => Err("needs views that do not depend on them".to_owned()),
        Some(_) if method.encoder.trainable => {
            Err("needs an encoder that is not trained".to_owned())
        }
        some => Ok(some),
    }
}

fn unknown_row(name: &str) -> String {
    let names = paper::names();
    match nearest(name, names.iter().map(String::as_str)) {
        Some(nearest) => format!("the paper has no row `{name}`, did you mean `{nearest}`?"),
        None => format!("the paper has no row `{name}`; it has {}", names.join(", ")),
    }
}

fn speed(layers: &Layers<'_>, config: &Config) -> Result<Option<SpeedSpec>, ConfigError> {
    let speed = config.report.speed;
    let (error, seconds) = (speed.within_error, speed.within_seconds);
    for (key, value) in [("error", error), ("seconds", seconds)] {
        let key = format!("report.speed.within-{key}");
        let number = value.is_finite() && value >= 0.0;
        require(layers, number, &key, "must be a number from 0 on")?;
    }
    Ok(speed.front.then_some(SpeedSpec {
        within_error: error,
        within_seconds: seconds,
    }))
}

fn against(
    layers: &Layers<'_>,
    config: &Config,
    written: &[Written],
) -> Result<Vec<usize>, ConfigError> {
    if config.report.against.is_empty() {
        return Ok(vec![0]);
    }
    let ids = config.report.against.iter();
    ids.map(|id| position(layers, written, "report.against", id))
        .collect()
}

/// The index of the method that `key` names.
fn position(
    layers: &Layers<'_>,
    written: &[Written],
    key: &str,
    id: &str,
) -> Result<usize, ConfigError> {
    let ids: Vec<&str> = written.iter().map(|one| one.method.id.as_str()).collect();
    let position = ids.iter().position(|&other| other == id);
    position.ok_or_else(|| {
        let problem = format!("no method `{id}`; there are {}", ids.join(", "));
        layers.error(key, problem)
    })
}

fn train(
    layers: &Layers<'_>,
    config: &Config,
    written: &[Written],
) -> Result<TrainSpec, ConfigError> {
    let train = &config.train;
    let method = if train.method.is_empty() {
        sweep::asked_for(config).len().saturating_sub(1)
    } else {
        position(layers, written, "train.method", &train.method)?
    };
    let share = train.calibration > 0.0 && train.calibration < 1.0;
    require(
        layers,
        share,
        "train.calibration",
        "must lie between 0 and 1",
    )?;
    Ok(TrainSpec {
        method,
        calibration: train.calibration,
        level: level(layers, "train.level", train.level)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::schema::Config;
    use crate::fuzz::{Damage, damaged, fuzz, nested};
    use proptest::sample::select;
    use sps_dataset::TactileSettings;
    use sps_models::heads::HeadConfig;
    use sps_models::kernel_ridge::KernelRidgeConfig;
    use sps_models::ridge::RidgeConfig;
    use sps_simulate::SimulatorSpec;

    fn read(text: &str) -> Result<Experiment, ConfigError> {
        let defaults = DEFAULTS.parse().unwrap();
        let path = Path::new("folder/test.toml");
        let layers = Layers::new(&defaults, path, text, &[])?;
        Experiment::check(path, &layers, layers.read()?)
    }

    const METHOD: &str = "[[methods]]\nid = \"a\"\nlabel = \"A\"\nkind = \"ridge\"\n";

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
    fn an_experiment_takes_its_name_from_its_file() {
        let experiment = read(METHOD).unwrap();
        assert_eq!((experiment.name.as_str(), experiment.reruns), ("test", 3));
    }

    #[test]
    fn what_cannot_be_meant_is_refused_at_its_line() {
        let refused = |text: &str, parts: &[&str]| {
            let message = read(text).unwrap_err().to_string();
            for part in parts {
                assert!(message.contains(part), "`{part}` is not in: {message}");
            }
        };
        refused("", &["lists no method"]);
        refused(&format!("reruns = 0\n{METHOD}"), &["line 1", "at least 1"]);
        refused(
            &format!("{METHOD}{METHOD}"),
            &["line 6", "two methods", "`a`"],
        );
        refused(
            &format!("{METHOD}paper = \"ablatoin.1\""),
            &["line 5", "did you mean `ablation.1`"],
        );
        refused(
            &format!("[encoder]\nname = \"vgg\"\n{METHOD}"),
            &["line 2", "vgg"],
        );
        refused(
            &format!("[data]\nfrom = \"folder\"\n{METHOD}"),
            &["names no folder"],
        );
        refused(
            &format!("[report]\nlevel = 95.0\n{METHOD}"),
            &["line 2", "95"],
        );
        refused(
            &format!("[train]\nmethod = \"b\"\n{METHOD}"),
            &["line 2", "no method `b`"],
        );
        refused(
            &format!("[head]\nepochs = 0\n{METHOD}kind = \"head\""),
            &["duplicate key"],
        );
        refused(
            &format!("{METHOD}views = 3"),
            &["line 5", "needs a `selector`"],
        );
        refused(
            &format!("{METHOD}views = 3\nselector = {{ kind = \"nvs\" }}"),
            &["line 6", "kind `head`"],
        );
        refused(
            &format!("{METHOD}selector = {{ kind = \"nvs\", evaluation = 3 }}"),
            &["line 5", "evaluation"],
        );
        refused(
            &format!("{METHOD}all-views = true\nselector = {{ kind = \"random\" }}"),
            &["line 6", "cannot stand beside `all-views`"],
        );
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
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
        let names = ["ablation", "fine-tuning", "friction-photos", "view-counts"];
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
