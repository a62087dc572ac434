//! Methods that a config does not list one by one: sweeps, and the floors under all others.

use sps_models::heads::Model;

use super::schema::{Config, MethodConfig, MethodKind, SweepConfig};

/// A method, and where the config has it.
pub(super) struct Written {
    /// The key of the table, dotted.
    pub at: String,
    pub method: MethodConfig,
}

/// All methods: those listed, those of the sweeps, and the floors that are not among them.
pub(super) fn written(config: &Config) -> Vec<Written> {
    let mut all = asked_for(config);
    let floors = config.floors.iter().map(|&kind| floor(config, kind));
    let missing: Vec<MethodConfig> = floors
        .filter(|floor| !all.iter().any(|written| written.method.id == floor.id))
        .collect();
    all.extend(missing.into_iter().map(|method| Written {
        at: "floors".to_owned(),
        method,
    }));
    all
}

/// One view, the encoder of the config.
fn floor(config: &Config, kind: MethodKind) -> MethodConfig {
    let label = match kind {
        MethodKind::Head => "Head",
        MethodKind::Ridge => "Ridge regression",
        MethodKind::KernelRidge => "Kernel ridge regression",
        MethodKind::Nearest => "Nearest neighbour",
        MethodKind::Stacked => "Stacked",
        MethodKind::Mean => "Mean of the training part",
        MethodKind::LabelMean => "Mean of the surface's material",
    };
    MethodConfig {
        id: kind.name().to_owned(),
        label: label.to_owned(),
        kind,
        members: Vec::new(),
        folds: 0,
        paper: None,
        encoder: config.encoder.clone(),
        head: config.head.clone(),
        views: 1,
        all_views: false,
        selector: None,
        distinct: false,
        refit: None,
        relations: None,
        adaptive: None,
        test_surfaces: None,
        training_surfaces: None,
    }
}

/// Those listed, then those of the sweeps.
pub(super) fn asked_for(config: &Config) -> Vec<Written> {
    let listed = config.methods.iter().enumerate();
    let listed = listed.map(|(index, method)| Written {
        at: format!("methods.{index}"),
        method: method.clone(),
    });
    let swept = config.sweep.iter().enumerate().flat_map(|(index, sweep)| {
        let at = format!("sweep.{index}");
        let methods = methods(config, sweep).into_iter();
        methods.map(move |method| Written {
            at: at.clone(),
            method,
        })
    });
    listed.chain(swept).collect()
}

/// For each kind, from few views to many, from few training surfaces to many.
fn methods(config: &Config, sweep: &SweepConfig) -> Vec<MethodConfig> {
    let mut methods = Vec::new();
    let all_views = sweep.all_views.then_some(None);
    for &kind in &sweep.kinds {
        for views in sweep.views.iter().copied().map(Some).chain(all_views) {
            let method = method(config, sweep, kind, views);
            let numbers = sweep.training_surfaces.iter();
            methods.extend(numbers.map(|&surfaces| trained_on(&method, surfaces)));
            if sweep.training_surfaces.is_empty() {
                methods.push(method);
            }
        }
    }
    methods
}

fn trained_on(method: &MethodConfig, surfaces: usize) -> MethodConfig {
    MethodConfig {
        id: format!("{}-{surfaces}", method.id),
        label: format!("{}, {surfaces} training surfaces", method.label),
        training_surfaces: Some(surfaces),
        ..method.clone()
    }
}

/// Looks at so many views, or at all.
fn method(
    config: &Config,
    sweep: &SweepConfig,
    kind: MethodKind,
    views: Option<usize>,
) -> MethodConfig {
    let name = kind.name();
    let word = match (kind, &sweep.head.model) {
        (MethodKind::Head, Model::CrossModal(_)) => "cross-modal",
        (MethodKind::Head, Model::Regression {}) => "regression",
        _ => name,
    };
    let count = views.map_or("all".to_owned(), |views| views.to_string());
    let noun = if views == Some(1) { "view" } else { "views" };
    let several = views.filter(|&views| views != 1);
    MethodConfig {
        id: format!("{}-{count}-{name}", sweep.id),
        label: format!("{}, {count} {noun}, {word}", sweep.label),
        members: sweep.members.clone(),
        folds: sweep.folds,
        encoder: sweep.encoder.clone(),
        head: sweep.head.clone(),
        views: views.unwrap_or(1),
        all_views: views.is_none(),
        selector: several.map(|_| sweep.selector.clone()),
        test_surfaces: sweep.test_surfaces,
        ..floor(config, kind)
    }
}
