//! Which views of a surface a method looks at.

use anyhow::Result;
use serde::{Serialize, Serializer};
use sps_models::encoders::EncoderKind;
use sps_models::heads::{Input, RelationScale};
use sps_models::kernel_ridge::{KernelRidge, KernelRidgeConfig};
use sps_viewselect::{RelationSampler, Selector, TemporalRelations};

use super::method::Method;
use super::schema::{Config, JudgedOn, MethodConfig, MethodKind, SelectorConfig};

/// The views that an estimate looks at.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Looks {
    /// None.
    Nothing,
    /// The one straight down.
    Nadir,
    All,
    Selected(Selected),
    /// Groups of views in order, drawn again for every training step.
    Relations(TemporalRelations),
}

/// Views that a selector chooses, for each property and rerun.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Selected {
    pub picks: usize,
    pub distinct: bool,
    pub selector: SelectorConfig,
    /// What it asks of a set; `None`: a frozen network.
    pub refit: Option<Refit>,
}

/// The loss of kernel ridge regression that is fitted anew to each set of views.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Refit {
    #[serde(serialize_with = "settings")]
    pub ridge: KernelRidge,
    /// How far each property's loss is drawn towards that of all; `None`: chosen.
    pub pooled: Option<f64>,
    pub judged_on: JudgedOn,
}

fn settings<S: Serializer>(ridge: &KernelRidge, serializer: S) -> Result<S::Ok, S::Error> {
    ridge.config().serialize(serializer)
}

impl Selected {
    /// Whether the choice depends on the loss of the sets.
    pub(crate) fn learns(&self) -> bool {
        match &self.selector {
            SelectorConfig::Random(random) => random.draws > 1,
            selector => !selector.is_fixed(),
        }
    }

    /// Whether it may choose a view more than once.
    pub(crate) fn may_repeat(&self) -> bool {
        self.picks > 1 && !self.distinct && !self.selector.is_fixed()
    }
}

impl SelectorConfig {
    /// Whether it chooses the same views whatever the loss and the seed.
    pub(crate) fn is_fixed(&self) -> bool {
        matches!(self, Self::Equidistant(_) | Self::Nadir(_))
    }

    /// The selector.
    pub(crate) fn selector(&self) -> &dyn Selector {
        match self {
            Self::Random(selector) => selector,
            Self::Equidistant(selector) => selector,
            Self::Nadir(selector) => selector,
            Self::Nvs(selector) => selector,
            Self::VbNvs(selector) => selector,
            Self::Greedy(selector) => selector,
            Self::Exhaustive(selector) => selector,
        }
    }
}

