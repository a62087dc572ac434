//! Methods that a sweep makes: one for each combination of the values in its grid.

use toml::{Table, Value};

use super::grid_words::{id_word, label_word, titled};
use super::merge::merge;

/// Methods that a sweep may make where it does not say.
const AT_MOST: i64 = 100;

/// A key that is wrong, dotted, and why.
type Refused = (String, String);

/// Puts in the place of each sweep the list of its methods. A `[sweep]` that is one table is a grid for
/// each of the methods, which it replaces.
pub(super) fn expand(config: &mut Table) -> Result<(), Refused> {
    let methods = match config.get_mut("sweep") {
        Some(Value::Table(grid)) => {
            let grid = std::mem::take(grid);
            let listed = config.insert("methods".to_owned(), Value::Array(Vec::new()));
            swept(listed, &grid)?
        }
        Some(Value::Array(sweeps)) => {
            let numbered = std::mem::take(sweeps).into_iter().enumerate();
            let methods = numbered.map(|(at, sweep)| of_sweep(sweep, &format!("sweep.{at}")));
            methods.collect::<Result<_, _>>()?
        }
        _ => return Ok(()),
    };
    config.insert("sweep".to_owned(), Value::Array(methods));
    Ok(())
}

/// The methods that are listed, each in all combinations.
fn swept(listed: Option<Value>, grid: &Table) -> Result<Vec<Value>, Refused> {
    let Some(Value::Array(listed)) = listed else {
        let problem = "varies what methods have, and there are none";
        return Err(("sweep".to_owned(), problem.to_owned()));
    };
    let mut axes = grid.clone();
    let mut limits = Table::new();
    for key in ["except", "at-most"] {
        limits.extend(axes.remove(key).map(|value| (key.to_owned(), value)));
    }
    let of_method = |method: Value| match method {
        Value::Table(mut method) => {
            method.extend(limits.clone());
            method.insert("grid".to_owned(), Value::Table(axes.clone()));
            of_sweep(Value::Table(method), "sweep")
        }
        other => Ok(other),
    };
    listed.into_iter().map(of_method).collect()
}

fn of_sweep(sweep: Value, at: &str) -> Result<Value, Refused> {
    let Value::Table(mut method) = sweep else {
        return Ok(sweep);
    };
    let refused = |key: &str, problem: String| (format!("{at}.{key}"), problem);
    let mut axes = Vec::new();
    if let Some(grid) = method.remove("grid") {
        find_axes(&grid, "", &mut axes).map_err(|problem| refused("grid", problem))?;
    }
    let except = exceptions(method.remove("except"));
    let except = except.map_err(|problem| refused("except", problem))?;
    let at_most = match method.remove("at-most") {
        None => AT_MOST,
        Some(Value::Integer(number)) => number,
        Some(other) => return Err(refused("at-most", format!("{other} is no number"))),
    };
    let mut chosen = combinations(&axes);
    chosen.retain(|one| !except.iter().any(|none| is_one_of(one, none)));
    if chosen.len() as i64 > at_most {
        let problem = format!("{} methods; `at-most` allows {at_most}", chosen.len());
        return Err(refused("grid", problem));
    }
    let methods = chosen.iter().map(|chosen| {
        let method = of_combination(&method, chosen).map(Value::Table);
        method.map_err(|(key, problem)| refused(key, problem))
    });
    methods.collect::<Result<_, _>>().map(Value::Array)
}

/// A dotted key, and the values that it takes.
type Axis = (String, Vec<Point>);

pub(super) struct Point {
    pub value: Value,
    /// What it is called in ids, where the config says so by `as`.
    pub called: Option<String>,
}

type Combination<'a> = Vec<(&'a str, &'a Point)>;

/// The lists in the grid by their dotted keys, in the order in which they are written.
fn find_axes(grid: &Value, key: &str, axes: &mut Vec<Axis>) -> Result<(), String> {
    match grid {
        Value::Table(table) => {
            for (name, value) in table {
                find_axes(value, &below(key, name), axes)?;
            }
        }
        Value::Array(values) if !key.is_empty() => {
            axes.push((key.to_owned(), values.iter().map(point).collect()));
        }
        other => return Err(format!("`{key}` is {other}, expected a list of values")),
    }
    Ok(())
}

