//! Which views of a surface a method looks at.

use anyhow::Result;
use serde::Serialize;
use sps_models::encoders::I3d;
use sps_models::heads::{Head, HeadConfig, Input, RelationScale};
use sps_viewselect::{RelationSampler, Selector, TemporalRelations};

use super::experiment::{Estimator, Method};
use super::schema::{MethodConfig, MethodKind, SelectorConfig};

/// The views that an estimate looks at.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Looks {
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
}

impl Selected {
    /// Whether the choice depends on the loss of the sets.
    pub(crate) fn learns(&self) -> bool {
        match &self.selector {
            SelectorConfig::Random(random) => random.draws > 1,
            selector => !selector.is_fixed(),
        }
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

/// A wrong key of a method, and what is wrong with it.
pub(super) type Problem = (&'static str, String);

/// What the config of a method says about its views.
pub(super) fn of(method: &MethodConfig) -> Result<Looks, Problem> {
    let head = method.kind == MethodKind::Head;
    let given = [
        ("all-views", method.all_views),
        ("selector", method.selector.is_some()),
        ("relations", method.relations.is_some()),
    ];
    let mut given = given.iter().filter(|(_, given)| *given);
    let (one, other) = (given.next(), given.next());
    if let (Some((one, _)), Some((other, _))) = (one, other) {
        return Err((other, format!("cannot stand beside `{one}`")));
    }
    if let (I3d::NAME, Some((key, _))) = (method.encoder.name.as_str(), one) {
        return Err((
            key,
            "cannot stand beside i3d, which looks at a sequence".to_owned(),
        ));
    }
    if method.distinct && method.selector.is_none() {
        return Err(("distinct", "needs a `selector`".to_owned()));
    }
    if method.views == 0 {
        return Err(("views", "must be at least 1".to_owned()));
    }
    if method.views > 1 && method.selector.is_none() {
        return Err(("views", "needs a `selector` that chooses them".to_owned()));
    }
    if let Some(relations) = &method.relations {
        if !head {
            return Err(("relations", "need a method of the kind `head`".to_owned()));
        }
        return Ok(Looks::Relations(relations.clone()));
    }
    if method.all_views {
        return Ok(Looks::All);
    }
    let Some(selector) = &method.selector else {
        return Ok(Looks::Nadir);
    };
    let selected = Selected {
        picks: method.views,
        distinct: method.distinct,
        selector: selector.clone(),
    };
    if selected.learns() && !(head && method.head.input != Input::ViewPooling {}) {
        let problem = "is learned on a late fusion: it needs a method of the kind `head`";
        return Err(("selector", problem.to_owned()));
    }
    Ok(Looks::Selected(selected))
}

impl Method {
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
            Looks::Nadir => return Ok(method),
            Looks::All => views,
            Looks::Selected(selected) => selected.picks,
            Looks::Relations(relations) => {
                let sampler = relations.clone().sampler(views, 0)?;
                let input = relation_input(&sampler);
                method.estimator = self.estimator.with_input(input)?;
                return Ok(method);
            }
        };
        if let Estimator::Head(head) = &self.estimator
            && head.config().input != (Input::ViewPooling {})
        {
            method.estimator = self
                .estimator
                .with_input(Input::LateFusion { views: slots })?;
        }
        Ok(method)
    }
}

impl Estimator {
    fn with_input(&self, input: Input) -> Result<Self> {
        Ok(match self {
            Self::Head(head) => Self::Head(Head::new(HeadConfig {
                input,
                ..head.config().clone()
            })?),
            Self::Ridge(ridge) => Self::Ridge(ridge.clone()),
        })
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
