//! The methods of a config: those listed, those of its sweeps, and the floors under all others.

use super::schema::{Config, MethodConfig, MethodKind};

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
