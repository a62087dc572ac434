//! The methods of an experiment with all that each of them comes to.

use std::fmt::Write as _;

use anyhow::Result;
use serde::Serialize;
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
    let mut lines = vec![("kind".to_owned(), inline(method.estimator.kind())?)];
    if let Some(file) = method.estimator.file() {
        lines.push(("file".to_owned(), inline(file.to_string_lossy())?));
    }
    if method.looks != Looks::Nothing {
        let encoder = inline(encoder::describe(&method.encoder))?;
        lines.push(("encoder".to_owned(), encoder));
    }
    // Of a sequence the encoder says which views it is made of.
    if !matches!(method.encoder.network, Network::Sequences { .. }) {
        lines.extend(looks(&method.looks)?);
    }
    if let Some(adaptive) = &method.adaptive {
        lines.push(("adaptive".to_owned(), inline(adaptive)?));
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
    let single = inline(Input::Single {})?;
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
        Looks::All => vec![line("views", inline("all")?)],
        Looks::Selected(selected) => {
            let of_picks = |key: &str| if key == "picks" { "views" } else { key }.to_owned();
            each(serde_json::to_value(selected)?, of_picks)?
        }
        Looks::Relations(relations) => vec![line("relations", inline(relations)?)],
    })
}

/// The settings of a regression, each key with its table before it.
fn regression(regression: &Regression) -> Result<Vec<(String, String)>> {
    if let Regression::Stacked(stacked) = regression {
        let kinds: Vec<&str> = stacked.members.iter().map(Regression::kind).collect();
        let mut lines = vec![
            ("members".to_owned(), inline(kinds)?),
            ("folds".to_owned(), stacked.folds.to_string()),
        ];
        for member in &stacked.members {
            lines.extend(self::regression(member)?);
        }
        return Ok(lines);
    }
    let kind = regression.kind();
    each(regression.settings()?, |key| format!("{kind}.{key}"))
}

/// As TOML on one line; what is not set is left out.
fn inline(value: impl Serialize) -> Result<String> {
    fn given(value: Value) -> Value {
        match value {
            Value::Object(table) => {
                let set = table.into_iter().filter(|(_, value)| !value.is_null());
                set.map(|(key, value)| (key, given(value))).collect()
            }
            Value::Array(list) => list.into_iter().map(given).collect(),
            other => other,
        }
    }
    let value = given(serde_json::to_value(value)?);
    Ok(toml::Value::try_from(value)?.to_string())
}

/// A line for each key that is set of what is a table.
fn each(table: Value, name: impl Fn(&str) -> String) -> Result<Vec<(String, String)>> {
    let Value::Object(table) = table else {
        return Ok(Vec::new());
    };
    let set = table.into_iter().filter(|(_, value)| !value.is_null());
    set.map(|(key, value)| Ok((name(&key), inline(value)?)))
        .collect()
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
        let text = inline(&value).unwrap();
        let read: toml::Table = format!("value = {text}").parse().unwrap();
        assert_eq!(serde_json::to_value(&read["value"]).unwrap(), value);
    }

    #[test]
    fn what_is_not_set_is_left_out() {
        let text = |value| inline(value).unwrap();
        assert_eq!(text(json!({ "a": null, "b": [1] })), "{ b = [1] }");
        assert_eq!(text(json!({ "a": null })), "{}");
    }
}
