//! The tables that every method is fitted on.

use anyhow::{Context, Result, ensure};
use candle_core::{Device, Tensor};
use sps_dataset::{FEWEST_PER_MATERIAL, MaterialLabels, Property, Source, Surface};
use sps_models::heads::TrainingData;
use sps_models::{Embeddings, Readings};

use crate::data::{self, About};
use crate::embeddings;

/// One row per surface in each.
pub(crate) struct Tables {
    pub surfaces: Vec<Surface>,
    /// Those to estimate.
    pub properties: Vec<Property>,
    /// The views that methods look at, as indices of the source, ascending.
    pub views: Vec<usize>,
    /// The view straight down, as an index of the source.
    pub nadir: usize,
    /// Views that the source has.
    pub all_views: usize,
    /// What the one view is made of where it is a sequence, as indices of the dataset.
    pub sequence: Option<Vec<usize>>,
    /// (surfaces, views, width), of those views.
    pub embeddings: Embeddings,
    /// All properties that were measured: labels are formed from the whole tactile vector.
    pub readings: Readings,
    /// Material labels by the paper's rule: rare materials are `other`.
    materials: Vec<String>,
    fingerprint: blake3::Hash,
}

impl Tables {
    /// Tables to estimate the properties `wanted`, or all that the source measures.
    pub(crate) fn new<S: Source>(
        source: &S,
        about: &About,
        embeddings: &embeddings::Embeddings,
        wanted: &[Property],
    ) -> Result<Self> {
        let surfaces = source.surfaces().to_vec();
        let measured = &source.tactile().properties;
        let properties = if wanted.is_empty() {
            measured.clone()
        } else {
            wanted.to_vec()
        };
        for property in &properties {
            ensure!(
                measured.contains(property),
                "properties: {} does not measure {property}",
                source.name()
            );
        }
        let labels = MaterialLabels::of(&surfaces, FEWEST_PER_MATERIAL);
        let materials = labels.labels().iter().map(|&l| labels.names()[l].clone());
        let mut tables = Self {
            views: embeddings.views.clone(),
            nadir: data::nadir(source)?,
            all_views: source.view_angles().len(),
            sequence: None,
            embeddings: tensor(embeddings, surfaces.len())?,
            readings: readings(source, about)?,
            materials: materials.collect(),
            fingerprint: blake3::hash(&[]),
            surfaces,
            properties,
        };
        tables.fingerprint = tables.hash(embeddings);
        Ok(tables)
    }

    /// For training.
    pub(crate) fn training_data(&self) -> TrainingData<'_> {
        TrainingData {
            embeddings: &self.embeddings,
            readings: &self.readings,
            materials: Some(&self.materials),
            label_features: None,
        }
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

    /// Codes of the properties to estimate.
    pub(crate) fn codes(&self) -> Vec<String> {
        codes(&self.properties)
    }

    /// A hash of everything in the tables.
    pub(crate) fn fingerprint(&self) -> blake3::Hash {
        self.fingerprint
    }

    fn hash(&self, embeddings: &embeddings::Embeddings) -> blake3::Hash {
        let mut hasher = blake3::Hasher::new();
        for value in &embeddings.values {
            hasher.update(&value.to_le_bytes());
        }
        let columns = self.readings.properties().len();
        for surface in 0..self.surfaces.len() {
            for column in 0..columns {
                let cell = self.readings.get(surface, column);
                hasher.update(&cell.map_or([0xff; 8], f64::to_le_bytes));
            }
        }
        for (surface, material) in self.surfaces.iter().zip(&self.materials) {
            for text in [&surface.id, &surface.group, material] {
                hasher.update(&(text.len() as u64).to_le_bytes());
                hasher.update(text.as_bytes());
            }
        }
        hasher.finalize()
    }
}

/// The readings of every surface, averaged as the data's settings say.
pub(crate) fn readings<S: Source>(source: &S, about: &About) -> Result<Readings> {
    let surfaces = source.surfaces().len();
    let averages = source.tactile().averages(&about.tactile, surfaces);
    let row = |surface| {
        let value = |&property: &Property| averages.value(surface, property);
        averages.properties().iter().map(value).collect()
    };
    let rows: Vec<Vec<Option<f64>>> = (0..surfaces).map(row).collect();
    Ok(Readings::new(codes(averages.properties()), &rows)?)
}

fn codes(properties: &[Property]) -> Vec<String> {
    properties.iter().map(Property::to_string).collect()
}

fn tensor(embeddings: &embeddings::Embeddings, surfaces: usize) -> Result<Embeddings> {
    let shape = (surfaces, embeddings.views.len(), embeddings.width);
    let tensor = Tensor::from_slice(&embeddings.values, shape, &Device::Cpu)?;
    Ok(Embeddings::new(&tensor)?)
}
