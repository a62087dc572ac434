//! Fitted models: photographs in, values with intervals out.

mod answer;
mod fit;
mod map;
mod photographs;
mod session;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::{env, fs};

use anyhow::{Context, Result, ensure};
use numpy::{AllowTypeChange, PyArrayLikeDyn};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use sps_estimator::{Calibration, Scale as Brought, Sight};
use sps_metrics::Level;
use tempfile::TempDir;

pub(crate) use self::answer::{Answer, Answers, Estimate};
use self::fit::{Seen, felt};
pub(crate) use self::fit::{Values, numbered};
pub(crate) use self::photographs::Surfaces;
use self::photographs::{Reader, Scale};
pub(crate) use self::session::{Looked, Session};
use crate::embeddings::{self, Array};
use crate::encoder::{Encoder, built_in};
use crate::errors::Raises;
use crate::images::{self, Image, embed_each};
use crate::settings::{python, regression};

/// A fitted model: photographs of a surface in, what a touch sensor would measure on it out, each value
/// with an interval, and a p-value that says whether the surface is like those fitted on.
///
/// It is made by Estimator.fit, or read by Estimator.load from a folder that Estimator.save or
/// `sps fit` wrote. It never changes; any number of threads may use it at once, and the same
/// photographs give the same bits on each and beside any others.
///
/// A photograph is a path or an array as Encoder.transform takes them. `scale` says to which size one is
/// brought: "model", its shorter side to that of the photographs fitted on, which is right where both
/// show as much of a surface; "keep", it keeps its size, which is right where a pixel shows as much
/// (of crops, for example); a number, its shorter side to so many pixels. A model that was fitted with
/// `resize` has a size of its own, and ValueError says so where another is asked for.
#[pyclass(module = "sps", frozen)]
pub(crate) struct Estimator {
    model: Arc<sps_estimator::Estimator>,
    joint: bool,
}

#[pymethods]
impl Estimator {
    /// Reads a model from a folder; with `joint=True` its intervals are wider, and hold the truths of all
    /// properties of a surface at once.
    ///
    /// Raises OSError where a file cannot be read, ValueError where one is damaged, does not belong to
    /// the others, or is of a later version.
    #[staticmethod]
    #[pyo3(signature = (folder, *, joint = false))]
    fn load(py: Python<'_>, folder: PathBuf, joint: bool) -> Raises<Self> {
        let model = py.detach(|| sps_estimator::Estimator::load(&folder))?;
        Ok(Self {
            joint,
            ..Self::of(if joint { model.jointly() } else { model })
        })
    }