/// A key of a method that is refused, and why.
pub(super) type Problem = (&'static str, String);

/// Refuses a key.
pub(super) fn refuse<T>(key: &'static str, why: impl Into<String>) -> Result<T, Problem> {
    Err((key, why.into()))
}

/// What the config of a method says about its views.
pub(super) fn of(config: &Config, method: &MethodConfig) -> Result<Looks, Problem> {
    let given = [
        ("all-views", method.all_views),
        ("selector", method.selector.is_some()),
        ("relations", method.relations.is_some()),
    ];
    let mut given = given.into_iter().filter(|(_, given)| *given);
    match (given.next(), given.next()) {
        (Some((key, _)), _) if !method.kind.looks() => {
            return refuse(key, format!("`{}` looks at no view", method.kind.name()));
        }
        (Some((one, _)), Some((other, _))) => {
            return refuse(other, format!("cannot stand beside `{one}`"));
        }
        (Some((key, _)), None) if takes_sequences(&method.encoder.name) => {
            let name = &method.encoder.name;
            return refuse(
                key,
                format!("cannot stand beside {name}, which looks at a sequence"),
            );
        }
        _ if !method.kind.looks() => return Ok(Looks::Nothing),
        _ => {}
    }
    if method.views == 0 {
        return refuse("views", "must be at least 1");
    }
    if let Some(selector) = &method.selector {
        return selected(config, method, selector).map(Looks::Selected);
    }
    if method.distinct {
        return refuse("distinct", "needs a `selector`");
    }
    if method.views > 1 {
        return refuse("views", "needs a `selector` that chooses them");
    }
    match &method.relations {
        Some(_) if !has_head(method) => refuse("relations", "need a method of the kind `head`"),
        Some(relations) => Ok(Looks::Relations(relations.clone())),
        None if method.all_views => Ok(Looks::All),
        None => Ok(Looks::Nadir),
    }
}

fn takes_sequences(encoder: &str) -> bool {
    encoder.parse().is_ok_and(EncoderKind::takes_sequences)
}

fn has_head(method: &MethodConfig) -> bool {
    method.kind == MethodKind::Head || method.members.contains(&MethodKind::Head)
}

fn selected(
    config: &Config,
    method: &MethodConfig,
    selector: &SelectorConfig,
) -> Result<Selected, Problem> {
    let selected = Selected {
        picks: method.views,
        distinct: method.distinct,
        selector: selector.clone(),
        refit: refit(config, method)?,
    };
    let fused_late = has_head(method) && method.head.input != Input::ViewPooling {};
    match (selected.learns(), &selected.refit) {
        (false, Some(_)) => refuse("refit", "needs a selector that asks for a loss"),
        (true, None) if !fused_late => {
            let why = "is learned on a late fusion: it needs a method of the kind `head`";
            refuse("selector", why)
        }
        _ => Ok(selected),
    }
}

fn refit(config: &Config, method: &MethodConfig) -> Result<Option<Refit>, Problem> {
    let Some(refit) = method.refit else {
        return Ok(None);
    };
    if refit
        .pooled
        .is_some_and(|amount| !(0.0..=1.0).contains(&amount))
    {
        return refuse("refit.pooled", "must lie between 0 and 1");
    }
    let ridge = KernelRidge::new(KernelRidgeConfig {
        kernel: refit.kernel,
        ..config.kernel_ridge.clone()
    });
    Ok(Some(Refit {
        ridge: ridge.map_err(|error| ("refit", error.to_string()))?,
        pooled: refit.pooled,
        judged_on: refit.judged_on,
    }))
}

impl Method {
    /// Whether its views are chosen in hindsight.
    pub(crate) fn in_hindsight(&self) -> bool {
        let Looks::Selected(selected) = &self.looks else {
            return false;
        };
        let refit = selected.refit.as_ref();
        refit.is_some_and(|refit| refit.judged_on == JudgedOn::HeldOut)
    }

    /// The method for the first so many of its views.
    pub(crate) fn with_views(&self, views: usize) -> Result<Self> {
        let mut method = self.clone();
        if let Looks::Selected(selected) = &mut method.looks {
            selected.picks = views;
        }
        method.on(views)
    }

    /// The method on a dataset of `views` views: its network takes as many as it looks at.
    pub(crate) fn on(&self, views: usize) -> Result<Self> {
        let mut method = self.clone();
        let slots = match &self.looks {
            Looks::Nothing | Looks::Nadir => return Ok(method),
            Looks::All => views,
            Looks::Selected(selected) => selected.picks,
            Looks::Relations(relations) => {
                let sampler = relations.clone().sampler(views, 0)?;
                let input = relation_input(&sampler);
                method.estimator = self.estimator.with(|fitted| fitted.with_input(&input))?;
                return Ok(method);
            }
        };
        method.estimator = self.estimator.with(|fitted| fitted.with_views(slots))?;
        Ok(method)
    }
}

fn relation_input(sampler: &RelationSampler) -> Input {
    let scales = sampler.training_step(0);
    let scale = |relations: &sps_viewselect::Relations| RelationScale {
        views: relations.views_per_group,
        relations: relations.groups.len(),
    };
    Input::Relations {
        scales: scales.iter().map(scale).collect(),
    }
}
