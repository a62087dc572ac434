//! What stands between markers: tables, paragraphs and single numbers of a run.

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;

use super::kept::Runs;
use super::markers::Form;
use crate::report::table::{Cell, Row, Table, number};
use crate::report::{about_the_data, gained, tables};
use crate::results::{MethodResult, Results};

/// Decimals where a marker does not say how many.
const DECIMALS: usize = 3;

/// What a marker asks for, as it stands between the two.
pub(super) fn render(runs: &Runs, form: Form, words: &str) -> Result<String> {
    match form {
        Form::Block => Ok(format!("\n{}\n", block(runs, words)?)),
        Form::Inline => inline(runs, words),
    }
}

/// The words of a marker: some in order, and options.
struct Request<'w> {
    words: Vec<&'w str>,
    options: Vec<(&'w str, &'w str)>,
}

impl<'w> Request<'w> {
    fn of(text: &'w str, count: usize, known: &[&str]) -> Result<Self> {
        let (options, words): (Vec<&str>, Vec<&str>) =
            text.split_whitespace().partition(|word| word.contains('='));
        ensure!(
            words.len() == count,
            "`{text}` has {} words, expected {count}",
            words.len()
        );
        let options: Vec<_> = options.iter().filter_map(|o| o.split_once('=')).collect();
        for (key, _) in &options {
            let expected = known.join("`, `");
            ensure!(
                known.contains(key),
                "unknown option `{key}`, expected `{expected}`"
            );
        }
        Ok(Self { words, options })
    }

    fn option(&self, key: &str) -> Option<&'w str> {
        let found = self.options.iter().find(|(name, _)| *name == key);
        found.map(|(_, value)| *value)
    }
}

/// `RUN TABLE [rows=ID,ID] [columns=TITLE,TITLE]`, or `RUN about`.
fn block(runs: &Runs, text: &str) -> Result<String> {
    let request = Request::of(text, 2, &["rows", "columns"])?;
    let results = runs.get(request.words[0])?;
    if request.words[1] == "about" {
        return Ok(about_the_data(results));
    }
    let mut table = find(results, request.words[1])?;
    if let Some(ids) = request.option("rows") {
        table.rows = rows(&table, results, ids)?;
    }
    if let Some(titles) = request.option("columns") {
        table = columns(&table, titles)?;
    }
    Ok(table.markdown())
}

/// The one table in whose title the word, or words with hyphens between, stands.
fn find(results: &Results, words: &str) -> Result<Table> {
    let mut tables = tables(results);
    tables.extend(gains(results));
    let titles: Vec<String> = tables.iter().map(|table| slug(&table.title)).collect();
    let holds = |title: &str| format!("-{title}-").contains(&format!("-{words}-"));
    let mut found = tables
        .into_iter()
        .filter(|table| holds(&slug(&table.title)));
    match (found.next(), found.next()) {
        (Some(table), None) => Ok(table),
        (first, _) => bail!(
            "{} of this run has `{words}` in its title; there are `{}`",
            first.map_or("no table", |_| "more than one table"),
            titles.join("`, `")
        ),
    }
}

/// Every method's gains over those that all are compared with, to more decimals than the means.
fn gains(results: &Results) -> Option<Table> {
    let against = results.compared_with();
    let mut columns = vec!["Method".to_owned(), "R²".to_owned()];
    columns.extend(against.iter().map(|other| format!("over {}", other.label)));
    let rows = results.methods.iter().map(|method| {
        let r2 = Cell::number(method.means.r2_mean, DECIMALS);
        let mut cells = vec![method.label.as_str().into(), r2];
        let gains = &method.gains.r2_mean_gains;
        let others = against.iter();
        cells.extend(others.map(|other| gained(gains.get(&other.id), DECIMALS)));
        Row::measured(cells)
    });
    (!against.is_empty())
        .then(|| Table {
            name: "gains",
            title: "Gains".to_owned(),
            caption: String::new(),
            columns,
            rows: rows.collect(),
        })
        .map(|table| table.tested(results.interval_level))
}

/// The rows of the methods of these ids, in this order, with what the paper prints of them.
fn rows(table: &Table, results: &Results, ids: &str) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for id in ids.split(',') {
        let method = method(results, id)?;
        let of_method = |row: &&Row| {
            let name = row.cells.first().map(ToString::to_string);
            let name = name.unwrap_or_default();
            let name = name.trim_start_matches(['●', ' ']);
            let rest = name.strip_prefix(method.label.as_str());
            rest.is_some_and(|rest| rest.is_empty() || (row.reference && rest.starts_with(", ")))
        };
        let before = rows.len();
        rows.extend(table.rows.iter().filter(of_method).cloned());
        ensure!(rows.len() > before, "the table has no row of `{id}`");
    }
    Ok(rows)
}

