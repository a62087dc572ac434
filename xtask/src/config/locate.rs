//! Deserialises layered TOML and says where in which layer a value is wrong.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde_path_to_error::{Path as KeyPath, Segment};
use sps_base::names::UnknownName;
use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

use super::merge::{apply, inherit, merge, take_back};

/// One `--set KEY=VALUE`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Setting {
    /// Dotted, an index where the key is a list: `methods.0.id`.
    pub key: String,
    /// Parsed as TOML, or else taken as a string.
    pub value: Value,
}

impl std::str::FromStr for Setting {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (key, value) = text
            .split_once('=')
            .ok_or_else(|| format!("`{text}` is not KEY=VALUE"))?;
        let key = key.trim();
        if key.is_empty() || key.split('.').any(str::is_empty) {
            return Err(format!("`{key}` is not a key like `training.epochs`"));
        }
        let value = format!("v = {value}")
            .parse::<Table>()
            .ok()
            .and_then(|mut table| table.remove("v"))
            .unwrap_or_else(|| Value::String(value.to_owned()));
        Ok(Self {
            key: key.to_owned(),
            value,
        })
    }
}

/// A wrong value, with the layer that it comes from.
#[derive(Debug)]
pub(crate) struct ConfigError {
    place: Place,
    key: String,
    problem: String,
}

#[derive(Debug)]
enum Place {
    File {
        path: PathBuf,
        line: usize,
        text: String,
    },
    Setting(String),
    Whole(PathBuf),
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.place {
            Place::File { path, line, text } => {
                write!(f, "{}, line {line}: ", path.display())?;
                write!(f, "{}\n  {line} | {text}", self.message())
            }
            Place::Setting(setting) => write!(f, "--set {setting}: {}", self.message()),
            Place::Whole(path) => write!(f, "{}: {}", path.display(), self.message()),
        }
    }
}

impl std::error::Error for ConfigError {}

impl ConfigError {
    fn message(&self) -> String {
        if self.key.is_empty() {
            self.problem.clone()
        } else {
            format!("`{}`: {}", self.key, self.problem)
        }
    }
}

/// The text of a config, what it overrides and what overrides it.
pub(crate) struct Layers<'a> {
    path: &'a Path,
    text: &'a str,
    settings: &'a [Setting],
    merged: Table,
}

impl<'a> Layers<'a> {
    /// Lays `text` over `defaults`, and `settings` over both.
    pub(crate) fn new(
        defaults: &Table,
        path: &'a Path,
        text: &'a str,
        settings: &'a [Setting],
    ) -> Result<Self, ConfigError> {
        let table = text.parse::<Table>().map_err(|error| ConfigError {
            place: place_of_span(path, text, error.span().unwrap_or(0..0)),
            key: String::new(),
            problem: error.message().to_owned(),
        })?;
        let mut merged = defaults.clone();
        merge(&mut merged, table);
        for setting in settings {
            apply(&mut merged, setting).map_err(|problem| ConfigError {
                place: Place::Setting(setting.key.clone()),
                key: String::new(),
                problem,
            })?;
        }
        for list in ["methods", "sweep"] {
            for base in ["head", "encoder"] {
                inherit(&mut merged, base, list);
            }
        }
        take_back(&mut merged);
        Ok(Self {
            path,
            text,
            settings,
            merged,
        })
    }

    /// The layers as one text.
    pub(crate) fn to_toml(&self) -> String {
        self.merged.to_string()
    }

