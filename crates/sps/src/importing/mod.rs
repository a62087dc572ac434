//! Photographs and a table of their values, laid out as a dataset.

mod photographs;
mod surfaces;
mod table;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Error, Result, ensure};
use serde::Serialize;
use sps_base::files::{write_folder, write_new};
use sps_dataset::{
    DatasetFolder, Manifest, Property, PropertyOrder, ReadSettings, TableFormat, ViewAngles,
};
use sps_estimator::Precomputed;

use self::photographs::{Folder, Photograph, refuse_empty};
use self::surfaces::{Finder, Imported};
use self::table::{Column, Key, Table};

/// The roll angle that the last of several photographs is taken to have.
const LAST_VIEW_DEG: f64 = 45.0;

/// Where photographs and their values are, and what is known of them.
pub struct Request<'a> {
    /// The folder of the photographs.
    pub photographs: &'a Path,
    /// The table of values.
    pub values: &'a Path,
    /// What is known beside them.
    pub options: &'a Options,
}

/// What is known of photographs and table.
#[derive(Default, clap::Args)]
#[group(id = "layout", requires = "values")]
pub struct Options {
    /// The names of the table's columns, one a line, where its first line does not have them
    #[arg(long, value_name = "FILE")]
    columns: Option<PathBuf>,
    /// Folders in that of the photographs, one for each view, with the same names in each
    #[arg(long, value_name = "FOLDER,...", value_delimiter = ',')]
    views: Vec<String>,
    /// The roll angle of each view in degrees, 0 straight down; by default evenly spaced from 0 to 45
    #[arg(
        long,
        value_name = "DEGREES,...",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    angles: Vec<f64>,
    /// Take materials from names: 001_baked_clay01.jpg is surface 001-baked-clay, of baked-clay
    #[arg(long)]
    materials_from_names: bool,
}

/// How a dataset has its photographs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Frames {
    /// As files of its own.
    Copied,
    /// As the same files, for a dataset that is gone before they change; copied where that cannot be.
    Linked,
}

/// Surfaces with their photographs and values.
pub struct Import {
    source: String,
    angles: ViewAngles,
    properties: Vec<Property>,
    surfaces: Vec<Imported>,
    without_row: Vec<PathBuf>,
    assumed: Vec<String>,
}

/// What was found, what is assumed beside it, and what is left out.
#[derive(Serialize)]
pub(crate) struct Found<'a> {
    surfaces: usize,
    groups: usize,
    /// Photographs of each surface.
    views: usize,
    properties: &'a [Property],
    assumed: &'a [String],
    /// Photographs below their folder that no row is of.
    left_out: &'a [PathBuf],
}

/// A surface of which everything is known.
pub struct Listed {
    /// The surfaces that must not be parted from it; none but itself where there is no group.
    pub group: Option<String>,
    /// Its material, where that is known.
    pub material: Option<String>,
    /// A photograph of each view.
    pub photographs: Vec<PathBuf>,
    /// Of each property, where it was measured.
    pub values: Vec<Option<f64>>,
}

/// All photographs below a folder, by name; at least one.
pub(crate) fn photographs_below(folder: &Path) -> Result<Vec<PathBuf>> {
    let photographs = Folder::open(folder, &[])?.others(&BTreeSet::new())?;
    refuse_empty(folder, photographs.is_empty())?;
    Ok(photographs.iter().map(|path| folder.join(path)).collect())
}

impl Import {
    /// Finds the photographs that the table has rows for; nothing is written.
    ///
    /// # Errors
    /// A file that cannot be read; a row, with its line, that no photographs belong to.
    pub fn find(request: &Request) -> Result<Self> {
        let options = request.options;
        let table = Table::read(request.values, options.columns.as_deref())?;
        let in_folders = table.key == Key::Surface || table.columns.contains(&Column::View);
        ensure!(
            !in_folders || options.views.is_empty(),
            "{} says which photograph is of which view, expected no folders of views beside it",
            request.values.display()
        );
        let folder = Folder::open(request.photographs, &options.views)?;
        let finder = Finder {
            table: &table,
            folder: &folder,
            materials_from_names: options.materials_from_names,
        };
        let surfaces = finder.find()?;
        let photographs = surfaces.iter().flat_map(|surface| &surface.photographs);
        let used: BTreeSet<&Path> = photographs.map(|photograph| &*photograph.path).collect();
        let views = views_of(&surfaces);
        let [photographs, values] = [request.photographs, request.values].map(Path::display);
        Ok(Self {
            source: format!("{photographs} and {values}"),
            angles: angles(&options.angles, views)?,
            without_row: folder.others(&used)?,
            assumed: assumed(options, &table, &surfaces)?,
            properties: table.properties,
            surfaces,
        })
    }

