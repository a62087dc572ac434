//! Surfaces whose brightness is felt, and what they look like.

#![allow(dead_code, reason = "each test file uses a part")]

use std::path::{Path, PathBuf};

use sps_base::streams::{RngCore, hashed_stream};
use sps_dataset::{DatasetFolder, ReadSettings, Source, Split, Surface, TactileSettings, Units};
use sps_estimator::{
    About, Calibration, Embedder, Estimator, Examples, Fitted, Frame, Network, Recipe, Regression,
};
use sps_metrics::Level;
use sps_models::encoders::{Block, Depths, Encoder, EncoderKind};
use sps_regress::kernel_ridge::KernelRidge;
use sps_regress::ridge::Ridge;
use sps_regress::{AnyRegressor, Embeddings, Readings, TrainingData};

pub(crate) const SIDE: usize = 32;

pub(crate) fn uniform(purpose: &str, index: u64) -> f64 {
    let mut stream = hashed_stream("tests", [purpose.as_bytes(), &index.to_le_bytes()]);
    (f64::from(stream.next_u32()) + 0.5) / 4_294_967_296.0
}

pub(crate) fn brightness(surface: usize) -> f64 {
    uniform("brightness", surface as u64)
}

/// A photograph of a surface: stripes, brighter towards one side.
pub(crate) fn photograph(surface: usize, view: usize) -> Frame {
    let bright = brightness(surface) as f32;
    let value = |at: usize| {
        let (x, y) = ((at / 3) % SIDE, at / 3 / SIDE);
        let stripe = ((x * (view + 1) + y + surface) % 5) as f32 / 10.0;
        (bright * (0.5 + stripe)).clamp(0.0, 1.0)
    };
    Frame {
        width: SIDE,
        height: SIDE,
        data: (0..3 * SIDE * SIDE).map(value).collect(),
    }
}

pub(crate) fn embedder() -> Embedder {
    embedder_of(None)
}

pub(crate) fn embedder_of(resize: Option<usize>) -> Embedder {
    let encoder = Encoder::seeded(EncoderKind::SqueezeNet1_1, 3).unwrap();
    let encoder = encoder.with_depths(&Depths::All).unwrap();
    Embedder::new(Network::Images(encoder), resize).unwrap()
}

pub(crate) fn ridge() -> Regression {
    Regression::Rows(AnyRegressor::Ridge(Ridge::default()))
}

pub(crate) fn kernel() -> Regression {
    Regression::Rows(AnyRegressor::KernelRidge(KernelRidge::default()))
}

/// Tables of surfaces of which so many form a group.
pub(crate) struct Tables {
    pub embeddings: Embeddings,
    pub readings: Readings,
    pub units: Units,
    resize: Option<usize>,
}

impl Tables {
    pub(crate) fn new(surfaces: usize, views: usize, of_group: usize) -> Self {
        Self::of(surfaces, views, of_group, None)
    }

    /// Single surfaces of one view, brought to a size.
    pub(crate) fn resized(surfaces: usize, resize: Option<usize>) -> Self {
        Self::of(surfaces, 1, 1, resize)
    }

    /// Sets what was read of the first property of a surface.
    pub(crate) fn set(&mut self, surface: usize, reading: f64) {
        let row = |at| self.readings.row(at).unwrap().to_vec();
        let mut rows: Vec<_> = (0..self.readings.surfaces()).map(row).collect();
        rows[surface][0] = Some(reading);
        let properties = self.readings.properties().to_vec();
        self.readings = Readings::new(properties, &rows).unwrap();
    }

    fn of(surfaces: usize, views: usize, of_group: usize, resize: Option<usize>) -> Self {
        let embedder = embedder_of(resize);
        let frames =
            (0..surfaces).flat_map(|surface| (0..views).map(move |view| photograph(surface, view)));
        let values = embedder.embed(&frames.collect::<Vec<_>>()).unwrap();
        let row = |surface: usize| {
            let (bright, noise) = (brightness(surface), uniform("noise", surface as u64));
            let felt = [60.0 * bright + 4.0 * noise, 10.0 - 5.0 * bright];
            felt.map(Some).to_vec()
        };
        let rows: Vec<Vec<Option<f64>>> = (0..surfaces).map(row).collect();
        Self {
            embeddings: embedder.table(&values, surfaces, views).unwrap(),
            readings: Readings::new(vec!["fRS".into(), "felt".into()], &rows).unwrap(),
            units: grouped((0..surfaces).map(|surface| surface / of_group)),
            resize,
        }
    }