    /// Reads the layers as one value.
    pub(crate) fn read<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        serde_path_to_error::deserialize(Value::Table(self.merged.clone())).map_err(|error| {
            let mut key = segments(error.path());
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
    pub(crate) fn error(&self, key: &str, problem: impl Into<String>) -> ConfigError {
        let segments: Vec<String> = key.split('.').map(str::to_owned).collect();
        self.error_at(&segments, problem.into())
    }

    fn error_at(&self, key: &[String], problem: String) -> ConfigError {
        let dotted = key.join(".");
        let set = self.settings.iter().rev().find(|setting| {
            dotted == setting.key || dotted.starts_with(&format!("{}.", setting.key))
        });
        let place = match set {
            Some(setting) => Place::Setting(format!("{}={}", setting.key, setting.value)),
            None => self.place_in_file(key),
        };
        ConfigError {
            place,
            key: dotted,
            problem,
        }
    }

    fn place_in_file(&self, key: &[String]) -> Place {
        DeTable::parse(self.text)
            .ok()
            .and_then(|table| span_of(table.get_ref(), key))
            .map_or_else(
                || Place::Whole(self.path.to_owned()),
                |span| place_of_span(self.path, self.text, span),
            )
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
    let (name, value) = table
        .iter()
        .find(|(name, _)| name.get_ref().as_ref() == first)?;
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

fn place_of_span(path: &Path, text: &str, span: Range<usize>) -> Place {
    let before = text.get(..span.start.min(text.len())).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    Place::File {
        path: path.to_owned(),
        line,
        text: text.lines().nth(line - 1).unwrap_or_default().to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields, rename_all = "kebab-case")]
    struct Sample {
        seed: u64,
        training: Training,
        #[serde(default)]
        methods: Vec<Method>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields, rename_all = "kebab-case")]
    struct Training {
        learning_rate: f64,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields, rename_all = "kebab-case")]
    struct Method {
        id: String,
    }

    const DEFAULTS: &str = "seed = 7\n[training]\nlearning-rate = 1e-4\n";

    fn read(text: &str, settings: &[&str]) -> Result<Sample, String> {
        let settings: Vec<Setting> = settings.iter().map(|s| s.parse().unwrap()).collect();
        let defaults = DEFAULTS.parse().unwrap();
        Layers::new(&defaults, Path::new("a.toml"), text, &settings)
            .and_then(|layers| layers.read())
            .map_err(|error| error.to_string())
    }

    #[test]
    fn later_layers_win() {
        let sample = read(
            "seed = 1\n[[methods]]\nid = \"x\"",
            &["seed=2", "methods.0.id=y"],
        );
        let sample = sample.unwrap();
        assert_eq!((sample.seed, sample.methods[0].id.as_str()), (2, "y"));
        assert_eq!(sample.training.learning_rate, 1e-4);
    }

    #[test]
    fn a_misspelt_key_shows_its_line_and_the_nearest_name() {
        let message = read("seed = 1\n\n[training]\nlearnin-rate = 2\n", &[]).unwrap_err();
        assert!(message.starts_with("a.toml, line 4: "), "{message}");
        assert!(
            message.contains("did you mean `learning-rate`?"),
            "{message}"
        );
        assert!(message.contains("4 | learnin-rate = 2"), "{message}");
    }

    #[test]
    fn a_misspelt_key_in_a_list_shows_its_line() {
        let message = read(
            "[[methods]]\nid = \"a\"\n[[methods]]\nid = \"b\"\nidd = 1",
            &[],
        );
        assert!(message.unwrap_err().starts_with("a.toml, line 5: "));
    }

    #[test]
    fn a_wrong_type_names_the_setting_it_came_from() {
        let message = read("seed = 1", &["training.learning-rate=fast"]).unwrap_err();
        assert!(
            message.starts_with("--set training.learning-rate=\"fast\""),
            "{message}"
        );
    }

    #[test]
    fn broken_syntax_shows_its_line() {
        let message = read("seed = 1\nlearning = = 3", &[]).unwrap_err();
        assert!(message.starts_with("a.toml, line 2: "), "{message}");
    }

    #[test]
    fn a_setting_outside_a_list_is_refused() {
        let message = read("[[methods]]\nid = \"a\"", &["methods.3.id=b"]).unwrap_err();
        assert!(message.contains("not an index of a list of 1"), "{message}");
    }
}
