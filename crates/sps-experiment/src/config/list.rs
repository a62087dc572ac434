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

/// A key of a config, and its value as TOML.
type Line = (String, String);

fn line(key: &str, value: impl Serialize) -> Result<Line> {
    Ok((key.to_owned(), inline(value)?))
}

fn settings(method: &Method) -> Result<Vec<Line>> {
    let mut lines = vec![line("kind", method.estimator.kind())?];
    if let Some(file) = method.estimator.file() {
        lines.push(line("file", file.to_string_lossy())?);
    }
    if method.looks != Looks::Nothing {
        lines.push(line("encoder", encoder::describe(&method.encoder))?);
    }
    // Of a sequence the encoder says which views it is made of.
    if !matches!(method.encoder.network, Network::Sequences { .. }) {
        lines.extend(looks(&method.looks)?);
    }
    if let Some(adaptive) = &method.adaptive {
        lines.push(line("adaptive", adaptive)?);
    }
    for (key, count) in [
        ("test-surfaces", method.test_surfaces),
        ("training-surfaces", method.training_surfaces),
    ] {
        lines.extend(count.map(|count| line(key, count)).transpose()?);
    }
    lines.extend(fitted(method)?);
    Ok(lines)
}

/// The settings of what is fitted, its network's input as the views make it.
fn fitted(method: &Method) -> Result<Vec<Line>> {
    let estimator = match method.selected() {
        Some(selected) => method.with_views(selected.picks)?.estimator,
        None => method.estimator.clone(),
    };
    let Some(fitted) = estimator.regression() else {
        return Ok(Vec::new());
    };
    let mut lines = regression(fitted)?;
    let input = match &method.looks {
        Looks::All => ALL_VIEWS,
        Looks::Relations(_) => RELATED_VIEWS,
        _ => return Ok(lines),
    };
    let single = line("head.input", Input::Single {})?;
    for line in lines.iter_mut().filter(|line| **line == single) {
        input.clone_into(&mut line.1);
    }
    Ok(lines)
}

fn looks(looks: &Looks) -> Result<Vec<Line>> {
    let line = match looks {
        Looks::Nothing => return Ok(Vec::new()),
        Looks::Nadir => ("views".to_owned(), "1 # the one straight down".to_owned()),
        Looks::All => line("views", "all")?,
        Looks::Selected(selected) => {
            let of_picks = |key: &str| if key == "picks" { "views" } else { key }.to_owned();
            return each(serde_json::to_value(selected)?, of_picks);
        }
        Looks::Relations(relations) => line("relations", relations)?,
    };
    Ok(vec![line])
}

/// The settings of a regression, each key with its table before it.
fn regression(regression: &Regression) -> Result<Vec<Line>> {
    if let Regression::Stacked(stacked) = regression {
        let kinds: Vec<&str> = stacked.members.iter().map(Regression::kind).collect();
        let mut lines = vec![line("members", kinds)?, line("folds", stacked.folds)?];
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
fn each(table: Value, name: impl Fn(&str) -> String) -> Result<Vec<Line>> {
    let Value::Object(table) = table else {
        return Ok(Vec::new());
    };
    let set = table.into_iter().filter(|(_, value)| !value.is_null());
    set.map(|(key, value)| line(&name(&key), value)).collect()
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
