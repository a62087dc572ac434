//! The rows of the report: the methods that a config lists, those of its sweeps, and the floors under all
//! others.

use sps_base::names::UnknownName;
use sps_estimator::Regression;
use sps_viewselect::AnySelector;

use super::encoder::{EncoderSpec, encoder};
use super::estimator::{self, Estimator};
use super::layers::{ConfigError, Layers};
use super::looks::{self, Looks, Problem, refuse};
use super::schema::{Adaptive, Config, MethodConfig, MethodKind};
use crate::data::Protocol;
use crate::paper;

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

    /// Whether another rerun on the same surfaces may estimate otherwise: because fitting to so many
    /// of them draws something at random, or because a file may have estimates for each rerun.
    pub(crate) fn differs_by_rerun(&self, training_surfaces: usize) -> bool {
        let regression = self.estimator.regression();
        self.adaptive.is_some()
            || self.estimator.file().is_some()
            || regression.is_some_and(|regression| {
                matches!(regression, Regression::Head(_) | Regression::Stacked(_))
                    || self.estimator.thinned(training_surfaces).is_some()
            })
    }

    /// Those of the held-out surfaces that the method is scored on.
    pub(crate) fn scored_on<'a>(&self, held_out: &'a [usize]) -> &'a [usize] {
        let count = self.test_surfaces.unwrap_or(held_out.len());
        &held_out[..count.min(held_out.len())]
    }
}

/// A method, and where the config has it.
pub(super) struct Written {
    /// The key of the table, dotted.
    pub at: String,
    /// The key of its head, with an index for each method of a sweep.
    pub head: String,
    pub method: MethodConfig,
}

/// All methods: those listed, those of the sweeps, and the floors that are not among them; and how many are
/// no floors.
pub(super) fn written(config: &Config) -> (Vec<Written>, usize) {
    let mut all = Vec::new();
    let mut add = |at: String, head: String, method| all.push(Written { at, head, method });
    for (index, method) in config.methods.iter().enumerate() {
        let at = format!("methods.{index}");
        add(at.clone(), format!("{at}.head"), method.clone());
    }
    for (index, methods) in config.sweep.iter().enumerate() {
        let at = format!("sweep.{index}");
        for (of, method) in methods.iter().enumerate() {
            add(at.clone(), format!("{at}.{of}.head"), method.clone());
        }
    }
    let listed = all.len();
    for &kind in &config.floors {
        let method = floor(config, kind);
        if all[..listed].iter().all(|one| one.method.id != method.id) {
            let [at, head] = ["floors", "head"].map(str::to_owned);
            all.push(Written { at, head, method });
        }
    }
    (all, listed)
}

/// One view, the encoder of the config.
fn floor(config: &Config, kind: MethodKind) -> MethodConfig {
    let label = match kind {
        MethodKind::Head => "Head",
        MethodKind::Rows(kind) => kind.label(),
        MethodKind::Stacked => "Stacked",
        MethodKind::Mean => "Mean of the training part",
        MethodKind::LabelMean => "Mean of the surface's material",
        MethodKind::Predictions => "Estimates from a file",
    };
    MethodConfig {
        id: kind.name().to_owned(),
        label: label.to_owned(),
        kind,
        encoder: config.encoder.clone(),
        head: config.head.clone(),
        ..MethodConfig::default()
    }
}

pub(super) fn methods(
    layers: &Layers<'_>,
    config: &Config,
    written: &[Written],
    protocol: Protocol,
) -> Result<Vec<Method>, ConfigError> {
    let mut methods: Vec<Method> = Vec::new();
    for Written { at, head, method } in written {
        let key = |field: &str| format!("{at}.{field}");
        let refused = |(field, problem): Problem| layers.error(&key(field), problem);
        if methods.iter().any(|other| other.id == method.id) {
            let problem = format!("two methods have the id `{}`", method.id);
            return Err(refused(("id", problem)));
        }
        check_printed_row(method).map_err(refused)?;
        let given_input = layers.has(&format!("{head}.input"));
        let looks = looks::of(config, method, given_input).map_err(refused)?;
        methods.push(Method {
            id: method.id.clone(),
            label: method.label.clone(),
            encoder: encoder(layers, &key("encoder"), &method.encoder)?,
            estimator: estimator::of(config, method).map_err(refused)?,
            adaptive: adaptive(method, &looks).map_err(refused)?,
            looks,
            paper: method.paper.clone(),
            test_surfaces: test_surfaces(method, protocol).map_err(refused)?,
            training_surfaces: training_surfaces(method).map_err(refused)?,
        });
    }
    Ok(methods)
}

/// When a method that looks at one view after the other has looked enough.
fn adaptive(method: &MethodConfig, looks: &Looks) -> Result<Option<Adaptive>, Problem> {
    let Some(adaptive) = method.adaptive else {
        return Ok(None);
    };
    let Looks::Selected(selected) = looks else {
        let why = "needs a number of `views` above 1, which says how many at most";
        return refuse("adaptive", why);
    };
    // Whatever has seen the readings of the calibration surfaces is surer of them than of others.
    if selected.selector.learns() {
        let why = "needs a selector that learns nothing: its intervals would be too narrow";
        refuse("adaptive", why)
    } else if method.encoder.trainable {
        let why = "needs an encoder that is not trained: its intervals would be too narrow";
        refuse("adaptive", why)
    } else if !(adaptive.width.is_finite() && adaptive.width > 0.0) {
        refuse("adaptive.width", "must be above 0")
    } else if !(adaptive.calibration > 0.0 && adaptive.calibration < 1.0) {
        refuse("adaptive.calibration", "must lie between 0 and 1")
    } else {
        Ok(Some(adaptive))
    }
}

fn test_surfaces(method: &MethodConfig, protocol: Protocol) -> Result<Option<usize>, Problem> {
    let Some(count) = method.test_surfaces else {
        return Ok(None);
    };
    let why = match protocol {
        Protocol::TestSurfaces(all) if (1..=all.test).contains(&count) => return Ok(Some(count)),
        Protocol::TestSurfaces(all) => format!("is {count}, expected 1 to {}", all.test),
        Protocol::Split(_) => "needs surfaces that exist for scoring alone".to_owned(),
    };
    refuse("test-surfaces", why)
}

fn training_surfaces(method: &MethodConfig) -> Result<Option<usize>, Problem> {
    let learned = method.adaptive.is_some() || method.relations.is_some();
    let mut selector = method.selector.iter();
    let why = match method.training_surfaces {
        None => return Ok(None),
        Some(0) => "must be at least 1",
        Some(_) if method.kind == MethodKind::Predictions => "needs a method that is trained",
        Some(_) if learned || !selector.all(AnySelector::is_fixed) => {
            "needs views that do not depend on them"
        }
        Some(_) if method.encoder.trainable => "needs an encoder that is not trained",
        some => return Ok(some),
    };
    refuse("training-surfaces", why)
}

fn check_printed_row(method: &MethodConfig) -> Result<(), Problem> {
    let Some(name) = &method.paper else {
        return Ok(());
    };
    if paper::row(name).is_some() {
        return Ok(());
    }
    let names = paper::names();
    let names = names.iter().map(String::as_str);
    let unknown = UnknownName::new("row of the paper", name, names);
    refuse("paper", unknown.to_string())
}