fn method<'r>(results: &'r Results, id: &str) -> Result<&'r MethodResult> {
    let method = results.method(id);
    method.with_context(|| format!("the run has no method `{id}`"))
}

/// The first column and those with these titles, or titles that begin so.
fn columns(table: &Table, titles: &str) -> Result<Table> {
    let slugs: Vec<String> = table.columns.iter().map(|title| slug(title)).collect();
    let mut kept = vec![0];
    for title in titles.split(',') {
        let places = |fits: &dyn Fn(&str) -> bool| -> Vec<usize> {
            (1..slugs.len()).filter(|&at| fits(&slugs[at])).collect()
        };
        let mut found = places(&|slug| slug == title);
        if found.is_empty() {
            found = places(&|slug| slug.starts_with(&format!("{title}-")));
        }
        let known = || slugs[1..].join("`, `");
        ensure!(
            !found.is_empty(),
            "no column `{title}`; there are `{}`",
            known()
        );
        kept.extend(found);
    }
    let row = |row: &Row| Row {
        cells: at(&kept, &row.cells),
        ..row.clone()
    };
    Ok(Table {
        columns: at(&kept, &table.columns),
        rows: table.rows.iter().map(row).collect(),
        ..table.clone()
    })
}

/// What stands at these places.
fn at<T: Clone>(places: &[usize], of: &[T]) -> Vec<T> {
    let found = places.iter().filter_map(|&at| of.get(at));
    found.cloned().collect()
}

/// A title in small letters, its words with hyphens between.
fn slug(title: &str) -> String {
    let title = title.replace('²', "2").to_lowercase();
    let words = title.split(|c: char| !c.is_alphanumeric());
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    words.join("-")
}

/// `RUN METHOD KEY [decimals=N] [times=X]`: a value of a method of `results.json`, or with `-` in
/// place of the method of the run; KEY has a slash before every further key.
fn inline(runs: &Runs, text: &str) -> Result<String> {
    let request = Request::of(text, 3, &["decimals", "times"])?;
    let (run, id, key) = (request.words[0], request.words[1], request.words[2]);
    let results = runs.get(run)?;
    let within = if id == "-" {
        serde_json::to_value(results)?
    } else {
        serde_json::to_value(method(results, id)?)?
    };
    let decimals = request.option("decimals").map(str::parse::<usize>);
    let decimals = decimals.transpose().context("`decimals` is not a number")?;
    let times = request.option("times").map(str::parse::<f64>);
    let times = times.transpose().context("`times` is not a number")?;
    let value = within.pointer(&format!("/{key}"));
    let shown = value.and_then(|value| show(value, times, decimals));
    shown.with_context(|| format!("`{key}` of `{id}` is no value"))
}

/// A number, a text, an interval or a gain; `None` for anything else.
fn show(value: &Value, times: Option<f64>, decimals: Option<usize>) -> Option<String> {
    let plain = times.is_none() && decimals.is_none();
    let (times, places) = (times.unwrap_or(1.0), decimals.unwrap_or(DECIMALS));
    let ends = |value: &Value| {
        let [low, high] = value.as_array()?.as_slice() else {
            return None;
        };
        Some([low.as_f64()?, high.as_f64()?])
    };
    match value {
        Value::Number(count) if plain && !count.is_f64() => Some(count.to_string()),
        Value::Number(found) => Some(number(Some(times * found.as_f64()?), places)),
        Value::String(text) => Some(text.clone()),
        Value::Array(_) => {
            let [low, high] = ends(value)?.map(|end| number(Some(times * end), places));
            Some(format!("[{low}, {high}]"))
        }
        Value::Object(gain) => {
            let value = times * gain.get("value")?.as_f64()?;
            // As in tables: one over units alone is not shown.
            let interval = gain.get("p")?.as_f64().and(gain.get("interval"));
            let interval = interval
                .and_then(ends)
                .map(|ends| ends.map(|end| times * end));
            Some(Cell::difference(Some(value), interval, places).to_string())
        }
        Value::Null | Value::Bool(_) => None,
    }
}
