//! What of two configs differs.

use std::fmt;

use serde::Serialize;
use toml::{Table, Value};

/// A value that is another in each run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Differing {
    /// Its key, with those of the tables that it lies in.
    pub key: String,
    /// `null` where there is none.
    pub first: Option<String>,
    /// The same in the second.
    pub second: Option<String>,
}

impl fmt::Display for Differing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [there, here] =
            [&self.first, &self.second].map(|value| value.as_deref().unwrap_or("not set"));
        write!(f, "`{}` is {there}, here {here}", self.key)
    }
}

/// The keys of two configs whose values differ.
pub fn differing_keys(first: &Table, second: &Table) -> Vec<Differing> {
    let mut found = Vec::new();
    tables("", first, second, &mut found);
    found
}

fn tables(prefix: &str, first: &Table, second: &Table, found: &mut Vec<Differing>) {
    let added = second.keys().filter(|key| !first.contains_key(*key));
    for key in first.keys().chain(added) {
        let [first, second] = [first, second].map(|table| table.get(key));
        if first == second {
            continue;
        }
        let key = format!("{prefix}{key}");
        let within = first.zip(second).and_then(|(first, second)| {
            let named = by_id(first).zip(by_id(second));
            named.or_else(|| Some((first.as_table()?.clone(), second.as_table()?.clone())))
        });
        if let Some((first, second)) = within {
            tables(&format!("{key}."), &first, &second, found);
        } else {
            let [first, second] = [first, second].map(|value| value.map(ToString::to_string));
            found.push(Differing { key, first, second });
        }
    }
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

    fn differing(first: &str, second: &str) -> Vec<String> {
        let [first, second] = [first, second].map(|text| text.parse().unwrap());
        let found = differing_keys(&first, &second);
        found.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn keys_are_named_down_to_the_value() {
        let first = "seed = 0\n[data]\nviews = 3\nsize = 48\n[gone]\na = 1";
        let second = "seed = 1\n[data]\nviews = 3\nsize = 64\nnew = true";
        assert_eq!(
            differing(first, second),
            [
                "`seed` is 0, here 1",
                "`data.size` is 48, here 64",
                "`data.new` is not set, here true",
                "`gone` is { a = 1 }, here not set",
            ]
        );
        assert!(differing(first, first).is_empty());
    }

    #[test]
    fn methods_are_named_by_their_ids() {
        let first = "[[methods]]\nid = \"a\"\nviews = 1\n[[methods]]\nid = \"b\"\nviews = 1";
        let second = "[[methods]]\nid = \"b\"\nviews = 2\n[[methods]]\nid = \"a\"\nviews = 1";
        let views = ["`methods.b.views` is 1, here 2"];
        assert_eq!(differing(first, second), views);
        let angles = ["`angles` is [1.0, 2.0], here [1.0]"];
        assert_eq!(differing("angles = [1.0, 2.0]", "angles = [1.0]"), angles);
    }
}
