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

/// All methods: those listed, those of the sweeps, and the floors that are not among them.
pub(super) fn all(config: &Config) -> Vec<Written> {
    let mut all = asked_for(config);
    let floors = config.floors.iter().map(|&kind| floor(config, kind));
    let missing: Vec<MethodConfig> = floors
        .filter(|floor| !all.iter().any(|written| written.method.id == floor.id))
        .collect();
    all.extend(missing.into_iter().map(|method| Written {
        at: "floors".to_owned(),
        head: "head".to_owned(),
        method,
    }));
    all
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

pub(super) fn asked_for(config: &Config) -> Vec<Written> {
    let listed = config.methods.iter().enumerate();
    let listed = listed.map(|(index, method)| Written {
        at: format!("methods.{index}"),
        head: format!("methods.{index}.head"),
        method: method.clone(),
    });
    let swept = config
        .sweep
        .iter()
        .enumerate()
        .flat_map(|(index, methods)| {
            methods.iter().enumerate().map(move |(of, method)| Written {
                at: format!("sweep.{index}"),
                head: format!("sweep.{index}.{of}.head"),
                method: method.clone(),
            })
        });
    listed.chain(swept).collect()
}