/// The dotted key of what is called `name` in the table at `key`.
pub(super) fn below(key: &str, name: &str) -> String {
    let dot = if key.is_empty() { "" } else { "." };
    format!("{key}{dot}{name}")
}

fn point(value: &Value) -> Point {
    let mut value = value.clone();
    let called = value.as_table_mut().and_then(|table| table.remove("as"));
    let called = called.map(|name| id_word(&name));
    Point { value, called }
}

fn combinations(axes: &[Axis]) -> Vec<Combination<'_>> {
    let mut all = vec![Vec::new()];
    for (key, points) in axes {
        let with = |one: Vec<_>| {
            let points = points.iter();
            let extended = points.map(|point| [&one[..], &[(&key[..], point)]].concat());
            extended.collect::<Vec<_>>()
        };
        all = all.into_iter().flat_map(with).collect();
    }
    all
}

/// The combinations to leave out, each as values of some keys.
fn exceptions(except: Option<Value>) -> Result<Vec<Vec<(String, Value)>>, String> {
    let tables = match except {
        None => return Ok(Vec::new()),
        Some(Value::Array(tables)) => tables,
        Some(other) => return Err(format!("{other} is no list of tables")),
    };
    let of_table = |table: Value| match table {
        Value::Table(_) => Ok(leaves("", &table)),
        other => Err(format!("{other} is no table of keys and values")),
    };
    tables.into_iter().map(of_table).collect()
}

/// The values in a table by their dotted keys; `key` is its own.
pub(super) fn leaves(key: &str, value: &Value) -> Vec<(String, Value)> {
    match value {
        Value::Table(table) if !table.is_empty() => {
            let inside = table.iter();
            let inside = inside.flat_map(|(name, value)| leaves(&below(key, name), value));
            inside.collect()
        }
        other => vec![(key.to_owned(), other.clone())],
    }
}

/// Whether the combination has all of these values, each given as it is or as it is called.
fn is_one_of(one: &Combination<'_>, values: &[(String, Value)]) -> bool {
    let is = |point: &Point, value: &Value| {
        point.value == *value || point.called.is_some() && point.called.as_deref() == value.as_str()
    };
    let has = |(key, value): &(String, Value)| {
        let mut chosen = one.iter();
        chosen.any(|(other, point)| other == key && is(point, value))
    };
    values.iter().all(has)
}

fn of_combination(
    method: &Table,
    chosen: &Combination<'_>,
) -> Result<Table, (&'static str, String)> {
    let mut made = method.clone();
    for (key, point) in chosen {
        merge(&mut made, nested(key, point.value.clone()));
    }
    settle_views(&mut made, chosen);
    let chosen = chosen.iter();
    let ids = chosen.clone().map(|&(key, point)| (key, id_of(point)));
    let labels = chosen.map(|&(key, point)| (key, label_word(&made, key, point)));
    let (ids, labels) = (ids.collect(), labels.collect());
    let mut set = |title: &'static str, between, words: Vec<(&str, String)>| {
        let given = made.get(title).and_then(Value::as_str).unwrap_or_default();
        let text = titled(given, between, &words).map_err(|problem| (title, problem))?;
        made.insert(title.to_owned(), Value::String(text));
        Ok::<_, (&'static str, String)>(())
    };
    set("id", "-", ids)?;
    set("label", ", ", labels)?;
    Ok(made)
}

fn id_of(point: &Point) -> String {
    let called = point.called.clone();
    called.unwrap_or_else(|| id_word(&point.value))
}

/// A table with nothing but this value at its dotted key.
fn nested(key: &str, value: Value) -> Table {
    match key.split_once('.') {
        Some((first, rest)) => {
            Table::from_iter([(first.to_owned(), Value::Table(nested(rest, value)))])
        }
        None => Table::from_iter([(key.to_owned(), value)]),
    }
}

