//! Layers of TOML, one over the other, read as one value: what `--set` sets, and the line of the file in which
//! something is wrong.

use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::str::FromStr;

use serde::de::DeserializeOwned;
use serde_path_to_error::{Path as KeyPath, Segment};
use sps_base::names::UnknownName;
use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

use super::grid::{below, expand};
use super::merge::{apply, inherit, merge, take_back};

/// One `--set KEY=VALUE`.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Dotted, an index where the key is a list: `methods.0.id`.
    pub key: String,
    /// Parsed as TOML, or else taken as a string.
    pub value: Value,
}

impl Setting {
    /// That a key has a value.
    pub fn new(key: &str, value: impl Into<Value>) -> Self {
        Self {
            key: key.to_owned(),
            value: value.into(),
        }
    }
}

impl FromStr for Setting {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('=');
        let (key, value) = parts.ok_or_else(|| format!("`{text}` is not KEY=VALUE"))?;
        let key = key.trim();
        if key.is_empty() || key.split('.').any(str::is_empty) {
            return Err(format!("`{key}` is not a key like `training.epochs`"));
        }
        let parsed = format!("v = {value}").parse::<Table>().ok();
        let parsed = parsed.and_then(|mut table| table.remove("v"));
        Ok(Self::new(key, parsed.unwrap_or_else(|| value.into())))
    }
}

/// The text of a config, what it overrides and what overrides it.
pub struct Layers<'a> {
    path: &'a Path,
    text: &'a str,
    /// What was set, each by its key with an index for each element of a list.
    settings: Vec<(String, &'a Setting)>,
    merged: Table,
    /// The same with the methods of its sweeps.
    expanded: Table,
}

impl<'a> Layers<'a> {
    /// Lays `text` over `defaults`, and `settings` over both.
    ///
    /// # Errors
    /// What is no TOML; a setting that cannot be laid over it.
    pub fn new(
        defaults: &Table,
        path: &'a Path,
        text: &'a str,
        settings: &'a [Setting],
    ) -> Result<Self, ConfigError> {
        let table = text.parse::<Table>().map_err(|error| {
            let span = error.span().unwrap_or(0..0);
            ConfigError::in_line(path, text, span, error.message())
        })?;
        let mut merged = defaults.clone();
        merge(&mut merged, table);
        let apply = |setting: &'a Setting| {
            let refused = |problem| ConfigError(format!("--set {}: {problem}", setting.key));
            let key = apply(&mut merged, setting).map_err(refused)?;
            Ok((key, setting))
        };
        let settings = settings.iter().map(apply).collect::<Result<_, _>>()?;
        for list in ["methods", "sweep"] {
            for base in ["head", "encoder"] {
                inherit(&mut merged, base, list);
            }
        }
        take_back(&mut merged);
        let mut layers = Self {
            path,
            text,
            settings,
            expanded: merged.clone(),
            merged,
        };
        let expanded = expand(&mut layers.expanded);
        expanded.map_err(|(key, problem)| layers.error(&key, problem))?;
        take_back(&mut layers.expanded);
        Ok(layers)
    }

    /// The layers as one text.
    pub fn to_toml(&self) -> String {
        self.merged.to_string()
    }

    /// Whether any layer has this key, sweeps expanded.
    pub(crate) fn has(&self, key: &str) -> bool {
        let (first, rest) = key.split_once('.').unwrap_or((key, ""));
        let steps = rest.split('.').filter(|step| !step.is_empty());
        let found = steps.fold(self.expanded.get(first), |at, step| match at? {
            Value::Array(list) => list.get(step.parse::<usize>().ok()?),
            at => at.get(step),
        });
        found.is_some()
    }

    /// Reads the layers as one value.
    ///
    /// # Errors
    /// A key that is not known, or a value of another type, with its line.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        serde_path_to_error::deserialize(Value::Table(self.expanded.clone())).map_err(|error| {
            let mut key = segments(error.path());
            if key.len() > 2 && key[0] == "sweep" {
                // Which of its methods is not for the file to say.
                key.remove(2);
            }
            let message = error.inner().message();
            let unknown = UnknownName::of_serde(message);
            if let Some(UnknownName {
                what: "key", found, ..
            }) = &unknown
                && key.last() != Some(found)
            {
                key.push(found.clone());
            }
            let problem = unknown.map_or_else(|| message.to_owned(), |name| name.to_string());
            self.error_at(&key, problem)
        })
    }

    /// An error about the value at `key`, which has been read but cannot be meant.
    pub fn error(&self, key: &str, problem: impl Into<String>) -> ConfigError {
        let segments: Vec<String> = key.split('.').map(str::to_owned).collect();
        self.error_at(&segments, problem.into())
    }

    /// Refuses the value at `key` unless `holds`.
    ///
    /// # Errors
    /// The problem, with the line of the key, where it does not hold.
    pub fn require(&self, holds: bool, key: &str, problem: &str) -> Result<(), ConfigError> {
        if holds {
            Ok(())
        } else {
            Err(self.error(key, problem))
        }
    }

    /// What the value at `key` stands for.
    ///
    /// # Errors
    /// That it stands for nothing, with the line of the key.
    pub fn named<T, E: ToString>(&self, key: &str, found: Result<T, E>) -> Result<T, ConfigError> {
        found.map_err(|error| self.error(key, error.to_string()))
    }

    /// What came of checking settings of the table at `key`; it is empty for the whole config.
    ///
    /// # Errors
    /// The setting that was refused, with its line.
    pub fn checked<T>(
        &self,
        key: &str,
        checked: Result<T, sps_models::Error>,
    ) -> Result<T, ConfigError> {
        checked.map_err(|error| match error {
            sps_models::Error::Input(input) => {
                let problem = format!("is {}, expected {}", input.found, input.expected);
                self.error(&below(key, &input.what), problem)
            }
            other => self.error(key, other.to_string()),
        })
    }

    fn error_at(&self, key: &[String], problem: String) -> ConfigError {
        let dotted = key.join(".");
        let message = match dotted.as_str() {
            "" => problem,
            key => format!("`{key}`: {problem}"),
        };
        let is_set = |key: &str| dotted == key || dotted.starts_with(&format!("{key}."));
        let mut set = self.settings.iter().rev();
        if let Some((_, Setting { key, value })) = set.find(|(key, _)| is_set(key)) {
            return ConfigError(format!("--set {key}={value}: {message}"));
        }
        let table = DeTable::parse(self.text).ok();
        match table.and_then(|table| span_of(table.get_ref(), key)) {
            Some(span) => ConfigError::in_line(self.path, self.text, span, &message),
            None => ConfigError(format!("{}: {message}", self.path.display())),
        }
    }
}

