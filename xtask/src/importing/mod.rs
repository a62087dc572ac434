//! Photographs and a table of their values, laid out as a dataset.

mod table;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Error, Result, bail, ensure};
use sps_base::files::{write_folder, write_new};
use sps_dataset::{
    DatasetFolder, Manifest, Property, PropertyOrder, ReadSettings, TableFormat, ViewAngles,
};

use self::table::{Key, Row, Table};

/// Endings of photographs.
const ENDINGS: [&str; 4] = ["png", "jpg", "jpeg", "exr"];

/// Photographs with their values: each a surface of its own.
pub(crate) struct Import {
    from: String,
    key: Key,
    properties: Vec<Property>,
    surfaces: Vec<Imported>,
}

/// A surface of one photograph.
struct Imported {
    id: String,
    photograph: PathBuf,
    row: Row,
}

impl Import {
    /// Finds the photographs in `folder` that the table at `values` has rows for.
    pub(crate) fn find(folder: &Path, values: &Path) -> Result<Self> {
        let table = Table::read(values)?;
        let mut surfaces = Vec::new();
        for row in &table.rows {
            let of_row = match table.key {
                Key::Class => photographs(folder, row),
                Key::Photograph => photograph(folder, row).map(|found| vec![found]),
            };
            let of_row = of_row.with_context(|| format!("{}, line {}", values.display(), row.line));
            surfaces.extend(of_row?);
        }
        if table.key == Key::Class {
            every_folder_has_a_class(folder, &table, values)?;
        }
        let mut ids: BTreeMap<&str, &Path> = BTreeMap::new();
        for surface in &surfaces {
            if let Some(other) = ids.insert(&surface.id, &surface.photograph) {
                bail!(
                    "{} and {} would both be surface `{}`: rename one",
                    other.display(),
                    surface.photograph.display(),
                    surface.id
                );
            }
        }
        Ok(Self {
            from: format!("{} and {}", folder.display(), values.display()),
            key: table.key,
            properties: table.properties,
            surfaces,
        })
    }

    /// How many photographs there are, and of how many groups.
    pub(crate) fn counts(&self) -> [usize; 2] {
        let mut groups: Vec<&str> = self.surfaces.iter().map(Imported::group).collect();
        groups.sort_unstable();
        groups.dedup();
        [self.surfaces.len(), groups.len()]
    }

    /// What the photographs and the table do not say.
    pub(crate) fn assumed(&self) -> Vec<&'static str> {
        let mut assumed = vec!["each photograph is a surface of its own, seen from straight down"];
        match self.key {
            Key::Class => assumed.push(
                "photographs of one folder have one value; they are a group, and the folder's name is \
                 the material",
            ),
            Key::Photograph => {
                if self.surfaces.iter().any(|s| s.row.material.is_none()) {
                    assumed.push("a photograph without a material is of `unknown`");
                }
                if self.surfaces.iter().any(|s| s.row.group.is_none()) {
                    assumed.push("a photograph without a group is a group of its own");
                }
            }
        }
        assumed.push("values are as the table has them; a Toccare's lie from 0 to 100");
        assumed
    }

    /// Writes the dataset; `folder` must not be there yet.
    pub(crate) fn write(&self, folder: &Path) -> Result<()> {
        ensure!(
            !folder.exists(),
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
                for surface in &self.surfaces {
                    surface.copy(folder)?;
                }
                DatasetFolder::open(folder, &ReadSettings::default())?;
                Ok(())
            },
            |error| Error::from(error).context(folder.display().to_string()),
        )
    }

    fn manifest(&self, name: &str) -> Result<String> {
        let manifest = Manifest {
            name: name.to_owned(),
            description: "Photographs and a table, imported".to_owned(),
            source: self.from.clone(),
            origin: None,
            properties: PropertyOrder::try_from(self.properties.clone()).map_err(Error::msg)?,
            view_angles_deg: ViewAngles::list(vec![0.0])?,
            ranges: BTreeMap::new(),
            tactile: TableFormat::default(),
            property: BTreeMap::new(),
        };
        let assumed = self.assumed();
        let assumed = assumed.iter().map(|line| format!("# - {line}.\n"));
        let assumed: String = assumed.collect();
        Ok(format!(
            "# What the import assumed; change what is wrong.\n{assumed}\n{}",
            toml::to_string(&manifest)?
        ))
    }

    fn surfaces_csv(&self) -> Result<String> {
        let header = ["surface", "material", "group"].map(str::to_owned);
        let rows = self.surfaces.iter().map(|surface| {
            let material = surface.row.material.as_deref().unwrap_or("unknown");
            [
                surface.id.clone(),
                material.to_owned(),
                surface.group().to_owned(),
            ]
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
            row.extend(surface.row.values.iter().cloned());
            row
        });
        table::written(std::iter::once(header).chain(rows))
    }
}

