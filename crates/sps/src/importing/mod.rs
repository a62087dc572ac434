//! Photographs and a table of their values, laid out as a dataset.

mod photographs;
mod surfaces;
mod table;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Error, Result, ensure};
use sps_base::files::{write_folder, write_new};
use sps_dataset::{
    DatasetFolder, Manifest, Property, PropertyOrder, ReadSettings, TableFormat, ViewAngles,
};

use self::photographs::Folder;
use self::surfaces::{Finder, Imported};
use self::table::{Column, Key, Table};

/// The roll angle that the last of several photographs is taken to have.
const LAST_VIEW_DEG: f64 = 45.0;

/// Where photographs and their values are, and what is known of them.
pub(crate) struct Request<'a> {
    /// The folder of the photographs.
    pub(crate) photographs: &'a Path,
    /// The table of values.
    pub(crate) values: &'a Path,
    /// The names of the table's columns, where its first line does not have them.
    pub(crate) columns: Option<&'a Path>,
    /// The folders of the views, where each view has one.
    pub(crate) views: &'a [String],
    /// The roll angle of each view in degrees, where they are known.
    pub(crate) angles: &'a [f64],
    /// Materials that the table does not have are taken from names.
    pub(crate) materials_from_names: bool,
}

/// Surfaces with their photographs and values.
pub(crate) struct Import {
    source: String,
    angles: ViewAngles,
    properties: Vec<Property>,
    surfaces: Vec<Imported>,
    without_row: Vec<PathBuf>,
    assumed: Vec<String>,
}

impl Import {
    /// Finds the photographs that the table has rows for; nothing is written.
    pub(crate) fn find(request: &Request) -> Result<Self> {
        let table = Table::read(request.values, request.columns)?;
        let in_folders = table.key == Key::Surface || table.columns.contains(&Column::View);
        ensure!(
            !in_folders || request.views.is_empty(),
            "{} says which photograph is of which view, expected no folders of views beside it",
            request.values.display()
        );
        let folder = Folder::open(request.photographs, request.views)?;
        let finder = Finder {
            table: &table,
            folder: &folder,
            materials_from_names: request.materials_from_names,
        };
        let surfaces = finder.find()?;
        let photographs = surfaces.iter().flat_map(|surface| &surface.photographs);
        let used: BTreeSet<&Path> = photographs.map(|photograph| &*photograph.path).collect();
        let views = surfaces
            .first()
            .map_or(0, |surface| surface.photographs.len());
        Ok(Self {
            source: format!(
                "{} and {}",
                request.photographs.display(),
                request.values.display()
            ),
            angles: angles(request.angles, views)?,
            without_row: folder.others(&used)?,
            assumed: assumed(request, &table, &surfaces)?,
            properties: table.properties,
            surfaces,
        })
    }

    /// How many surfaces there are, photographs of each, and groups.
    pub(crate) fn counts(&self) -> [usize; 3] {
        let groups: BTreeSet<&str> = self.surfaces.iter().map(Imported::group).collect();
        [
            self.surfaces.len(),
            self.angles.as_slice().len(),
            groups.len(),
        ]
    }

    /// The columns with values.
    pub(crate) fn properties(&self) -> &[Property] {
        &self.properties
    }

    /// Photographs of the folder that no row is of, by name.
    pub(crate) fn without_row(&self) -> &[PathBuf] {
        &self.without_row
    }

    /// What the photographs and the table do not say.
    pub(crate) fn assumed(&self) -> &[String] {
        &self.assumed
    }

    /// Writes the dataset; `folder` must not be there yet.
    pub(crate) fn write(&self, folder: &Path) -> Result<()> {
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
                self.surfaces
                    .iter()
                    .try_for_each(|surface| surface.copy(folder))
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
        let assumed: String = assumed.collect();
        Ok(format!(
            "# What the import assumed; change what is wrong.\n{assumed}\n{}",
            toml::to_string(&manifest)?
        ))
    }

    fn surfaces_csv(&self) -> Result<String> {
        let header = ["surface", "material", "group"].map(str::to_owned);
        let rows = self.surfaces.iter().map(|surface| {
            let material = surface.material.as_deref().unwrap_or("unknown");
            [&surface.id, material, surface.group()]
                .map(str::to_owned)
                .to_vec()
        });
        table::written(std::iter::once(header.to_vec()).chain(rows))
    }

    fn tactile_csv(&self) -> Result<String> {
        let mut header = ["surface", "location", "repeat"]
            .map(str::to_owned)
            .to_vec();
        header.extend(self.properties.iter().map(ToString::to_string));
        let rows = self.surfaces.iter().map(|surface| {
            let mut row = vec![surface.id.clone(), "0".to_owned(), "0".to_owned()];
            row.extend(surface.values.iter().cloned());
            row
        });
        table::written(std::iter::once(header).chain(rows))
    }
}

impl Imported {
    fn group(&self) -> &str {
        self.group.as_deref().unwrap_or(&self.id)
    }

    /// Copies the photographs to where the dataset in `folder` has its views.
    fn copy(&self, folder: &Path) -> Result<()> {
        let to = folder.join("frames").join(&self.id);
        fs::create_dir_all(&to).with_context(|| to.display().to_string())?;
        for (view, photograph) in self.photographs.iter().enumerate() {
            let to = to.join(format!("{view:03}.{}", photograph.ending));
            fs::copy(&photograph.path, to)
                .with_context(|| format!("cannot copy {}", photograph.path.display()))?;
        }
        Ok(())
    }
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
fn assumed(request: &Request, table: &Table, surfaces: &[Imported]) -> Result<Vec<String>> {
    let views = surfaces
        .first()
        .map_or(0, |surface| surface.photographs.len());
    let mut assumed = Vec::new();
    let mut assume = |line: &str| assumed.push(line.to_owned());
    match (views, request.angles) {
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
    if request.materials_from_names {
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
