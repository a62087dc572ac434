//! A sweep in a config: several methods, written at once.

use super::schema::{Config, MethodConfig, MethodKind, SweepConfig};

/// A method, and where the config has it.
pub(super) struct Written {
    /// The key of the table, dotted.
    pub at: String,
    pub method: MethodConfig,
}

/// All methods: those listed, then those of the sweeps.
pub(super) fn written(config: &Config) -> Vec<Written> {
    let listed = config.methods.iter().enumerate();
    let listed = listed.map(|(index, method)| Written {
        at: format!("methods.{index}"),
        method: method.clone(),
    });
    let swept = config.sweep.iter().enumerate().flat_map(|(index, sweep)| {
        let at = format!("sweep.{index}");
        methods(sweep).map(move |method| Written {
            at: at.clone(),
            method,
        })
    });
    listed.chain(swept).collect()
}

/// For each kind, from few views to many.
fn methods(sweep: &SweepConfig) -> impl Iterator<Item = MethodConfig> + '_ {
    sweep.kinds.iter().flat_map(move |&kind| {
        let some = sweep.views.iter().map(move |&views| Some(views));
        let all = sweep.all_views.then_some(None);
        some.chain(all).map(move |views| method(sweep, kind, views))
    })
}

/// Looks at so many views, or at all.
fn method(sweep: &SweepConfig, kind: MethodKind, views: Option<usize>) -> MethodConfig {
    let (name, word) = match kind {
        MethodKind::Head => ("head", "cross-modal"),
        MethodKind::Ridge => ("ridge", "ridge"),
    };
    let count = views.map_or("all".to_owned(), |views| views.to_string());
    let noun = if views == Some(1) { "view" } else { "views" };
    MethodConfig {
        id: format!("{}-{count}-{name}", sweep.id),
        label: format!("{}, {count} {noun}, {word}", sweep.label),
        kind,
        paper: None,
        encoder: sweep.encoder.clone(),
        head: sweep.head.clone(),
        views: views.unwrap_or(1),
        all_views: views.is_none(),
        selector: views
            .filter(|&views| views != 1)
            .map(|_| sweep.selector.clone()),
        distinct: false,
        relations: None,
        adaptive: None,
    }
}