impl Imported {
    fn group(&self) -> &str {
        self.row.group.as_deref().unwrap_or(&self.id)
    }

    /// Copies the photograph to where the dataset in `folder` has its first view.
    fn copy(&self, folder: &Path) -> Result<()> {
        let to = folder.join("frames").join(&self.id);
        let ending = ending(&self.photograph).unwrap_or_default();
        let copied = fs::create_dir_all(&to)
            .and_then(|()| fs::copy(&self.photograph, to.join(format!("000.{ending}"))));
        copied.with_context(|| format!("cannot copy {}", self.photograph.display()))?;
        Ok(())
    }
}

/// The photographs in the folder of a class, by name.
fn photographs(folder: &Path, row: &Row) -> Result<Vec<Imported>> {
    let class = folder.join(&row.key);
    let entries = fs::read_dir(&class)
        .with_context(|| format!("class `{}` has no folder {}", row.key, class.display()))?;
    let mut found = Vec::new();
    for entry in entries {
        let entry = entry?;
        // Some systems put files of their own beside photographs.
        let hidden = entry.file_name().to_string_lossy().starts_with('.');
        found.extend(Some(entry.path()).filter(|path| !hidden && ending(path).is_some()));
    }
    found.sort();
    ensure!(
        !found.is_empty(),
        "{} has no photograph, expected files that end in {}",
        class.display(),
        ENDINGS.join(", ")
    );
    let imported = found.into_iter().map(|photograph| {
        let stem = photograph.file_stem().unwrap_or_default().to_string_lossy();
        let row = Row {
            material: Some(row.key.clone()),
            group: Some(row.key.clone()),
            ..row.clone()
        };
        Imported {
            id: format!("{}-{stem}", row.key),
            photograph,
            row,
        }
    });
    Ok(imported.collect())
}

/// The photograph that a row names.
fn photograph(folder: &Path, row: &Row) -> Result<Imported> {
    let photograph = folder.join(&row.key);
    ensure!(
        photograph.is_file(),
        "there is no photograph {}",
        photograph.display()
    );
    ensure!(
        ending(&photograph).is_some(),
        "found {}, expected a file that ends in {}",
        photograph.display(),
        ENDINGS.join(", ")
    );
    let id = Path::new(&row.key).with_extension("");
    let parts = id
        .components()
        .map(|part| part.as_os_str().to_string_lossy());
    Ok(Imported {
        id: parts.collect::<Vec<_>>().join("-"),
        photograph,
        row: row.clone(),
    })
}

/// Refuses folders of photographs that the table does not name: they would be left out without a word.
fn every_folder_has_a_class(folder: &Path, table: &Table, values: &Path) -> Result<()> {
    let entries = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    for entry in entries {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let named = table.rows.iter().any(|row| row.key == name);
        ensure!(
            named || !entry.path().is_dir() || name.starts_with('.'),
            "{} has no row for the folder `{name}` of {}",
            values.display(),
            folder.display()
        );
    }
    Ok(())
}

/// A photograph's ending, in small letters.
fn ending(path: &Path) -> Option<String> {
    let ending = path.extension()?.to_string_lossy().to_lowercase();
    ENDINGS.contains(&&ending[..]).then_some(ending)
}