fn segments(path: &KeyPath) -> Vec<String> {
    path.iter()
        .filter_map(|segment| match segment {
            Segment::Seq { index } => Some(index.to_string()),
            Segment::Map { key } => Some(key.clone()),
            Segment::Enum { .. } | Segment::Unknown => None,
        })
        .collect()
}

/// The span of the deepest part of `key` that the file holds.
fn span_of(table: &DeTable<'_>, key: &[String]) -> Option<Range<usize>> {
    let (first, rest) = key.split_first()?;
    let (name, value) = table.get_key_value(first.as_str())?;
    Some(span_inside(value.get_ref(), rest).unwrap_or_else(|| name.span()))
}

fn span_inside(value: &DeValue<'_>, key: &[String]) -> Option<Range<usize>> {
    match value {
        DeValue::Table(table) => span_of(table, key),
        DeValue::Array(list) => {
            let (index, rest) = key.split_first()?;
            let item = list.get(index.parse::<usize>().ok()?)?;
            Some(span_inside(item.get_ref(), rest).unwrap_or_else(|| item.span()))
        }
        _ => None,
    }
}

/// A wrong value, with the layer that it comes from.
#[derive(Debug)]
pub struct ConfigError(String);

impl ConfigError {
    /// What is wrong in the line of the file's text where the span begins.
    fn in_line(path: &Path, text: &str, span: Range<usize>, message: &str) -> Self {
        let before = text.get(..span.start.min(text.len())).unwrap_or(text);
        let line = before.matches('\n').count() + 1;
        let (path, shown) = (path.display(), text.lines().nth(line - 1));
        let shown = shown.unwrap_or_default();
        Self(format!(
            "{path}, line {line}: {message}\n  {line} | {shown}"
        ))
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for ConfigError {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Experiment;
    use crate::config::experiment::tests::METHOD;

    fn read(text: &str, settings: &[&str]) -> anyhow::Result<Experiment> {
        let settings: Vec<Setting> = settings.iter().map(|s| s.parse().unwrap()).collect();
        Experiment::parse(Path::new("a.toml"), text, &settings)
    }

    /// Holds that a config is refused with a message that begins so, and says what.
    fn refused(text: &str, settings: &[&str], begins: &str, says: &str) {
        let message = read(text, settings).unwrap_err().to_string();
        assert!(
            message.starts_with(begins) && message.contains(says),
            "{message}"
        );
    }

    #[test]
    fn later_layers_win() {
        let settings = ["seed=2", "methods.a.id=z", "methods.0.id=y"];
        let read = read(&format!("seed = 1\n{METHOD}"), &settings).unwrap();
        assert_eq!((read.seed, read.methods[0].id.as_str()), (2, "y"));
        assert_eq!(read.train.calibration, 0.25);
    }

    #[test]
    fn a_misspelt_key_shows_its_line_and_the_nearest_name() {
        let text = "seed = 1\n\n[head.adam]\nlearnin-rate = 2\n";
        for says in ["did you mean `learning-rate`?", "4 | learnin-rate = 2"] {
            refused(text, &[], "a.toml, line 4: ", says);
        }
        let listed = format!("{METHOD}[[methods]]\nid = \"b\"\nidd = 1");
        refused(&listed, &[], "a.toml, line 7: ", "idd");
    }

    #[test]
    fn a_setting_is_named_as_it_was_given() {
        let set = "head.adam.learning-rate=fast";
        let shown = "--set head.adam.learning-rate=\"fast\"";
        refused("seed = 1", &[set], shown, "");
        let shown = "--set methods.a.idd=\"b\"";
        refused(METHOD, &["methods.a.idd=b"], shown, "");
        let outside = "neither an id nor an index of a list of 1";
        refused(METHOD, &["methods.3.id=b"], "", outside);
    }

    #[test]
    fn broken_syntax_shows_its_line() {
        refused("seed = 1\nlearning = = 3", &[], "a.toml, line 2: ", "");
    }
}