    pub(crate) fn examples(&self) -> Examples<'_> {
        examples(&self.embeddings, &self.readings, &self.units)
    }

    pub(crate) fn all(&self) -> Vec<usize> {
        (0..self.embeddings.surfaces()).collect()
    }

    /// The surfaces that a recipe fits and those that calibrate it.
    pub(crate) fn part(&self, recipe: &Recipe) -> Split {
        let part = recipe.calibration.part(&self.units, &self.all(), 0);
        part.unwrap()
    }

    pub(crate) fn fit(&self, recipe: &Recipe) -> sps_estimator::Result<Fitted> {
        recipe.fit(&self.examples(), &self.all(), 0)
    }

    /// The same of an encoder that learned from some surfaces.
    pub(crate) fn fit_beside(
        &self,
        recipe: &Recipe,
        saw: &[usize],
    ) -> sps_estimator::Result<Fitted> {
        let mut examples = self.examples();
        examples.encoder_saw = saw;
        recipe.fit(&examples, &self.all(), 0)
    }

    pub(crate) fn estimator(&self, recipe: &Recipe) -> Estimator {
        let fitted = self.fit(recipe).unwrap();
        let about = about(&recipe.slots().unwrap());
        Estimator::new(embedder_of(self.resize), fitted, about).unwrap()
    }
}

/// Surfaces of groups of these numbers.
pub(crate) fn grouped(groups: impl Iterator<Item = usize>) -> Units {
    let surface = |group: usize| Surface {
        id: String::new(),
        material: String::new(),
        group: group.to_string(),
    };
    Units::of(&groups.map(surface).collect::<Vec<_>>())
}

/// Of photographs of such views, ten degrees apart.
pub(crate) fn about(views: &[usize]) -> About {
    About {
        name: "test".into(),
        frame_size: [SIDE, SIDE],
        angles: views.iter().map(|&view| 10.0 * view as f64).collect(),
        ..About::default()
    }
}

/// Of an encoder that learned from none of them.
pub(crate) fn examples<'a>(
    embeddings: &'a Embeddings,
    readings: &'a Readings,
    units: &'a Units,
) -> Examples<'a> {
    Examples {
        data: TrainingData::new(embeddings, readings).with_units(units.of_surface()),
        units,
        encoder_saw: &[],
    }
}

pub(crate) fn recipe(regression: Regression, views: &[usize]) -> Recipe {
    Recipe::new(regression, ["fRS", "felt"], views, calibration(0.4, 0.8, 1))
}

pub(crate) fn calibration(share: f64, level: f64, seed: u64) -> Calibration {
    Calibration {
        share: Some(share),
        level: Level::new(level).unwrap(),
        seed,
    }
}

/// The same, written to a folder and read from it.
pub(crate) fn read_again(estimator: &Estimator) -> Estimator {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("deep/model");
    estimator.save(&folder).unwrap();
    Estimator::load(&folder).unwrap()
}

pub(crate) fn block(name: &str, width: usize) -> Block {
    Block {
        name: name.to_owned(),
        width,
    }
}

/// `numpy.save` of rows of that many numbers each, f32.
pub(crate) fn npy(values: &[f32], width: usize) -> Vec<u8> {
    let shape = (values.len() / width, width);
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape:?}, }}");
    let mut bytes = b"\x93NUMPY\x01\x00v\x00".to_vec();
    bytes.extend(format!("{header:<117}\n").bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// Holds that something is refused with words that have this part.
pub(crate) fn refused<T>(result: sps_estimator::Result<T>, part: &str) {
    let error = result.err().expect(part).to_string();
    assert!(error.contains(part), "{error}");
}

/// A file or folder that is not part of the repository.
pub(crate) fn shared(name: &str) -> Option<PathBuf> {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let path = shared.join(name);
    if path.exists() {
        return Some(path);
    }
    println!("SKIPPED: {} is not there", path.display());
    None
}

/// Photographs of surfaces with one value each, and what they look like.
pub(crate) struct Photographs {
    pub dataset: DatasetFolder,
    pub embedder: Embedder,
    pub embeddings: Embeddings,
    pub readings: Readings,
}

impl Photographs {
    pub(crate) fn of(name: &str, property: &str, encoder: Encoder) -> Option<Self> {
        let folder = shared(&format!("data/{name}"))?;
        let dataset = DatasetFolder::open(&folder, &ReadSettings::default()).unwrap();
        let embedder = Embedder::new(Network::Images(encoder), None).unwrap();
        let count = dataset.surfaces().len();
        let frames = (0..count).map(|surface| dataset.frame(surface, 0).unwrap());
        let values = embedder.embed(&frames.collect::<Vec<_>>()).unwrap();
        let table = dataset.tactile();
        let touched = table.averages(&TactileSettings::default(), count);
        let row = |at| vec![touched.value(at, property)];
        let rows: Vec<_> = (0..count).map(row).collect();
        Some(Self {
            readings: Readings::new(vec![property.to_owned()], &rows).unwrap(),
            embeddings: embedder.table(&values, count, 1).unwrap(),
            embedder,
            dataset,
        })
    }
}
