//! Which views of a surface a method looks at.

use anyhow::Result;
use serde::{Serialize, Serializer};
use sps_dataset::Source;
use sps_models::encoders::EncoderKind;
use sps_models::heads::{Input, RelationScale};
use sps_regress::kernel_ridge::{KernelRidge, KernelRidgeConfig, Shape};
use sps_viewselect::{AnySelector, Equidistant, TemporalRelations};

use super::method::Method;
use super::schema::{Config, JudgedOn, MethodConfig, MethodKind, ViewCount};
use crate::data;
use crate::text::counted;

#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Looks {
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
    pub selector: AnySelector,
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
    /// Whether it may choose a view more than once.
    pub(crate) fn may_repeat(&self) -> bool {
        self.picks > 1 && !self.distinct && !self.selector.is_fixed()
    }
}

/// A key of a method that is refused, and why.
pub(super) type Problem = (&'static str, String);

pub(super) fn refuse<T>(key: &'static str, why: impl Into<String>) -> Result<T, Problem> {
    Err((key, why.into()))
}

/// What the config of a method says about its views. `given_input`: whether it names the network's
/// input, which otherwise follows from the views.
pub(super) fn of(
    config: &Config,
    method: &MethodConfig,
    given_input: bool,
) -> Result<Looks, Problem> {
    let given = [
        ("views", method.views != ViewCount::default()),
        ("selector", method.selector.is_some()),
        ("relations", method.relations.is_some()),
    ];
    let given = given.into_iter().find(|(_, given)| *given);
    let encoder = &method.encoder.name;
    match given {
        Some((key, _)) if !method.kind.looks() => {
            return refuse(key, format!("`{}` looks at no view", method.kind.name()));
        }
        Some((key, _)) if encoder.parse().is_ok_and(EncoderKind::takes_sequences) => {
            let why = format!("cannot stand beside {encoder}, which looks at a sequence");
            return refuse(key, why);
        }
        _ if !method.kind.looks() => return Ok(Looks::Nothing),
        _ => {}
    }
    if given_input && has_head(method) {
        check_input(method)?;
    }
    let looks = views(config, method)?;
    let needs = match looks {
        Looks::Selected(_) => None,
        _ if method.distinct => Some("distinct"),
        _ => method.refit.map(|_| "refit"),
    };
    match needs {
        Some(key) => refuse(key, "needs a `selector`"),
        None => Ok(looks),
    }
}

/// Refuses a network's input that is for other views than the method looks at.
fn check_input(method: &MethodConfig) -> Result<(), Problem> {
    let views = match &method.head.input {
        _ if method.relations.is_some() => {
            let why = "cannot stand beside `relations`, which makes it";
            return refuse("head.input", why);
        }
        Input::Relations { .. } => {
            return refuse("head.input", "is made by the key `relations` of the method");
        }
        Input::ViewPooling {} => return Ok(()),
        Input::Single {} => 1,
        Input::LateFusion { views } => *views,
    };
    if method.views == ViewCount::Number(views) {
        return Ok(());
    }
    let (fits, views) = (counted(views, "view"), method.views);
    let why = format!("is for {fits}, but `views` is {views}");
    refuse("head.input", why)
}

fn views(config: &Config, method: &MethodConfig) -> Result<Looks, Problem> {
    let refused = |why: &str| refuse("relations", why);
    match (&method.relations, method.views, &method.selector) {
        (Some(_), _, Some(_)) => refused("cannot stand beside `selector`"),
        (Some(_), views, _) if views != ViewCount::default() => {
            refused("cannot stand beside `views`")
        }
        (Some(_), ..) if !has_head(method) => refused("need a method of the kind `head`"),
        (Some(relations), ..) => Ok(Looks::Relations(relations.clone())),
        (None, ViewCount::All, Some(_)) => {
            refuse("selector", "cannot stand beside `views = \"all\"`")
        }
        (None, ViewCount::All, None) => Ok(Looks::All),
        (None, ViewCount::Number(1), None) => Ok(Looks::Nadir),
        (None, ViewCount::Number(picks), selector) => {
            let equidistant = || AnySelector::Equidistant(Equidistant::default());
            let selector = selector.clone().unwrap_or_else(equidistant);
            selected(config, method, picks, selector).map(Looks::Selected)
        }
    }
}

fn has_head(method: &MethodConfig) -> bool {
    method.kind == MethodKind::Head || method.members.contains(&MethodKind::Head)
}

fn selected(
    config: &Config,
    method: &MethodConfig,
    picks: usize,
    selector: AnySelector,
) -> Result<Selected, Problem> {
    let selected = Selected {
        picks,
        distinct: method.distinct,
        selector,
        refit: refit(config, method)?,
    };
    let fused_late = has_head(method) && method.head.input != Input::ViewPooling {};
    match (selected.selector.learns(), &selected.refit) {
        (false, Some(_)) => refuse("refit", "needs a selector that asks for a loss"),
        (true, None) if !fused_late => {
            let why = "is learned on a late fusion: it needs a method of the kind `head`";
            refuse("selector", why)
        }
        _ => Ok(selected),
    }
}

/// Of the kernel that sets of views are compared by.
const REFIT_WIDTH: f64 = 4.0;

fn refit(config: &Config, method: &MethodConfig) -> Result<Option<Refit>, Problem> {
    let Some(refit) = method.refit else {
        return Ok(None);
    };
    let is_outside = |amount: f64| !(0.0..=1.0).contains(&amount);
    if refit.pooled.is_some_and(is_outside) {
        return refuse("refit.pooled", "must lie between 0 and 1");
    }
    let ridge = KernelRidge::new(KernelRidgeConfig {
        kernels: vec![Shape::even(refit.kernel, REFIT_WIDTH)],
        ..config.kernel_ridge.clone()
    });
    Ok(Some(Refit {
        ridge: ridge.map_err(|error| ("refit", error.to_string()))?,
        pooled: refit.pooled,
        judged_on: refit.judged_on,
    }))
}

impl Method {
    pub(crate) fn selected(&self) -> Option<&Selected> {
        match &self.looks {
            Looks::Selected(selected) => Some(selected),
            _ => None,
        }
    }

    /// Whether its views are chosen in hindsight.
    pub(crate) fn in_hindsight(&self) -> bool {
        let refit = self.selected().and_then(|selected| selected.refit.as_ref());
        refit.is_some_and(|refit| refit.judged_on == JudgedOn::HeldOut)
    }

    pub(crate) fn with_views(&self, views: usize) -> Result<Self> {
        let mut method = self.clone();
        if let Looks::Selected(selected) = &mut method.looks {
            selected.picks = views;
        }
        method.taking(views)
    }

    /// The method on these views: its network takes as many as it looks at, and a selector of the view
    /// straight down, which knows no angles, is told which one that is.
    pub(crate) fn on(&self, source: &dyn Source) -> Result<Self> {
        let mut method = self.taking(source.view_angles().len())?;
        if let Looks::Selected(selected) = &mut method.looks
            && let AnySelector::Nadir(selector) = &mut selected.selector
            && selector.view.is_none()
        {
            selector.view = Some(data::nadir(source)?);
        }
        Ok(method)
    }

    /// Its network takes as many of `views` views as it looks at.
    fn taking(&self, views: usize) -> Result<Self> {
        let mut method = self.clone();
        let slots = match &self.looks {
            Looks::Nothing | Looks::Nadir => return Ok(method),
            Looks::All => views,
            Looks::Selected(selected) => selected.picks,
            Looks::Relations(relations) => {
                let relations = relations.clone().sampler(views, 0)?.training_step(0);
                let scales = relations.iter().map(|relations| RelationScale {
                    views: relations.views_per_group,
                    relations: relations.groups.len(),
                });
                let scales = scales.collect();
                let input = Input::Relations { scales };
                method.estimator = self.estimator.with(|fitted| fitted.with_input(&input))?;
                return Ok(method);
            }
        };
        method.estimator = self.estimator.with(|fitted| fitted.with_views(slots))?;
        Ok(method)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::experiment::tests::{METHOD, below, read, refused};

    #[test]
    fn views_that_cannot_be_meant_are_refused_at_their_line() {
        for views in ["0", "-1", "1.5", "\"every\""] {
            let found = format!("is {views}, expected at least 1, or \"all\"");
            below(&format!("views = {views}"), &["line 5", "views", &found]);
        }
        for key in ["distinct = true", "refit = {}"] {
            below(key, &["line 5", "needs a `selector`"]);
        }
        let all = "`views = \"all\"`";
        let views = "`views`";
        below("views = 2\nrelations = {}", &["line 6", "relations", views]);
        let nvs = "views = 3\nselector = { kind = \"nvs\" }";
        below(nvs, &["line 6", "kind `head`"]);
        let random = "views = \"all\"\nselector = { kind = \"random\" }";
        below(random, &["line 6", "selector", all]);
        let i3d = "views = \"all\"\nencoder.name = \"i3d\"";
        below(i3d, &["line 5", "cannot stand beside i3d"]);
    }

    #[test]
    fn a_network_takes_as_many_views_as_its_method_looks_at() {
        let head = METHOD.replace("ridge", "head");
        for keys in [
            "head.input = { kind = \"single\" }",
            "views = 3\nhead.input = { kind = \"late-fusion\", views = 3 }",
            "views = \"all\"\nhead.input = { kind = \"view-pooling\" }",
            "views = 3\nhead.input = { kind = \"view-pooling\" }",
            "relations = {}",
        ] {
            assert!(read(&format!("{head}{keys}")).is_ok(), "{keys}");
        }
        let fusion = "kind = \"late-fusion\", views = 2";
        for (views, input) in [
            ("3", "kind = \"single\""),
            ("\"all\"", "kind = \"single\""),
            ("3", fusion),
            ("1", fusion),
        ] {
            let number = format!("but `views` is {views}");
            let keys = format!("views = {views}\nhead.input = {{ {input} }}");
            refused(&format!("{head}{keys}"), &["head.input", &number]);
        }
        refused(
            &format!("{head}relations = {{}}\nhead.input = {{ kind = \"single\" }}"),
            &["line 6", "head.input", "`relations`"],
        );
        // Other kinds have no network, whatever the top of the config says of one.
        let sweep = "[head]\ninput = { kind = \"single\" }\n[[sweep]]\nid = \"s\"\n\
            [sweep.grid]\nkind = [\"ridge\", \"KIND\"]\nviews = [1, 3]\n";
        assert!(read(&sweep.replace("KIND", "kernel-ridge")).is_ok());
        refused(&sweep.replace("KIND", "head"), &["`views` is 3"]);
    }

    #[test]
    fn views_are_equidistant_unless_a_selector_is_named() {
        let looks = |keys: &str| {
            let experiment = read(&format!("{METHOD}{keys}")).unwrap();
            experiment.methods[0].looks.clone()
        };
        let named = looks("views = 3\nselector = { kind = \"equidistant\" }");
        assert_eq!(looks("views = 3"), named);
        assert_ne!(looks("views = 2"), named);
        assert_eq!(looks("views = \"all\""), Looks::All);
        assert_eq!(looks("views = 1"), Looks::Nadir);
        let swept = |keys: &str| {
            let text = format!(
                "[[sweep]]\nid = \"s\"\nkind = \"head\"\n{keys}\
                 grid = {{ views = [1, 3, \"all\"] }}\n"
            );
            // The floors come after those of the sweep.
            let methods = read(&text).unwrap().methods.into_iter().take(3);
            let all: Vec<_> = methods.map(|method| (method.id, method.looks)).collect();
            all
        };
        let expected = [("s-1", Looks::Nadir), ("s-3", named), ("s-all", Looks::All)];
        let plain = swept("");
        assert_eq!(plain, expected.map(|(id, looks)| (id.to_owned(), looks)));
        let chosen = swept("selector = { kind = \"greedy\" }\ndistinct = true\nrefit = {}\n");
        assert_eq!((&chosen[0], &chosen[2]), (&plain[0], &plain[2]));
        assert!(matches!(&chosen[1].1, Looks::Selected(greedy) if greedy.selector.learns()));
    }
}