    /// Surfaces that are listed, each called by its place in the list; `angles` of the views are evenly
    /// spaced where there are none.
    ///
    /// # Errors
    /// Another number of photographs of a surface, or of angles, than of the first; a file that is no
    /// photograph by its name.
    pub fn listed(properties: Vec<Property>, angles: &[f64], listed: Vec<Listed>) -> Result<Self> {
        let views = listed.first().map_or(0, |first| first.photographs.len());
        let surfaces = listed.into_iter().enumerate();
        let surfaces = surfaces.map(|(at, surface)| Imported::listed(at, surface, views));
        Ok(Self {
            source: String::new(),
            angles: self::angles(angles, views)?,
            properties,
            surfaces: surfaces.collect::<Result<_>>()?,
            without_row: Vec::new(),
            assumed: Vec::new(),
        })
    }

    /// How many groups there are.
    pub fn groups(&self) -> usize {
        let groups = self.surfaces.iter().map(Imported::group);
        groups.collect::<BTreeSet<_>>().len()
    }

    /// What was found, for programs.
    pub(crate) fn found(&self) -> Found<'_> {
        Found {
            surfaces: self.surfaces.len(),
            groups: self.groups(),
            views: self.angles.as_slice().len(),
            properties: &self.properties,
            assumed: &self.assumed,
            left_out: &self.without_row,
        }
    }

    /// The same for people.
    pub fn described(&self) -> String {
        let properties: Vec<_> = self.properties.iter().map(ToString::to_string).collect();
        let (surfaces, groups) = (self.surfaces.len(), self.groups());
        let views = self.angles.as_slice().len();
        let mut text = format!(
            "{surfaces} surfaces in {groups} groups, photographs of each: {views}. It was assumed that\n"
        );
        for assumed in &self.assumed {
            let _ = writeln!(text, "- {assumed};");
        }
        let _ = writeln!(text, "Properties: {}.", properties.join(", "));
        if !self.without_row.is_empty() {
            let first = self.without_row.iter().take(3);
            let first: Vec<_> = first.map(|path| path.display().to_string()).collect();
            let (count, first) = (self.without_row.len(), first.join(", "));
            let more = if count > 3 { ", ..." } else { "" };
            let left_out = format!("{count} photographs ({first}{more})");
            let _ = writeln!(text, "Left out, for no row is of them: {left_out}.");
        }
        text
    }

    /// Photographs of the folder that no row is of, below it, by name.
    pub(crate) fn without_row(&self) -> &[PathBuf] {
        &self.without_row
    }

    /// The photographs that rows are of.
    pub(crate) fn photographs(&self) -> impl Iterator<Item = &Path> {
        let surfaces = self.surfaces.iter();
        let photographs = surfaces.flat_map(|surface| &surface.photographs);
        photographs.map(|photograph| photograph.path.as_path())
    }

    /// The rows of the photographs that are imported, in the order of the dataset. Rows that name no `files` are
    /// of all photographs below `folder`, by name; without a folder, of those imported, in their order.
    ///
    /// # Errors
    /// Another number of rows where no files are named; a photograph without a row, or with two.
    pub fn rows_of(&self, mut rows: Precomputed, folder: Option<&Path>) -> Result<Precomputed> {
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let blocks = rows.blocks().to_vec();
        if let (Some(folder), []) = (folder, rows.files()) {
            let all = photographs_below(folder)?;
            let (found, expected, folder) = (rows.rows(), all.len(), folder.display());
            ensure!(
                found == expected,
                "found {found} rows without `files`, expected {expected}, one for each photograph below {folder}"
            );
            let files = all.iter().map(|path| text(path)).collect();
            rows = Precomputed::new(blocks.clone(), files, rows.values().to_vec())?;
        }
        let root = folder.map_or(Ok(PathBuf::new()), |folder| {
            fs::canonicalize(folder).with_context(|| folder.display().to_string())
        })?;
        let below = |path| Path::strip_prefix(path, &root).unwrap_or(path);
        let wanted: Vec<_> = self.photographs().map(|path| text(below(path))).collect();
        let values = rows.rows_of(&wanted)?;
        Ok(Precomputed::new(blocks, Vec::new(), values)?)
    }

    /// Writes the dataset; `folder` must not be there yet.
    ///
    /// # Errors
    /// A folder that is there or cannot be written to; values that no dataset can have.
    pub fn write(&self, folder: &Path, frames: Frames) -> Result<()> {
        ensure!(
            fs::symlink_metadata(folder).is_err(),
            "{} is there already; choose another folder",
            folder.display()
        );
        let name = folder.file_name().unwrap_or(folder.as_os_str());
        let texts = [
            ("dataset.toml", self.manifest(&name.to_string_lossy())?),
            ("surfaces.csv", self.surfaces_csv()?),
            ("tactile.csv", self.tactile_csv()?),
        ];
        write_folder(
            folder,
            |folder| {
                for (name, text) in &texts {
                    write_new(&folder.join(name), text.as_bytes())?;
                }
                // Before frames, which may be many, are copied.
                DatasetFolder::open(folder, &ReadSettings::default())?;
                let mut surfaces = self.surfaces.iter();
                surfaces.try_for_each(|surface| surface.lay_out(folder, frames))
            },
            |error| Error::from(error).context(folder.display().to_string()),
        )
    }

    fn manifest(&self, name: &str) -> Result<String> {
        let manifest = Manifest {
            name: name.to_owned(),
            description: "Photographs and a table, imported".to_owned(),
            source: self.source.clone(),
            origin: None,
            properties: PropertyOrder::try_from(self.properties.clone()).map_err(Error::msg)?,
            view_angles_deg: self.angles.clone(),
            ranges: BTreeMap::new(),
            tactile: TableFormat::default(),
            property: BTreeMap::new(),
        };
        let assumed = self.assumed.iter().map(|line| format!("# - {line}.\n"));
        let (assumed, manifest) = (assumed.collect::<String>(), toml::to_string(&manifest)?);
        let heading = "# What the import assumed; change what is wrong.";
        Ok(format!("{heading}\n{assumed}\n{manifest}"))
    }

    fn surfaces_csv(&self) -> Result<String> {
        let rows = self.surfaces.iter().map(|surface| {
            let material = surface.material.as_deref().unwrap_or("unknown");
            vec![surface.id.as_str(), material, surface.group()]
        });
        table::written(vec!["surface", "material", "group"], rows)
    }

    fn tactile_csv(&self) -> Result<String> {
        let mut header = vec!["surface", "location", "repeat"];
        header.extend(self.properties.iter().map(Property::code));
        let rows = self.surfaces.iter().map(|surface| {
            let mut row = vec![surface.id.as_str(), "0", "0"];
            row.extend(surface.values.iter().map(String::as_str));
            row
        });
        table::written(header, rows)
    }
}

