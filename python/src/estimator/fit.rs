//! A model from photographs and what was felt on them.

use anyhow::{Context, Result, bail, ensure};
use numpy::{AllowTypeChange, PyArrayLikeDyn};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sps_dataset::{Extent, Surface, Units};
use sps_estimator::{
    About, Calibration, Embedder, Estimator, Examples, Network, Recipe, Regression,
};
use sps_models::encoders::Encoder;
use sps_regress::{Embeddings, Readings, TrainingData};

use super::photographs::Surfaces;
use crate::images::{embed_each, frames};

/// What a single column of values is called.
const VALUE: &str = "value";

/// What was measured: one row for each surface.
pub(crate) struct Values {
    pub(crate) properties: Vec<String>,
    pub(crate) rows: Vec<Vec<Option<f64>>>,
}

impl Values {
    /// Values (n,) or (n, properties), NaN where nothing was measured.
    pub(crate) fn new(
        values: &PyArrayLikeDyn<'_, f64, AllowTypeChange>,
        properties: Option<Vec<String>>,
    ) -> Result<Self> {
        let values = values.as_array();
        let columns = match *values.shape() {
            [_] => 1,
            [_, columns] => columns,
            ref found => bail!("values of shape {found:?}, expected (n,) or (n, properties)"),
        };
        let properties = properties.unwrap_or_else(|| vec![VALUE.to_owned()]);
        ensure!(
            properties.len() == columns,
            "properties: found {properties:?}, expected a name for each of {columns} columns"
        );
        let measured = |&value: &f64| (!value.is_nan()).then_some(value);
        let cells: Vec<Option<f64>> = values.iter().map(measured).collect();
        Ok(Self {
            properties,
            rows: cells.chunks(columns.max(1)).map(<[_]>::to_vec).collect(),
        })
    }
}

/// The same, with what stays whole: the groups, or each surface for itself.
pub(crate) type Felt = (Readings, Units);

pub(crate) fn felt(values: Values, groups: Option<&Bound<'_, PyAny>>) -> Result<Felt> {
    let Values { properties, rows } = values;
    let surfaces = rows.len();
    let groups = match groups {
        Some(groups) => numbered(groups)?,
        None => (0..surfaces).collect(),
    };
    ensure!(
        groups.len() == surfaces,
        "groups: found {}, expected one for each of {surfaces} surfaces",
        groups.len()
    );
    let surface = |(at, group): (usize, usize)| Surface {
        id: at.to_string(),
        material: String::new(),
        group: group.to_string(),
    };
    let surfaces: Vec<Surface> = groups.into_iter().enumerate().map(surface).collect();
    Ok((Readings::new(properties, &rows)?, Units::of(&surfaces)))
}

/// Numbers of things that Python can tell apart, in the order in which they come up.
pub(crate) fn numbered(things: &Bound<'_, PyAny>) -> PyResult<Vec<usize>> {
    let numbers = PyDict::new(things.py());
    let number = |thing: PyResult<Bound<'_, PyAny>>| -> PyResult<usize> {
        let next = numbers.len();
        let number = numbers.call_method1("setdefault", (thing?, next))?;
        number.extract()
    };
    things.try_iter()?.map(number).collect()
}

/// Photographs of surfaces, as many of each, turned to embeddings.
pub(crate) struct Seen {
    embedder: Embedder,
    embeddings: Embeddings,
    /// Of the first photograph, as it came.
    extent: Extent,
}

impl Seen {
    pub(crate) fn new(
        photographs: &Bound<'_, PyAny>,
        encoder: &Encoder,
        resize: Option<usize>,
    ) -> Result<Self> {
        let py = photographs.py();
        let network = Network::Images(encoder.clone());
        let embedder = py.detach(|| Embedder::new(network, resize))?;
        let mut surfaces = Surfaces::new(photographs)?;
        let mut extent = None;
        let values = embed_each(py, &mut surfaces, |images| {
            if let (None, Some(first)) = (extent, images.first()) {
                extent = Some(first.extent()?);
            }
            let frames = frames(images, |image| image.resized(resize, encoder.kind()))?;
            Ok(embedder.embed(&frames)?)
        })?;
        let views = views(&surfaces.counts)?;
        Ok(Self {
            embeddings: embedder.table(&values, surfaces.counts.len(), views)?,
            embedder,
            extent: extent.context(NO_PHOTOGRAPH)?,
        })
    }

    /// A model of what was felt by what was seen.
    pub(crate) fn fit(
        self,
        (readings, units): &Felt,
        regression: Regression,
        calibration: Calibration,
        one_by_one: bool,
        angles: Option<Vec<f64>>,
        name: &str,
    ) -> Result<Estimator> {
        let (surfaces, rows) = (self.embeddings.surfaces(), readings.surfaces());
        ensure!(
            surfaces == rows,
            "photographs: found those of {surfaces} surfaces, expected {rows}, one for each row of values"
        );
        let views = self.embeddings.views();
        let about = About {
            name: name.to_owned(),
            method: regression.kind().to_owned(),
            data: format!("photographs of {surfaces} surfaces"),
            frame_size: [self.extent.height, self.extent.width],
            angles: angles.unwrap_or_else(|| vec![0.0; views]),
            ..About::default()
        };
        let all: Vec<usize> = (0..views).collect();
        let recipe = Recipe {
            one_by_one,
            ..Recipe::new(regression, readings.properties(), &all, calibration)
        };
        let data = TrainingData::new(&self.embeddings, readings);
        let examples = Examples {
            data: data.with_units(units.of_surface()),
            units,
            encoder_saw: &[],
        };
        let all: Vec<usize> = (0..surfaces).collect();
        let fitted = recipe.fit(&examples, &all, 0)?;
        Ok(Estimator::new(self.embedder, fitted, about)?)
    }
}

const NO_PHOTOGRAPH: &str = "photographs: found none, expected one or several for each surface";

/// How many photographs each surface has.
fn views(counts: &[usize]) -> Result<usize> {
    let views = counts.first().copied().filter(|&views| views > 0);
    let views = views.context(NO_PHOTOGRAPH)?;
    for (surface, &count) in counts.iter().enumerate() {
        ensure!(
            count == views,
            "photographs: found {count} of surface {surface}, expected {views} as of the first"
        );
    }
    Ok(views)
}
