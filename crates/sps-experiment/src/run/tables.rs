//! The tables that every method is fitted on.

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail};
use sps_base::names::UnknownName;
use sps_dataset::{FEWEST_PER_MATERIAL, MaterialLabels, Property, Source, Surface, Units};
use sps_estimator::{Calibration, Examples, Recipe, Wanted, Widths};
use sps_regress::{Embeddings, Readings, TrainingData};

use super::encoded::Encoded;
use crate::config::Method;
use crate::data::{self, About};

/// One row per surface in each.
pub(crate) struct Tables {
    /// All, those that may be trained on first.
    pub surfaces: Vec<Surface>,
    /// Those to estimate.
    pub properties: Vec<Property>,
    /// The lowest and the highest value that each of them can have, where that is known.
    ranges: BTreeMap<Property, [f64; 2]>,
    /// The views that methods look at, as indices of the source, ascending.
    pub views: Vec<usize>,
    /// The view straight down, as an index of the source.
    pub nadir: usize,
    /// Views that the source has.
    pub all_views: usize,
    /// What the one view is made of where it is a sequence, as indices of the dataset.
    pub sequence: Option<Vec<usize>>,
    /// (surfaces that may be trained on, views, width), of those views.
    pub embeddings: Embeddings,
    /// Of all surfaces. All properties that were measured: labels are formed from the whole
    /// tactile vector.
    pub readings: Readings,
    /// Of the surfaces that may be trained on.
    training_readings: Readings,
    /// Material labels of these by the paper's rule: rare materials are `other`.
    materials: Vec<String>,
    fingerprint: blake3::Hash,
}

impl Tables {
    /// Tables to estimate `properties` from embeddings of `views` of the first surfaces.
    pub(crate) fn new(
        of: &Encoded<'_, '_>,
        views: &[usize],
        embeddings: Embeddings,
        properties: Vec<Property>,
    ) -> Result<Self> {
        let (source, about) = (of.source, of.about);
        let surfaces = source.surfaces().to_vec();
        let pool = embeddings.surfaces();
        let labels = MaterialLabels::of(&surfaces[..pool], FEWEST_PER_MATERIAL);
        let range = |property: &Property| {
            let range = source.describe(property).range?;
            Some((property.clone(), range.ends()))
        };
        let ranges = properties.iter().filter_map(range);
        let materials = labels.labels().iter().map(|&l| labels.names()[l].clone());
        let mut tables = Self {
            views: views.to_vec(),
            nadir: data::nadir(source)?,
            all_views: source.view_angles().len(),
            sequence: of.sequence.clone(),
            embeddings,
            readings: readings(source, about, surfaces.len())?,
            training_readings: readings(source, about, pool)?,
            materials: materials.collect(),
            fingerprint: blake3::hash(&[]),
            surfaces,
            ranges: ranges.collect(),
            properties,
        };
        tables.fingerprint = tables.hash()?;
        Ok(tables)
    }

    /// Surfaces that may be trained on; those from here on are only scored on.
    pub(crate) fn pool(&self) -> usize {
        self.embeddings.surfaces()
    }

    /// For training on surfaces of which these units stay whole.
    pub(crate) fn training_data<'a>(&'a self, units: &'a Units) -> TrainingData<'a> {
        TrainingData::new(&self.embeddings, &self.training_readings)
            .with_materials(&self.materials)
            .with_units(&units.of_surface()[..self.pool()])
    }

    /// How a model of a method is fitted that estimates properties, each from these views.
    pub(crate) fn recipe<'a>(
        &self,
        method: &Method,
        wanted: impl Iterator<Item = (&'a Property, Vec<usize>)>,
        calibration: Calibration,
    ) -> Result<Recipe> {
        let regression = method.estimator.regression();
        let wanted = wanted.map(|(property, views)| Wanted {
            property: property.to_string(),
            views,
            range: self.range(property),
        });
        Ok(Recipe {
            regression: regression.context("a mean is not fitted")?.clone(),
            wanted: wanted.collect(),
            one_by_one: method.adaptive.is_some(),
            widths: Widths::ByPhotograph,
            calibration,
        })
    }

    /// The lowest and the highest value that a property can have, where that is known.
    pub(crate) fn range(&self, property: &Property) -> Option<[f64; 2]> {
        self.ranges.get(property).copied()
    }

