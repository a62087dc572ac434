//! `report.md` and `report.html`: what they say in which order, and the templates that say it.

use anyhow::Result;
use minijinja::Environment;
use minijinja::value::Serde;
use serde::Serialize;

use super::figures::Figure;
use super::surfaces::Gallery;
use super::table::{Html, Table};

/// Their files, in the folder of a run.
pub(super) const PAGES: [&str; 2] = ["report.md", "report.html"];

const MARKDOWN: &str = include_str!("report.md.j2");
const HTML: &str = include_str!("report.html.j2");

#[derive(Serialize)]
pub(super) struct Page<'a> {
    pub title: &'a str,
    pub description: &'a str,
    /// What was found, in sentences.
    pub findings: Vec<String>,
    pub data: String,
    pub sections: Vec<Section>,
    pub notes: Vec<String>,
    style: &'static str,
    script: &'static str,
}

/// A part with a title of its own.
#[derive(Serialize)]
pub(super) struct Section {
    /// Unlike those of all other sections.
    id: String,
    title: String,
    caption: String,
    #[serde(flatten)]
    shown: Shown,
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
enum Shown {
    Table { html: Html, markdown: String },
    Figure { name: &'static str, svg: String },
    Surfaces { gallery: Gallery, markdown: String },
}

impl<'a> Page<'a> {
    pub(super) fn new(title: &'a str, description: &'a str) -> Self {
        Self {
            title,
            description,
            findings: Vec::new(),
            data: String::new(),
            sections: Vec::new(),
            notes: Vec::new(),
            style: include_str!("style.css"),
            script: include_str!("script.js"),
        }
    }

    /// The text of each of [`PAGES`].
    pub(super) fn texts(&self) -> Result<[String; 2]> {
        let mut environment = Environment::new();
        environment.add_template(PAGES[0], MARKDOWN)?;
        // What is filled into a name that ends in `.html` is escaped.
        environment.add_template(PAGES[1], HTML)?;
        let text = |name| environment.get_template(name)?.render(Serde(self));
        Ok([text(PAGES[0])?, text(PAGES[1])?])
    }
}

impl From<Table> for Section {
    fn from(table: Table) -> Self {
        Self {
            id: format!("table-{}", table.name),
            shown: Shown::Table {
                html: table.html(),
                markdown: table.markdown(),
            },
            title: table.title,
            caption: table.caption,
        }
    }
}

impl From<Gallery> for Section {
    fn from(gallery: Gallery) -> Self {
        Self {
            id: "surfaces".to_owned(),
            title: "The surfaces themselves".to_owned(),
            caption: gallery.caption.clone(),
            shown: Shown::Surfaces {
                markdown: gallery.table.markdown(),
                gallery,
            },
        }
    }
}

impl From<Figure> for Section {
    fn from(figure: Figure) -> Self {
        Self {
            id: format!("figure-{}", figure.name),
            title: figure.title,
            caption: figure.caption,
            shown: Shown::Figure {
                name: figure.name,
                svg: figure.svg,
            },
        }
    }
}