    /// Fits a model to photographs of n surfaces and what was measured on them.
    ///
    /// `photographs` holds one of each surface, or a list of equally many of each; `values` is float64
    /// (n,) or (n, properties), NaN where nothing was measured; `properties` names the columns ("value"
    /// where there is one); `encoder` is an Encoder, the built-in one where none is given. `groups`, (n,) of anything hashable, says which
    /// surfaces are alike (sheets of one roll, photographs of one material): a group is never parted,
    /// and intervals are for a surface of a new one.
    ///
    /// `regression` is a name of `sps list regressors` or head, the paper's network; or a method of a config
    /// (docs/config.md) with its settings, as {"kind": "head", "head": {"epochs": 60}}, {"kind": "stacked",
    /// "members": ("ridge", "head"), "folds": 5} or {"kind": "kernel-ridge", "kernel-ridge": {"at-most":
    /// 1000}}. The share `calibration` of the surfaces is kept aside for
    /// the intervals, which hold the truth of the share `level` of new surfaces; where these are too few
    /// for the level there are none (Estimator.no_interval). With `calibration` None all surfaces are
    /// fitted to, and there are no intervals: for scores of the estimates alone. `seed` keys every draw. Photographs keep
    /// their size unless `resize` says to how many pixels the shorter side of each is brought. With
    /// several photographs of each surface, `angles` are their roll angles in degrees (0 if not
    /// given), and `one_by_one` fits a model for Estimator.session. `name` is what about says.
    ///
    /// Intervals and p-values hold where the encoder was not trained on these surfaces.
    ///
    /// Raises what Encoder.transform raises, and ValueError for other shapes, numbers and names, infinite
    /// values, and too few surfaces or groups to keep any aside.
    #[staticmethod]
    #[pyo3(signature = (
        photographs, values, *, encoder = None, properties = None, groups = None, regression = None,
        calibration = 0.3, level = 0.9, seed = 0, resize = None, angles = None, one_by_one = false,
        name = ""
    ))]
    #[expect(clippy::too_many_arguments, reason = "most are keywords")]
    fn fit(
        py: Python<'_>,
        photographs: &Bound<'_, PyAny>,
        values: PyArrayLikeDyn<'_, f64, AllowTypeChange>,
        encoder: Option<&Bound<'_, Encoder>>,
        properties: Option<Vec<String>>,
        groups: Option<&Bound<'_, PyAny>>,
        regression: Option<&Bound<'_, PyAny>>,
        calibration: Option<f64>,
        level: f64,
        seed: u64,
        resize: Option<usize>,
        angles: Option<Vec<f64>>,
        one_by_one: bool,
        name: &str,
    ) -> Raises<Self> {
        let regression = self::regression(regression)?;
        let calibration = Calibration {
            share: calibration,
            level: Level::new(level)?,
            seed,
        };
        let felt = felt(Values::new(&values, properties)?, groups)?;
        let encoder = match encoder {
            Some(encoder) => encoder.get().network().clone(),
            None => py.detach(built_in)?,
        };
        let seen = Seen::new(photographs, &encoder, resize)?;
        let fit = || seen.fit(&felt, regression, calibration, one_by_one, angles, name);
        Ok(Self::of(py.detach(fit)?))
    }

    /// Writes the model into a folder, which is created where it is not there.
    ///
    /// Raises OSError where a file cannot be written.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> Raises<()> {
        Ok(py.detach(|| self.model.save(&folder))?)
    }

    /// What is said of one surface, an Answer, from one photograph of it or several: one for each of
    /// angles, in their order. The path of a folder stands for the photographs in it, by name. A model of
    /// one view takes any number: the answer is the mean of what each says, with an interval of the same
    /// level, and the smallest p-value times their number. Too few surfaces that calibrate for so many
    /// photographs have no interval, and Answer.no_interval says so.
    ///
    /// Raises what Encoder.transform raises, and ValueError for another number of photographs and for a folder
    /// without any.
    #[pyo3(
        signature = (photographs, *, scale = Scale(Brought::OfModel)),
        text_signature = "(self, photographs, *, scale='model')"
    )]
    fn predict(
        &self,
        py: Python<'_>,
        photographs: &Bound<'_, PyAny>,
        scale: Scale,
    ) -> Raises<Answer> {
        let reader = Reader::new(&self.model, scale, false)?;
        let mut images = images::images(String::new(), photographs)?;
        let values = embed_each(py, &mut images, |images| reader.embed(images))?;
        let count = values.len() / self.model.embedder().width();
        let answer = py.detach(|| self.model.predict_embedded(&values, count))?;
        Ok(answer.into())
    }

    /// What is said of each of several surfaces, Answers: as predict says it, to the last bit, with
    /// photographs encoded together. `surfaces` is an iterable whose items are what predict takes.
    ///
    /// Raises what predict raises; the message says of which surface, counted from 0.
    #[pyo3(
        signature = (surfaces, *, scale = Scale(Brought::OfModel)),
        text_signature = "(self, surfaces, *, scale='model')"
    )]
    fn predict_all(
        &self,
        py: Python<'_>,
        surfaces: &Bound<'_, PyAny>,
        scale: Scale,
    ) -> Raises<Answers> {
        let reader = Reader::new(&self.model, scale, false)?;
        let mut surfaces = Surfaces::new(surfaces)?;
        let values = embed_each(py, &mut surfaces, |images| reader.embed(images))?;
        let answers = py.detach(|| self.answers(&values, &surfaces.counts))?;
        Ok(Answers::new(answers, self.properties().len()))
    }

    /// What is said of surfaces whose embeddings were computed as those that the model was fitted on, Answers:
    /// `embeddings` is (surfaces, width), of one photograph each, or (surfaces, views, width).
    ///
    /// Raises ValueError for other shapes and numbers.
    fn predict_embedded(&self, py: Python<'_>, embeddings: Array<'_>) -> Raises<Answers> {
        let (rows, [surfaces, views]) = embeddings::rows(&embeddings)?;
        self.check_width(rows.width())?;
        let counts = vec![views; surfaces];
        let answers = py.detach(|| self.answers(rows.values(), &counts))?;
        Ok(Answers::new(answers, self.properties().len()))
    }

    /// Begins to look at one surface, until no interval is wider than `width` standard deviations of the
    /// values fitted to: a Session.
    ///
    /// Raises ValueError for a width that is not above 0, a model that takes all its photographs at
    /// once, and one that has no interval for some property.
    fn session(&self, width: f64) -> Raises<Session> {
        Ok(Session::new(&self.model, width)?)
    }

    /// Estimates every property in windows of a photograph, `stride` pixels apart (an eighth of a window
    /// if not given). A window is as large as the photographs fitted on. They are encoded in one pass over
    /// the whole photograph, or each `alone`, in as many passes, which says what predict says of the crop.
    ///
    /// A dictionary of float64 arrays: values, low and high of shape (properties, rows, columns),
    /// familiar (rows, columns), and centres (rows, columns, 2), pixels down and to the right from the
    /// upper left corner; NaN where there is no interval or p-value. Neighbouring windows share pixels:
    /// intervals and p-values hold for each alone.
    ///
    /// Raises what predict raises, and ValueError for a model of several views, a photograph smaller
    /// than a window, and a stride of 0.
    #[pyo3(
        signature = (photograph, stride = None, *, scale = Scale(Brought::Keep), alone = false),
        text_signature = "(self, photograph, stride=None, *, scale='keep', alone=False)"
    )]
    fn map<'py>(
        &self,
        py: Python<'py>,
        photograph: &Bound<'py, PyAny>,
        stride: Option<usize>,
        scale: Scale,
        alone: bool,
    ) -> Raises<Bound<'py, PyDict>> {
        let reader = Reader::new(&self.model, scale, true)?;
        let photograph = Image::new("the photograph".to_owned(), photograph)?;
        let stride = stride.unwrap_or_else(|| self.model.stride());
        let sight = if alone { Sight::Alone } else { Sight::Within };
        let map = py.detach(|| {
            let frame = reader.frame(photograph)?;
            anyhow::Ok(self.model.map(&frame, stride, sight)?)
        })?;
        Ok(map::arrays(py, map)?)
    }

    /// The codes of the properties, in the order of the estimates.
    #[getter]
    fn properties(&self) -> Vec<&str> {
        self.model.fitted().properties().collect()
    }

    /// The share of new surfaces (or groups) whose truth an interval holds.
    #[getter]
    fn level(&self) -> f64 {
        self.model.fitted().level().get()
    }

    /// The roll angle of each photograph that it takes, in degrees; 0 is straight down.
    #[getter]
    fn angles(&self) -> Vec<f64> {
        self.model.about().angles.clone()
    }

    /// Why the model does not know whether photographs are like those that it was fitted on; None where
    /// it does.
    #[getter]
    fn no_familiar(&self) -> Option<&str> {
        self.model.fitted().no_familiar()
    }

    /// The reason of each property that has no interval, not of one photograph for each view either, by
    /// its code.
    #[getter]
    fn no_interval(&self) -> BTreeMap<&str, &str> {
        self.model.no_interval()
    }

    /// What goes with the model, a dictionary: name, method, data, source, frame-size (height, width),
    /// angles, decode, and measured, how well models of this kind did on surfaces that they had not seen.
    #[getter]
    pub(crate) fn about<'py>(&self, py: Python<'py>) -> Raises<Bound<'py, PyAny>> {
        python(py, self.model.about())
    }

    /// What a copy is made of: the files that it is saved as.
    fn __reduce__<'py>(&self, py: Python<'py>) -> Raises<Reduced<'py>> {
        let (model, files) = (&self.model, PyDict::new(py));
        let folder = scratch()?;
        py.detach(|| model.save(folder.path()))?;
        for file in folder.path().read_dir()? {
            let path = file?.path();
            files.set_item(path.file_name(), PyBytes::new(py, &fs::read(&path)?))?;
        }
        let of_files = py.get_type::<Self>().getattr("_of_files")?;
        Ok((of_files, (files, self.joint)))
    }

    #[staticmethod]
    fn _of_files(py: Python<'_>, files: BTreeMap<String, Vec<u8>>, joint: bool) -> Raises<Self> {
        let folder = scratch()?;
        for (name, content) in files {
            fs::write(folder.path().join(name), content)?;
        }
        Self::load(py, folder.path().to_owned(), joint)
    }

    fn __repr__(&self) -> String {
        let (properties, level) = (self.properties(), self.level());
        let (name, encoder) = (&self.model.about().name, self.model.embedder().network());
        let encoder = encoder.name();
        format!(
            "Estimator(name={name:?}, encoder={encoder:?}, properties={properties:?}, level={level:?})"
        )
    }
}