    /// For a model of surfaces of which these units stay whole.
    pub(crate) fn examples<'a>(
        &'a self,
        units: &'a Units,
        encoder_saw: &'a [usize],
    ) -> Examples<'a> {
        Examples {
            data: self.training_data(units),
            units,
            encoder_saw,
        }
    }

    /// What was measured of a property on a surface.
    pub(crate) fn reading(&self, property: &str, surface: usize) -> Option<f64> {
        self.readings.get(surface, self.readings.column(property)?)
    }

    /// Those of `surfaces` whose property was measured, with the reading.
    pub(crate) fn measured(&self, property: &str, surfaces: &[usize]) -> Vec<(usize, f64)> {
        let column = self.readings.column(property);
        let reading = |&surface: &usize| Some((surface, self.readings.get(surface, column?)?));
        surfaces.iter().filter_map(reading).collect()
    }

    /// Where a view of the source stands in the embeddings.
    pub(crate) fn place(&self, view: usize) -> Result<usize> {
        let place = self.views.iter().position(|&other| other == view);
        place.with_context(|| format!("view {view} was not embedded"))
    }

    /// The dataset's views behind places in the embeddings.
    pub(crate) fn shown(&self, places: &[usize]) -> Vec<usize> {
        match &self.sequence {
            Some(sequence) => sequence.clone(),
            None => places.iter().map(|&place| self.views[place]).collect(),
        }
    }

    pub(crate) fn codes(&self) -> Vec<String> {
        codes(&self.properties)
    }

    /// A hash of everything that is known of the surfaces that may be trained on.
    pub(crate) fn fingerprint(&self) -> blake3::Hash {
        self.fingerprint
    }

    fn hash(&self) -> Result<blake3::Hash> {
        let mut hasher = blake3::Hasher::new();
        for surface in 0..self.pool() {
            for view in 0..self.views.len() {
                let row = self.embeddings.get(surface, view);
                for value in row.context("a view that was not embedded")? {
                    hasher.update(&value.to_le_bytes());
                }
            }
        }
        self.hash_readings(0..self.pool(), &mut hasher);
        for (surface, material) in self.surfaces.iter().zip(&self.materials) {
            for text in [&surface.id, &surface.group, material] {
                hash_text(&mut hasher, text);
            }
        }
        Ok(hasher.finalize())
    }

    pub(crate) fn hash_readings(
        &self,
        surfaces: impl Iterator<Item = usize>,
        hasher: &mut blake3::Hasher,
    ) {
        for surface in surfaces {
            hash_row(hasher, &self.readings, surface);
        }
    }
}

/// Those that a config lists, or all that the source measures where it lists none.
pub(crate) fn properties(source: &dyn Source, listed: &[Property]) -> Result<Vec<Property>> {
    let measured = &source.tactile().properties;
    if listed.is_empty() {
        return Ok(measured.clone());
    }
    let missing = listed.iter().find(|property| !measured.contains(property));
    if let Some(missing) = missing {
        let codes = measured.iter().map(Property::code);
        let unknown = UnknownName::new("property", missing, codes);
        bail!("`properties`: {unknown}, of {}", source.name());
    }
    Ok(listed.to_vec())
}

/// So that no two lists of texts have the same bytes.
pub(super) fn hash_text(hasher: &mut blake3::Hasher, text: &str) {
    hasher.update(&(text.len() as u64).to_le_bytes());
    hasher.update(text.as_bytes());
}

pub(super) fn hash_row(hasher: &mut blake3::Hasher, readings: &Readings, surface: usize) {
    for &cell in readings.row(surface).into_iter().flatten() {
        hasher.update(&cell.map_or([0xff; 8], f64::to_le_bytes));
    }
}

/// The readings of the first so many surfaces, averaged as the data's settings say.
pub(crate) fn readings(source: &dyn Source, about: &About, surfaces: usize) -> Result<Readings> {
    let all = source.surfaces().len();
    let averages = source.tactile().averages(&about.tactile, all);
    let row = |surface| {
        let value = |property: &Property| averages.value(surface, property);
        averages.properties().iter().map(value).collect()
    };
    let rows: Vec<Vec<Option<f64>>> = (0..surfaces).map(row).collect();
    Ok(Readings::new(codes(averages.properties()), &rows)?)
}

pub(super) fn codes(properties: &[Property]) -> Vec<String> {
    properties.iter().map(Property::to_string).collect()
}
