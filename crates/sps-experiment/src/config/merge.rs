//! How one layer of a config is laid over another.

use toml::{Table, Value};

use super::layers::Setting;

/// Keys that say which of several kinds of table a table is.
const TAGS: [&str; 2] = ["kind", "source"];

/// Tables that a config need not have; `false` in the place of one takes it back.
const OPTIONAL: [&str; 3] = ["adversarial", "classification", "early-stopping"];

/// Lays one table over another; a table that says its kind begins anew, and nothing of the one
/// below shows through.
pub(super) fn merge(under: &mut Table, over: Table) {
    for (key, value) in over {
        match (under.get_mut(&key), value) {
            (Some(Value::Table(under)), Value::Table(over)) if !begins_anew(&over) => {
                merge(under, over);
            }
            (_, value) => {
                under.insert(key, value);
            }
        }
    }
}

fn begins_anew(over: &Table) -> bool {
    TAGS.iter().any(|tag| over.contains_key(*tag))
}

/// Lays each item of `list` over the top-level table `base`, under that name.
pub(super) fn inherit(table: &mut Table, base: &str, list: &str) {
    let Some(base_value @ Value::Table(_)) = table.get(base).cloned() else {
        return;
    };
    let Some(Value::Array(items)) = table.get_mut(list) else {
        return;
    };
    for item in items.iter_mut().filter_map(Value::as_table_mut) {
        let mut inherited = Table::from_iter([(base.to_owned(), base_value.clone())]);
        let own = item.remove(base).map(|own| (base.to_owned(), own));
        merge(&mut inherited, own.into_iter().collect());
        item.extend(inherited);
    }
}

/// Removes the optional tables that are `false`.
pub(super) fn take_back(table: &mut Table) {
    table.retain(|key, value| {
        take_back_inside(value);
        !OPTIONAL.contains(&key) || *value != Value::Boolean(false)
    });
}

fn take_back_inside(value: &mut Value) {
    match value {
        Value::Table(table) => take_back(table),
        Value::Array(list) => list.iter_mut().for_each(take_back_inside),
        _ => {}
    }
}

/// Puts the setting's value in its place; gives its key, with an index for each element of a list.
pub(super) fn apply(table: &mut Table, setting: &Setting) -> Result<String, String> {
    let mut root = Value::Table(std::mem::take(table));
    let outcome = put(&mut root, &setting.key, setting.value.clone());
    if let Value::Table(merged) = root {
        *table = merged;
    }
    outcome
}

fn put(at: &mut Value, key: &str, new: Value) -> Result<String, String> {
    let (step, rest) = match key.split_once('.') {
        Some((step, rest)) => (step, Some(rest)),
        None => (key, None),
    };
    let (step, place) = match at {
        Value::Table(table) => {
            let place = table.entry(step).or_insert(Value::Table(Table::new()));
            (step.to_owned(), place)
        }
        Value::Array(list) => {
            let index = index(list, step)?;
            (index.to_string(), &mut list[index])
        }
        other => return Err(format!("`{step}` lies inside a {}", other.type_str())),
    };
    if let Some(rest) = rest {
        return Ok(format!("{step}.{}", put(place, rest, new)?));
    }
    *place = new;
    Ok(step)
}

/// The index of the element with this index, or with this `id`.
fn index(list: &[Value], name: &str) -> Result<usize, String> {
    let id = |value: &Value| value.get("id").and_then(Value::as_str) == Some(name);
    let index = name.parse().ok().filter(|index| *index < list.len());
    let index = index.or_else(|| list.iter().position(id));
    let length = list.len();
    index.ok_or_else(|| format!("`{name}` is neither an id nor an index of a list of {length}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOP: &str = "[head]\nepochs = 30\n[head.model]\nkind = 'cross-modal'\nlatent = 100\n\
                       adversarial = { weight = 0.5 }\n";

    fn table(text: &str) -> Table {
        text.parse().unwrap()
    }

    /// The settings of the only method (or sweep) laid over [`TOP`], `own` among them.
    fn inherited(list: &str, own: &str) -> Table {
        let mut table = table(&format!("{TOP}[[{list}]]\n{own}"));
        inherit(&mut table, "head", list);
        take_back(&mut table);
        table
    }

    #[test]
    fn a_head_is_laid_over_the_inherited_one() {
        for (own, model) in [
            // A kind begins its table anew, and no other.
            ("model = { kind = 'cross-modal' }", "kind = 'cross-modal'"),
            (
                "model = { kind = 'cross-modal', adversarial = {} }",
                "kind = 'cross-modal', adversarial = {}",
            ),
            ("model = { kind = 'regression' }", "kind = 'regression'"),
            // A table without a kind is laid over the inherited one.
            (
                "model.latent = 50",
                "kind = 'cross-modal', latent = 50, adversarial = { weight = 0.5 }",
            ),
            // False takes an optional table back, inherited or not.
            (
                "model.adversarial = false",
                "kind = 'cross-modal', latent = 100",
            ),
            (
                "model.classification = false",
                "kind = 'cross-modal', latent = 100, adversarial = { weight = 0.5 }",
            ),
            (
                "model = { kind = 'cross-modal', adversarial = false }",
                "kind = 'cross-modal'",
            ),
        ] {
            for list in ["methods", "sweep"] {
                let expected = |epochs| table(&format!("epochs = {epochs}\nmodel = {{ {model} }}"));
                let own = format!("head.{own}\nhead.early-stopping = false\n");
                let head = &inherited(list, &own)[list][0]["head"];
                assert_eq!(*head.as_table().unwrap(), expected(30), "{own}");
                let head = &inherited(list, &format!("{own}head.epochs = 9"))[list][0]["head"];
                assert_eq!(*head.as_table().unwrap(), expected(9), "{own}");
            }
        }
    }

    #[test]
    fn false_elsewhere_is_a_value() {
        let layered = table("a = { adversarial = true, trainable = false }");
        let mut taken = layered.clone();
        take_back(&mut taken);
        assert_eq!(taken, layered);
    }

    /// What a run writes down as `config.toml` says the same when it is read again.
    #[test]
    fn inheriting_twice_changes_nothing() {
        let once = inherited("methods", "head.model.adversarial = false");
        let mut twice = once.clone();
        inherit(&mut twice, "head", "methods");
        take_back(&mut twice);
        assert_eq!(once, twice);
    }
}
