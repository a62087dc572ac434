//! Where a value is wrong, and which name was meant.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};

/// A wrong value, with the layer that it comes from.
#[derive(Debug)]
pub struct ConfigError {
    pub(super) place: Place,
    pub(super) key: String,
    pub(super) problem: String,
}

#[derive(Debug)]
pub(super) enum Place {
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
        let message = match self.key.as_str() {
            "" => self.problem.clone(),
            key => format!("`{key}`: {}", self.problem),
        };
        match &self.place {
            Place::File { path, line, text } => {
                let path = path.display();
                write!(f, "{path}, line {line}: {message}\n  {line} | {text}")
            }
            Place::Setting(setting) => write!(f, "--set {setting}: {message}"),
            Place::Whole(path) => write!(f, "{}: {message}", path.display()),
        }
    }
}

impl std::error::Error for ConfigError {}

/// The span of the deepest part of `key` that the file holds.
pub(super) fn span_of(table: &DeTable<'_>, key: &[String]) -> Option<Range<usize>> {
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

pub(super) fn place_of_span(path: &Path, text: &str, span: Range<usize>) -> Place {
    let before = text.get(..span.start.min(text.len())).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    Place::File {
        path: path.to_owned(),
        line,
        text: text.lines().nth(line - 1).unwrap_or_default().to_owned(),
    }
}
