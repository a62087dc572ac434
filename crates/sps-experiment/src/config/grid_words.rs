//! What the methods of a sweep are called.

use toml::{Table, Value};

use super::grid::{self, Point};

pub(super) fn id_word(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Table(_) => leaves(value, "-").join("-"),
        other => other.to_string(),
    }
}

pub(super) fn label_word(method: &Table, key: &str, point: &Point) -> String {
    let last = key.rsplit('.').next().unwrap_or(key);
    let model = || method.get("head")?.get("model")?.get("kind")?.as_str();
    match (key, &point.value) {
        // A network goes by what it is a network of.
        ("kind", Value::String(kind)) if kind == "head" => model().unwrap_or(kind).to_owned(),
        ("views", Value::Integer(1)) => "1 view".to_owned(),
        ("views", number) => format!("{} views", id_word(number)),
        ("training-surfaces", number) => format!("{number} training surfaces"),
        (_, Value::String(text)) => text.clone(),
        (_, Value::Table(table)) if table.is_empty() => point.called.clone().unwrap_or_default(),
        (_, table @ Value::Table(_)) => leaves(table, " ").join(", "),
        (_, value) => format!("{last} {value}"),
    }
}

/// The values of a table, each after its key.
fn leaves(table: &Value, between: &str) -> Vec<String> {
    let word = |(key, value): &(String, Value)| {
        let last = key.rsplit('.').next().unwrap_or(key);
        format!("{last}{between}{}", id_word(value))
    };
    grid::leaves("", table).iter().map(word).collect()
}

/// The words in the places that `given` names as `{key}`, or after it where it names none.
pub(super) fn titled(
    given: &str,
    between: &str,
    words: &[(&str, String)],
) -> Result<String, String> {
    if !given.contains('{') {
        let mut all: Vec<&str> = words.iter().map(|(_, word)| &word[..]).collect();
        if !given.is_empty() {
            all.insert(0, given);
        }
        return Ok(all.join(between));
    }
    let mut title = String::new();
    let mut rest = given;
    while let Some((before, after)) = rest.split_once('{') {
        let (key, after) = after
            .split_once('}')
            .ok_or_else(|| format!("`{given}` has a {{ that is not closed"))?;
        let word = words.iter().find(|(other, _)| *other == key);
        let (_, word) = word.ok_or_else(|| {
            let keys: Vec<&str> = words.iter().map(|(key, _)| *key).collect();
            format!("no `{key}` in the grid, which has {}", keys.join(", "))
        })?;
        title.push_str(before);
        title.push_str(word);
        rest = after;
    }
    title.push_str(rest);
    Ok(title)
}
