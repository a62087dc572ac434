//! What two runs were computed from and with, where it differs.

use std::fmt;

use serde::Serialize;
use toml::{Table, Value};

use super::Run;

/// One side of what a run depends on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Aspect {
    pub name: &'static str,
    /// Empty where it is the same in both.
    pub differing: Vec<Differing>,
}

/// A value that is another in each run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Differing {
    pub key: String,
    /// `null` where there is none.
    pub first: Option<String>,
    pub second: Option<String>,
}

impl fmt::Display for Differing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [there, here] =
            [&self.first, &self.second].map(|value| value.as_deref().unwrap_or("not set"));
        write!(f, "`{}` is {there}, here {here}", self.key)
    }
}

/// Config, sources, data and machine.
pub(super) fn aspects(first: &Run, second: &Run) -> Vec<Aspect> {
    let config = differing_keys(&first.config, &second.config);
    let [(then, data), (now, other)] =
        [first, second].map(|run| (&run.results.provenance, &run.results.dataset));
    let sources = [("source_hash", &then.source_hash, &now.source_hash)];
    let readings = [
        ("data_hash", &then.data_hash, &now.data_hash),
        ("name", &data.name, &other.name),
        (
            "surfaces",
            &data.surfaces.to_string(),
            &other.surfaces.to_string(),
        ),
        ("units", &data.units.to_string(), &other.units.to_string()),
        ("views", &data.views.to_string(), &other.views.to_string()),
    ];
    let machine = [
        ("cpu", &then.cpu, &now.cpu),
        (
            "threads",
            &then.threads.to_string(),
            &now.threads.to_string(),
        ),
    ];
    let aspect = |name, differing| Aspect { name, differing };
    vec![
        aspect("config", config),
        aspect("sources", texts(&sources)),
        aspect("data", texts(&readings)),
        aspect("machine", texts(&machine)),
    ]
}

fn texts(values: &[(&str, &String, &String)]) -> Vec<Differing> {
    let differing = values.iter().filter(|(_, first, second)| first != second);
    let found = differing.map(|(key, first, second)| Differing {
        key: (*key).to_owned(),
        first: Some((*first).clone()),
        second: Some((*second).clone()),
    });
    found.collect()
}

/// The keys of two configs whose values differ.
pub(crate) fn differing_keys(first: &Table, second: &Table) -> Vec<Differing> {
    let mut found = Vec::new();
    tables("", first, second, &mut found);
    found
}

/// The keys below `prefix` whose values differ.
fn tables(prefix: &str, first: &Table, second: &Table, found: &mut Vec<Differing>) {
    let added = second.keys().filter(|key| !first.contains_key(*key));
    for key in first.keys().chain(added) {
        values(
            &format!("{prefix}{key}"),
            first.get(key),
            second.get(key),
            found,
        );
    }
}

/// `key` itself, or what differs within it.
fn values(key: &str, first: Option<&Value>, second: Option<&Value>, found: &mut Vec<Differing>) {
    if first == second {
        return;
    }
    let within = first.zip(second).and_then(|(first, second)| {
        let named = by_id(first).zip(by_id(second));
        named.or_else(|| Some((first.as_table()?.clone(), second.as_table()?.clone())))
    });
    if let Some((first, second)) = within {
        tables(&format!("{key}."), &first, &second, found);
        return;
    }
    let text = |value: Option<&Value>| value.map(ToString::to_string);
    found.push(Differing {
        key: key.to_owned(),
        first: text(first),
        second: text(second),
    });
}

/// An array of tables that have an `id` each, as a table.
fn by_id(value: &Value) -> Option<Table> {
    let named = value.as_array()?.iter().map(|one| {
        let id = one.get("id")?.as_str()?.to_owned();
        Some((id, one.clone()))
    });
    named.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn differing(first: &str, second: &str) -> Vec<[String; 3]> {
        let mut found = Vec::new();
        let [first, second] = [first, second].map(|text| text.parse::<Table>().unwrap());
        tables("", &first, &second, &mut found);
        let none = || "none".to_owned();
        let found = found.into_iter();
        found
            .map(|one| {
                [
                    one.key,
                    one.first.unwrap_or_else(none),
                    one.second.unwrap_or_else(none),
                ]
            })
            .collect()
    }

    #[test]
    fn keys_are_named_down_to_the_value() {
        let first = "seed = 0\n[data]\nviews = 3\nsize = 48\n[gone]\na = 1";
        let second = "seed = 1\n[data]\nviews = 3\nsize = 64\nnew = true";
        assert_eq!(
            differing(first, second),
            [
                ["seed", "0", "1"],
                ["data.size", "48", "64"],
                ["data.new", "none", "true"],
                ["gone", "{ a = 1 }", "none"],
            ]
        );
        assert!(differing(first, first).is_empty());
    }

    #[test]
    fn methods_are_named_by_their_ids() {
        let first = "[[methods]]\nid = \"a\"\nviews = 1\n[[methods]]\nid = \"b\"\nviews = 1";
        let second = "[[methods]]\nid = \"b\"\nviews = 2\n[[methods]]\nid = \"a\"\nviews = 1";
        assert_eq!(differing(first, second), [["methods.b.views", "1", "2"]]);
        assert_eq!(
            differing("angles = [1.0, 2.0]", "angles = [1.0]"),
            [["angles", "[1.0, 2.0]", "[1.0]"]]
        );
    }
}