impl Imported {
    fn listed(at: usize, listed: Listed, views: usize) -> Result<Self> {
        let found = listed.photographs.len();
        ensure!(
            found == views && views > 0,
            "photographs: found {found} of surface {at}, expected {} as of the first",
            views.max(1)
        );
        let photographs = listed.photographs.iter().map(|path| Photograph::of(path));
        let written = |value: f64| value.to_string();
        let values = listed.values.into_iter();
        let values = values.map(|value| value.map(written).unwrap_or_default());
        Ok(Self {
            id: at.to_string(),
            material: listed.material,
            group: listed.group,
            photographs: photographs.collect::<Result<_>>()?,
            values: values.collect(),
            line: 0,
        })
    }

    fn group(&self) -> &str {
        self.group.as_deref().unwrap_or(&self.id)
    }

    /// Brings the photographs to where the dataset in `folder` has its views.
    fn lay_out(&self, folder: &Path, frames: Frames) -> Result<()> {
        let to = folder.join("frames").join(&self.id);
        fs::create_dir_all(&to).with_context(|| to.display().to_string())?;
        for (view, photograph) in self.photographs.iter().enumerate() {
            let to = to.join(format!("{view:03}.{}", photograph.ending));
            if frames == Frames::Linked && fs::hard_link(&photograph.path, &to).is_ok() {
                continue;
            }
            fs::copy(&photograph.path, to)
                .with_context(|| format!("cannot copy {}", photograph.path.display()))?;
        }
        Ok(())
    }
}

/// The photographs of each surface.
fn views_of(surfaces: &[Imported]) -> usize {
    surfaces.first().map_or(0, |first| first.photographs.len())
}

/// The angles of so many views.
fn angles(given: &[f64], views: usize) -> Result<ViewAngles> {
    if given.is_empty() {
        return Ok(ViewAngles::evenly_spaced(0.0, LAST_VIEW_DEG, views)?);
    }
    ensure!(
        given.len() == views,
        "found {} angles, expected one for each of {views} photographs of a surface",
        given.len()
    );
    Ok(ViewAngles::list(given.to_vec())?)
}

/// What is taken for granted; nothing of it may hold the text of a table as it is, since it becomes a
/// comment in TOML.
fn assumed(options: &Options, table: &Table, surfaces: &[Imported]) -> Result<Vec<String>> {
    let views = views_of(surfaces);
    let mut assumed = Vec::new();
    let mut assume = |line: &str| assumed.push(line.to_owned());
    match (views, options.angles.as_slice()) {
        (..=1, []) => assume("each photograph is a surface of its own, seen from straight down"),
        (_, []) => assume(
            "angles of views are nominal: the first is seen from straight down, the last from 45 degrees, \
             those between evenly spaced",
        ),
        _ => {}
    }
    match table.key {
        Key::Class => assume(
            "photographs of one folder have one value; they are a group, and the folder's name is the \
             material, unless the table says another",
        ),
        Key::Surface => assume("photographs of one folder are views in the order of their names"),
        Key::Order => assume("rows of the table are in the order of the photographs' names"),
        Key::Photograph if table.columns.contains(&Column::View) => {
            let views = table.views()?.join(", ");
            assume(&format!("views are in the order {}", views.escape_debug()));
        }
        Key::Photograph => {}
    }
    if options.materials_from_names {
        assume("a material is the name without numbers at its ends, unless the table says another");
    }
    if surfaces.iter().any(|surface| surface.material.is_none()) {
        assume("a surface without a material is of `unknown`");
    }
    if surfaces.iter().any(|surface| surface.group.is_none()) {
        assume("a surface without a group is a group of its own");
    }
    assume("values are as the table has them; it says nothing of their units and ranges");
    Ok(assumed)
}
