//! The methods of an experiment with all that each of them comes to.

use std::fmt::Write as _;

use anyhow::Result;
use serde_json::Value;
use sps_estimator::Regression;
use sps_models::heads::Input;

use super::encoder::Network;
use super::experiment::Experiment;
use super::looks::Looks;
use super::method::Method;
use crate::encoder;

/// The input of a network where the data says how many views there are.
const ALL_VIEWS: &str = "{ kind = \"late-fusion\" } # of all views";
const RELATED_VIEWS: &str = "{ kind = \"relations\" } # as `relations` says";

/// For each method a line with its id and label, and below it its settings as a config would write
/// them, defaults and inherited tables included.
///
/// # Errors
/// Settings that TOML cannot hold.
pub fn list(experiment: &Experiment) -> Result<String> {
    let mut text = String::new();
    for method in &experiment.methods {
        let _ = writeln!(text, "{}\t{}", method.id, method.label);
        for (key, value) in settings(method)? {
            let _ = writeln!(text, "    {key} = {value}");
        }
    }
    Ok(text)
}

fn settings(method: &Method) -> Result<Vec<(String, String)>> {
    let mut lines = vec![("kind".to_owned(), quoted(method.estimator.kind()))];
    if let Some(file) = method.estimator.file() {
        lines.push(("file".to_owned(), quoted(&file.to_string_lossy())));
    }
    if method.looks != Looks::Nothing {
        let encoder = quoted(&encoder::describe(&method.encoder));
        lines.push(("encoder".to_owned(), encoder));
    }
    // Of a sequence the encoder says which views it is made of.
    if !matches!(method.encoder.network, Network::Sequences { .. }) {
        lines.extend(looks(&method.looks)?);
    }
    if let Some(adaptive) = &method.adaptive {
        lines.push(("adaptive".to_owned(), inline(&json(adaptive)?)));
    }
    if let Some(count) = method.test_surfaces {
        lines.push(("test-surfaces".to_owned(), count.to_string()));
    }
    if let Some(count) = method.training_surfaces {
        lines.push(("training-surfaces".to_owned(), count.to_string()));
    }
    lines.extend(fitted(method)?);
    Ok(lines)
}

/// The settings of what is fitted, its network's input as the views make it.
fn fitted(method: &Method) -> Result<Vec<(String, String)>> {
    let (method, input) = match &method.looks {
        Looks::Selected(selected) => (method.with_views(selected.picks)?, None),
        Looks::All => (method.clone(), Some(ALL_VIEWS)),
        Looks::Relations(_) => (method.clone(), Some(RELATED_VIEWS)),
        Looks::Nothing | Looks::Nadir => (method.clone(), None),
    };
    let Some(fitted) = method.estimator.regression() else {
        return Ok(Vec::new());
    };
    let mut lines = regression(fitted)?;
    let single = inline(&json(&Input::Single {})?);
    for (key, value) in &mut lines {
        if let Some(input) = input
            && key == "head.input"
            && *value == single
        {
            input.clone_into(value);
        }
    }
    Ok(lines)
}

fn looks(looks: &Looks) -> Result<Vec<(String, String)>> {
    let line = |key: &str, value: String| (key.to_owned(), value);
    Ok(match looks {
        Looks::Nothing => Vec::new(),
        Looks::Nadir => vec![line("views", "1 # the one straight down".to_owned())],
        Looks::All => vec![line("views", quoted("all"))],
        Looks::Selected(selected) => {
            let Value::Object(keys) = json(selected)? else {
                return Ok(Vec::new());
            };
            let given = keys.iter().filter(|(_, value)| !value.is_null());
            let of_picks = |key: &str| if key == "picks" { "views" } else { key }.to_owned();
            let lines = given.map(|(key, value)| (of_picks(key), inline(value)));
            lines.collect()
        }
        Looks::Relations(relations) => vec![line("relations", inline(&json(relations)?))],
    })
}

/// The settings of a regression, each key with its table before it.
fn regression(regression: &Regression) -> Result<Vec<(String, String)>> {
    if let Regression::Stacked(stacked) = regression {
        let kinds: Vec<Value> = stacked.members.iter().map(|m| m.kind().into()).collect();
        let mut lines = vec![
            ("members".to_owned(), inline(&Value::from(kinds))),
            ("folds".to_owned(), stacked.folds.to_string()),
        ];
        for member in &stacked.members {
            lines.extend(self::regression(member)?);
        }
        return Ok(lines);
    }
    let Value::Object(settings) = regression.settings()? else {
        return Ok(Vec::new());
    };
    let kind = regression.kind();
    let given = settings.iter().filter(|(_, value)| !value.is_null());
    let lines = given.map(|(key, value)| (format!("{kind}.{key}"), inline(value)));
    Ok(lines.collect())
}

fn json(value: &impl serde::Serialize) -> Result<Value> {
    Ok(serde_json::to_value(value)?)
}

/// As TOML on one line; what is not set is left out.
fn inline(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::Array(list) => {
            let items: Vec<String> = list.iter().map(inline).collect();
            format!("[{}]", items.join(", "))
        }
        Value::Object(table) => {
            let given = table.iter().filter(|(_, value)| !value.is_null());
            let items: Vec<String> = given
                .map(|(key, value)| format!("{key} = {}", inline(value)))
                .collect();
            if items.is_empty() {
                return "{}".to_owned();
            }
            format!("{{ {} }}", items.join(", "))
        }
        Value::String(text) => quoted(text),
        other => other.to_string(),
    }
}

fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_value_on_one_line_is_the_toml_that_it_was() {
        let value = json!({
            "kind": "cross-modal",
            "latent": 50,
            "weight": 0.01,
            "penalties": [1.0, 3.16],
            "adversarial": {},
            "labels": { "source": "a \"quoted\" one" },
        });
        let text = inline(&value);
        let read: toml::Table = format!("value = {text}").parse().unwrap();
        assert_eq!(serde_json::to_value(&read["value"]).unwrap(), value);
    }

    #[test]
    fn what_is_not_set_is_left_out() {
        assert_eq!(inline(&json!({ "a": null, "b": [1] })), "{ b = [1] }");
        assert_eq!(inline(&json!({ "a": null })), "{}");
    }
}