/// What pickle calls, and with what.
type Reduced<'py> = (Bound<'py, PyAny>, (Bound<'py, PyDict>, bool));

/// A folder that goes with what holds it.
pub(crate) fn scratch() -> Result<TempDir> {
    let failed = || format!("{}: cannot be written", env::temp_dir().display());
    TempDir::with_prefix("sps-").with_context(failed)
}

impl Estimator {
    pub(crate) fn of(model: sps_estimator::Estimator) -> Self {
        Self {
            model: Arc::new(model),
            joint: false,
        }
    }

    /// What is said of surfaces of so many photographs each, from their embeddings.
    fn answers(&self, mut values: &[f32], counts: &[usize]) -> Result<Vec<Answer>> {
        let width = self.model.embedder().width();
        let mut answers = Vec::with_capacity(counts.len());
        for (surface, &count) in counts.iter().enumerate() {
            let (own, others) = values.split_at(count * width);
            values = others;
            let answer = self.model.predict_embedded(own, count);
            answers.push(answer.with_context(|| format!("surface {surface}"))?.into());
        }
        Ok(answers)
    }

    fn check_width(&self, found: usize) -> Result<()> {
        let width = self.model.embedder().width();
        ensure!(
            found == width,
            "embeddings: found rows of {found}, expected {width}, as those that the model was fitted on"
        );
        Ok(())
    }
}
