//! Which surfaces the rows of a table make.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use sps_dataset::check_surface_id;

use super::photographs::{Folder, Photograph, in_order};
use super::table::{Column, Key, Row, Table};

/// A surface with a photograph of each view.
pub(super) struct Imported {
    pub(super) id: String,
    pub(super) material: Option<String>,
    pub(super) group: Option<String>,
    pub(super) photographs: Vec<Photograph>,
    pub(super) values: Vec<String>,
    pub(super) line: u64,
}

impl Imported {
    /// Its first photograph, for messages.
    fn shown(&self) -> String {
        let first = self.photographs.first();
        first.map_or_else(String::new, |first| first.path.display().to_string())
    }
}

/// What surfaces are made of.
pub(super) struct Finder<'a> {
    pub(super) table: &'a Table,
    pub(super) folder: &'a Folder,
    /// Materials that the table does not have are taken from names.
    pub(super) materials_from_names: bool,
}

impl Finder<'_> {
    /// The surfaces of the table, each with equally many photographs.
    pub(super) fn find(&self) -> Result<Vec<Imported>> {
        let rows = &self.table.rows;
        let several = self.table.columns.contains(&Column::Surface);
        let surfaces = match self.table.key {
            Key::Class => {
                let of_rows = self.each(|row| self.of_class(row))?;
                of_rows.into_iter().flatten().collect()
            }
            Key::Surface => self.each(|row| self.of_folder(row))?,
            Key::Photograph if several => self.of_several_rows()?,
            Key::Photograph => {
                self.each(|row| self.of_photograph(cell(row, Column::Photograph), row))?
            }
            Key::Order => {
                let names = in_order(self.folder.names("")?)?;
                let (found, photographs) = (rows.len(), names.len());
                ensure!(
                    found == photographs,
                    "found {found} rows for {photographs} photographs, expected one for each, in the order of \
                     their names"
                );
                let mut names = names.iter();
                self.each(|row| self.of_photograph(names.next().map_or("", |name| name), row))?
            }
        };
        self.check(&surfaces)?;
        Ok(surfaces)
    }

    /// What each row makes; errors name its line.
    fn each<T>(&self, mut of_row: impl FnMut(&Row) -> Result<T>) -> Result<Vec<T>> {
        let of = |row: &Row| of_row(row).with_context(|| self.table.at(row.line));
        self.table.rows.iter().map(of).collect()
    }

    /// A surface for each photograph in the folder of a class.
    fn of_class(&self, row: &Row) -> Result<Vec<Imported>> {
        let class = cell(row, Column::Class);
        let surfaces = self.folder.names(class)?.into_iter().map(|name| {
            let stem = Path::new(&name).file_stem().unwrap_or_default();
            let id = format!("{class}-{}", stem.to_string_lossy());
            let photographs = self.folder.photographs(&format!("{class}/{name}"))?;
            let mut surface = self.surface(&id, class, photographs, row)?;
            surface.material.get_or_insert_with(|| class.to_owned());
            surface.group.get_or_insert_with(|| class.to_owned());
            Ok(surface)
        });
        surfaces.collect()
    }

    /// The surface whose views are the photographs in the folder of its name.
    fn of_folder(&self, row: &Row) -> Result<Imported> {
        let id = cell(row, Column::Surface);
        let names = in_order(self.folder.names(id)?)?.into_iter();
        let views = names.map(|name| self.folder.photographs(&format!("{id}/{name}")));
        let photographs = views.collect::<Result<Vec<_>>>()?.into_iter().flatten();
        self.surface(id, id, photographs.collect(), row)
    }

    /// The surface that has the name of a photograph.
    fn of_photograph(&self, path: &str, row: &Row) -> Result<Imported> {
        let photographs = self.folder.photographs(path)?;
        let mut parts = self.folder.parts(path)?;
        let name = parts.pop().unwrap_or_default();
        let mut last = name.clone();
        if self.materials_from_names {
            let (number, material) = numbered(&name)?;
            if !number.is_empty() {
                last = format!("{number}-{material}");
            }
        }
        parts.push(last);
        self.surface(&parts.join("-"), &name, photographs, row)
    }

    /// Surfaces with a row for each view.
    fn of_several_rows(&self) -> Result<Vec<Imported>> {
        let views = self.table.views()?;
        let mut rows: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
        for row in &self.table.rows {
            let surface = cell(row, Column::Surface);
            rows.entry(surface).or_default().push(row);
        }
        let mut rows: Vec<_> = rows.into_iter().collect();
        rows.sort_by_key(|(_, rows)| rows[0].line);
        let surfaces = rows.iter().map(|(id, rows)| self.of_rows(id, rows, &views));
        surfaces.collect()
    }

    /// The surface of these rows, one for each of `views`.
    fn of_rows(&self, id: &str, rows: &[&Row], views: &[String]) -> Result<Imported> {
        let merged = self.table.merged(rows)?;
        let shown = id.escape_debug();
        let mut photographs = Vec::new();
        for view in views {
            let of_view = rows.iter().filter(|row| cell(row, Column::View) == view);
            let row = match of_view.collect::<Vec<_>>()[..] {
                [row] => row,
                [] => bail!(
                    "{}: surface `{shown}` has no photograph of view `{}`",
                    self.table.at(merged.line),
                    view.escape_debug()
                ),
                [first, second, ..] => bail!(
                    "{}: surface `{shown}` has a photograph of this view in line {} already; a column \
                     `view` tells several apart",
                    self.table.at(second.line),
                    first.line
                ),
            };
            let found = self.folder.photographs(cell(row, Column::Photograph));
            photographs.extend(found.with_context(|| self.table.at(row.line))?);
        }
        self.surface(id, id, photographs, &merged)
            .with_context(|| self.table.at(merged.line))
    }

    /// A surface of a row; `name` may say its material.
    fn surface(
        &self,
        id: &str,
        name: &str,
        photographs: Vec<Photograph>,
        row: &Row,
    ) -> Result<Imported> {
        let mut material = row.cell(Column::Material).map(str::to_owned);
        if self.materials_from_names && material.is_none() {
            material = Some(numbered(name)?.1);
        }
        Ok(Imported {
            // Blanks at the ends of a cell do not count.
            id: id.trim().to_owned(),
            material,
            group: row.cell(Column::Group).map(str::to_owned),
            photographs,
            values: row.values.clone(),
            line: row.line,
        })
    }

    /// No surface and no photograph is there twice, ids are those that a dataset can have, and all
    /// surfaces have equally many photographs.
    fn check(&self, surfaces: &[Imported]) -> Result<()> {
        let (mut ids, mut photographs) = (BTreeMap::new(), BTreeMap::new());
        for surface in surfaces {
            let at = || self.table.at(surface.line);
            check_surface_id(&surface.id).with_context(at)?;
            if let Some(other) = ids.insert(&surface.id, surface) {
                let [first, second] = [other, surface].map(Imported::shown);
                let id = &surface.id;
                bail!("{first} and {second} would both be surface `{id}`: rename one");
            }
            for photograph in &surface.photographs {
                let path = &photograph.path;
                if let Some(first) = photographs.insert(path, &surface.id) {
                    let (at, path) = (at(), path.display());
                    bail!("{at}: {path} is a photograph of surface `{first}` already");
                }
            }
            let expected = surfaces.first().unwrap_or(surface);
            let [found, of_first] = [surface, expected].map(|surface| surface.photographs.len());
            let (id, first) = (&surface.id, &expected.id);
            ensure!(
                found == of_first,
                "{}: the number of photographs of surface `{id}` is {found} and that of `{first}` is {of_first}, \
                 expected as many of every surface",
                at()
            );
        }
        Ok(())
    }
}

/// The cell of a column that the table has and that is never empty.
fn cell(row: &Row, column: Column) -> &str {
    row.cell(column).unwrap_or_default()
}

/// The number that a name begins with, and its words without the numbers at both ends: `001` and
/// `baked-clay` of `001_baked_clay01`.
fn numbered(name: &str) -> Result<(&str, String)> {
    let words = name.trim_start_matches(|letter: char| letter.is_ascii_digit());
    let number = &name[..name.len() - words.len()];
    let words = words.trim_end_matches(|letter: char| letter.is_ascii_digit());
    let words = words.split(|letter: char| letter.is_whitespace() || "_-".contains(letter));
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    let shown = name.escape_debug();
    ensure!(
        !words.is_empty(),
        "`{shown}` names no material, expected one such as `001_baked_clay01`"
    );
    Ok((number, words.join("-")))
}
