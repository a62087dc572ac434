//! What stands between markers: tables, paragraphs and single numbers of a run.

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;
use sps_experiment::results::{MethodResult, Results};
use sps_experiment::text::number;
use sps_report::table::{Cell, Row, Table};
use sps_report::{about_the_data, gained, tables};

use super::kept::Runs;

/// Decimals where a marker does not say how many.
const DECIMALS: usize = 3;

/// The name of the marker of a table or a paragraph.
pub(super) const BLOCK: &str = "measured";
/// That of a number within a sentence.
pub(super) const INLINE: &str = "value";

/// What a marker of a name asks for, as it stands between the two.
pub(super) fn render(runs: &Runs, name: &str, words: &str) -> Result<String> {
    match name {
        BLOCK => Ok(format!("\n{}\n", block(runs, words)?)),
        _ => inline(runs, words),
    }
}

/// The words of a marker: some in order, and options, each of which is one of `known`.
fn words<'w, const N: usize>(
    text: &'w str,
    known: [&str; 2],
) -> Result<([&'w str; N], [Option<&'w str>; 2])> {
    let (mut words, mut options) = (Vec::new(), [None; 2]);
    for word in text.split_whitespace() {
        let Some((key, value)) = word.split_once('=') else {
            words.push(word);
            continue;
        };
        let at = known.iter().position(|known| *known == key);
        let unknown = || format!("unknown option `{key}`, expected `{}`", known.join("`, `"));
        options[at.with_context(unknown)?] = Some(value);
    }
    match words.try_into() {
        Ok(words) => Ok((words, options)),
        Err(words) => bail!("`{text}` has {} words, expected {N}", Vec::len(&words)),
    }
}

/// `RUN TABLE [rows=ID,ID] [columns=TITLE,TITLE]`, or `RUN about`.
fn block(runs: &Runs, text: &str) -> Result<String> {
    let ([run, name], [ids, titles]) = words(text, ["rows", "columns"])?;
    let results = runs.get(run)?;
    if name == "about" {
        return Ok(about_the_data(results));
    }
    let mut table = find(results, name)?;
    if let Some(ids) = ids {
        table.rows = rows(&table, results, ids)?;
    }
    if let Some(titles) = titles {
        cut(&mut table, titles)?;
    }
    Ok(table.markdown())
}

/// The one table in whose title the word, or words with hyphens between, stands.
fn find(results: &Results, words: &str) -> Result<Table> {
    let mut tables = tables(results);
    tables.extend(gains(results));
    let titles: Vec<String> = tables.iter().map(|table| slug(&table.title)).collect();
    let holds = |title: &str| format!("-{title}-").contains(&format!("-{words}-"));
    tables.retain(|table| holds(&slug(&table.title)));
    let mut found = tables.into_iter();
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
        let gains = &method.gains.r2_mean_gains;
        let others = against.iter();
        let others = others.map(|other| gained(gains.get(&other.id), DECIMALS));
        let cells = [method.label.as_str().into(), r2].into_iter();
        Row::measured(cells.chain(others).collect())
    });
    let table = Table::new("gains", "Gains", columns, rows);
    (!against.is_empty()).then(|| table.tested(results.interval_level))
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

/// Keeps the first column and those with these titles, or else titles that begin so.
fn cut(table: &mut Table, titles: &str) -> Result<()> {
    let slugs: Vec<String> = table.columns.iter().map(|title| slug(title)).collect();
    let mut kept = vec![0];
    for title in titles.split(',') {
        let begins = format!("{title}-");
        let is_whole = slugs[1..].iter().any(|slug| slug == title);
        let fits =
            |at: &usize| slugs[*at] == title || (!is_whole && slugs[*at].starts_with(&begins));
        let before = kept.len();
        kept.extend((1..slugs.len()).filter(fits));
        ensure!(
            kept.len() > before,
            "no column `{title}`; there are `{}`",
            slugs[1..].join("`, `")
        );
    }
    table.columns = at(&kept, &table.columns);
    for row in &mut table.rows {
        row.cells = at(&kept, &row.cells);
    }
    Ok(())
}

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
    let ([run, id, key], [decimals, times]) = words(text, ["decimals", "times"])?;
    let results = runs.get(run)?;
    let within = match id {
        "-" => serde_json::to_value(results)?,
        _ => serde_json::to_value(method(results, id)?)?,
    };
    let decimals = decimals.map(str::parse).transpose();
    let decimals = decimals.context("`decimals` is not a number")?;
    let times = times.map(str::parse).transpose();
    let times = times.context("`times` is not a number")?;
    let value = within.pointer(&format!("/{key}"));
    let shown = value.and_then(|value| show(value, times, decimals));
    shown.with_context(|| format!("`{key}` of `{id}` is no value"))
}

/// A number, a text, an interval or a gain; `None` for anything else.
fn show(value: &Value, times: Option<f64>, decimals: Option<usize>) -> Option<String> {
    let plain = times.is_none() && decimals.is_none();
    let (times, places) = (times.unwrap_or(1.0), decimals.unwrap_or(DECIMALS));
    let ends = |value: &Value| match value.as_array()?.as_slice() {
        [low, high] => Some([times * low.as_f64()?, times * high.as_f64()?]),
        _ => None,
    };
    match value {
        Value::Number(count) if plain && !count.is_f64() => Some(count.to_string()),
        Value::Number(found) => Some(number(Some(times * found.as_f64()?), places)),
        Value::String(text) => Some(text.clone()),
        Value::Array(_) => {
            let [low, high] = ends(value)?.map(|end| number(Some(end), places));
            Some(format!("[{low}, {high}]"))
        }
        Value::Object(gain) => {
            let value = times * gain.get("value")?.as_f64()?;
            // As in tables: one over units alone is not shown.
            let interval = gain.get("p")?.as_f64().and(gain.get("interval"));
            let interval = interval.and_then(ends);
            Some(Cell::difference(Some(value), interval, places).to_string())
        }
        Value::Null | Value::Bool(_) => None,
    }
}
