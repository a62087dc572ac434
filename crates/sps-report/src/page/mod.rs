//! `report.md` and `report.html`: what they say in which order, and the templates that say it.

use anyhow::Result;
use minijinja::Environment;
use minijinja::value::Serde;
use serde_json::{Value, json};

use super::figures::Figure;
use super::surfaces::Gallery;
use super::table::Table;

/// Their files, in the folder of a run.
pub(super) const PAGES: [&str; 2] = ["report.md", "report.html"];

/// The text of each of [`PAGES`], from what the templates name.
pub(super) fn texts(mut page: Value) -> Result<[String; 2]> {
    page["style"] = include_str!("style.css").into();
    page["script"] = include_str!("script.js").into();
    let mut environment = Environment::new();
    environment.add_template(PAGES[0], include_str!("report.md.j2"))?;
    // What is filled into a name that ends in `.html` is escaped.
    environment.add_template(PAGES[1], include_str!("report.html.j2"))?;
    let text = |name| environment.get_template(name)?.render(Serde(&page));
    Ok([text(PAGES[0])?, text(PAGES[1])?])
}

/// The means, what can be seen, then what only some readers look up: each with an id of its own.
pub(super) fn sections(
    tables: &[Table],
    figures: &[Figure],
    gallery: Option<&Gallery>,
) -> Vec<Value> {
    let mut tables = tables.iter().map(of_table);
    let means = tables.next().into_iter();
    let figures = figures.iter().map(of_figure);
    let gallery = gallery.into_iter().map(of_gallery);
    means.chain(figures).chain(gallery).chain(tables).collect()
}

fn of_table(table: &Table) -> Value {
    json!({
        "id": format!("table-{}", table.name),
        "title": table.title,
        "caption": table.caption,
        "table": { "html": table.html(), "markdown": table.markdown() },
    })
}

fn of_figure(figure: &Figure) -> Value {
    json!({
        "id": format!("figure-{}", figure.name),
        "title": figure.title,
        "caption": figure.caption,
        "figure": { "name": figure.name, "svg": figure.svg },
    })
}

fn of_gallery(gallery: &Gallery) -> Value {
    json!({
        "id": "surfaces",
        "title": "The surfaces themselves",
        "caption": gallery.caption,
        "surfaces": { "gallery": gallery, "markdown": gallery.table.markdown() },
    })
}