/// Where the number of views is in the grid, one view and all views leave a selector nothing to choose:
/// what is said of it holds for the other numbers.
fn settle_views(method: &mut Table, chosen: &Combination<'_>) {
    let Some((_, views)) = chosen.iter().find(|(key, _)| *key == "views") else {
        return;
    };
    let selector_varies = chosen.iter().any(|(key, _)| key.starts_with("selector"));
    let all = views.value.as_str() == Some("all");
    if all || (views.value.as_integer() == Some(1) && !selector_varies) {
        for key in ["selector", "distinct", "refit"] {
            method.remove(key);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expanded(text: &str) -> Result<Vec<Value>, Refused> {
        let mut config: Table = text.parse().unwrap();
        expand(&mut config)?;
        let sweeps = config["sweep"].as_array().unwrap();
        let methods = sweeps.iter().flat_map(|sweep| sweep.as_array().unwrap());
        Ok(methods.cloned().collect())
    }

    /// The id and the label of each method.
    fn titles(text: &str) -> Vec<[String; 2]> {
        let titles = |method: &Value| {
            ["id", "label"].map(|title| method[title].as_str().unwrap().to_owned())
        };
        expanded(text).unwrap().iter().map(titles).collect()
    }

    #[test]
    fn the_last_key_varies_fastest_and_names_are_made_of_what_varies() {
        let text = "[[sweep]]\nid = \"net\"\nlabel = \"Network\"\nkind = \"head\"\n\
            [sweep.grid]\nviews = [1, 3, \"all\"]\nhead.epochs = [10, 30]\n";
        assert_eq!(
            titles(text),
            [
                ["net-1-10", "Network, 1 view, epochs 10"],
                ["net-1-30", "Network, 1 view, epochs 30"],
                ["net-3-10", "Network, 3 views, epochs 10"],
                ["net-3-30", "Network, 3 views, epochs 30"],
                ["net-all-10", "Network, all views, epochs 10"],
                ["net-all-30", "Network, all views, epochs 30"],
            ]
        );
        let methods = expanded(text).unwrap();
        let views = [0, 2, 4].map(|at: usize| methods[at]["views"].clone());
        assert_eq!(views, [1.into(), 3.into(), "all".into()]);
        assert_eq!(methods[5]["head"]["epochs"], Value::Integer(30));
    }

    #[test]
    fn titles_may_say_where_what_varies_stands() {
        let text = "[[sweep]]\nid = \"{head}-{views}-net\"\nlabel = \"{head}, {views}\"\n\
            kind = \"head\"\n[sweep.grid]\nviews = [2]\n\
            head = [{ as = \"slow\", epochs = 90 }, { epochs = 3, adam.weight-decay = 0.5 }]\n";
        assert_eq!(
            titles(text),
            [
                ["slow-2-net", "epochs 90, 2 views"],
                [
                    "epochs-3-weight-decay-0.5-2-net",
                    "epochs 3, weight-decay 0.5, 2 views"
                ],
            ]
        );
    }

    #[test]
    fn one_grid_may_vary_all_methods() {
        let text = "[[methods]]\nid = \"a\"\nlabel = \"A\"\nkind = \"ridge\"\n\
            [[methods]]\nid = \"b\"\nlabel = \"B\"\nkind = \"head\"\n\
            [sweep]\n\"encoder.resize\" = [64, 128]\nviews = [1, 3]\n\
            except = [{ encoder.resize = 64, views = 3 }]\n";
        let ids: Vec<String> = titles(text).into_iter().map(|[id, _]| id).collect();
        assert_eq!(
            ids,
            [
                "a-64-1", "a-128-1", "a-128-3", "b-64-1", "b-128-1", "b-128-3"
            ]
        );
    }

    #[test]
    fn what_cannot_be_meant_is_refused() {
        for (keys, key, problem) in [
            (
                "at-most = 3\ngrid = { views = [1, 2], seed = [1, 2] }",
                "sweep.0.grid",
                "4 methods; `at-most` allows 3",
            ),
            (
                "grid = { head = { epochs = 3 } }",
                "sweep.0.grid",
                "`head.epochs` is 3, expected a list of values",
            ),
            (
                "label = \"{epochs}\"\ngrid = { head.epochs = [3] }",
                "sweep.0.label",
                "no `epochs` in the grid, which has head.epochs",
            ),
            ("except = 3", "sweep.0.except", "3 is no list of tables"),
        ] {
            let refused = expanded(&format!("[[sweep]]\nid = \"a\"\n{keys}")).unwrap_err();
            assert_eq!(refused, (key.to_owned(), problem.to_owned()));
        }
    }
}
