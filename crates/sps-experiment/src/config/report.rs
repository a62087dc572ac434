//! What the report compares and asks.

use super::layers::Layers;
use super::locate::ConfigError;
use super::schema::{Config, SpeedConfig};
use super::written::Written;

/// What is asked about speed and error; none where it is not.
pub(super) fn speed(
    layers: &Layers<'_>,
    config: &Config,
) -> Result<Option<SpeedConfig>, ConfigError> {
    let speed = config.report.speed;
    for (key, value) in [
        ("error", speed.within_error),
        ("seconds", speed.within_seconds),
    ] {
        let key = format!("report.speed.within-{key}");
        let number = value.is_finite() && value >= 0.0;
        layers.require(number, &key, "must be a number from 0 on")?;
    }
    Ok(speed.front.then_some(speed))
}

/// Indices of the methods that all others are compared with.
pub(super) fn against(
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

pub(super) fn position(
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
