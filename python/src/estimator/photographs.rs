//! Photographs as a model takes them.

use anyhow::{Result, ensure};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyIterator;
use sps_estimator::{Estimator, Frame, Network};

use crate::images::{Image, Images, frames, images, is_one};

/// To which size photographs are brought: "model", "keep", or a number of pixels.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Scale(pub(crate) sps_estimator::Scale);

impl<'py> FromPyObject<'_, 'py> for Scale {
    type Error = PyErr;

    fn extract(scale: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(pixels @ 1..) = scale.extract() {
            return Ok(Self(sps_estimator::Scale::ShorterSide(pixels)));
        }
        let name: Option<String> = scale.extract().ok();
        match name.as_deref() {
            Some("model") => Ok(Self(sps_estimator::Scale::OfModel)),
            Some("keep") => Ok(Self(sps_estimator::Scale::Keep)),
            _ => Err(PyValueError::new_err(format!(
                "scale: found {}, expected \"model\", \"keep\" or a number of pixels",
                scale.repr()?
            ))),
        }
    }
}

/// A model, and the size to which photographs are brought for it.
#[derive(Clone, Copy)]
pub(crate) struct Reader<'m> {
    model: &'m Estimator,
    scale: sps_estimator::Scale,
    least_side: usize,
}

impl<'m> Reader<'m> {
    /// Refuses another scale than its own of a model that has one for all photographs, unless they are
    /// `for_map`, whose scale is that of the photographs fitted on as they came.
    pub(crate) fn new(model: &'m Estimator, scale: Scale, for_map: bool) -> Result<Self> {
        let embedder = model.embedder();
        if let Some(own) = embedder.resize() {
            ensure!(
                for_map || scale.0 == sps_estimator::Scale::OfModel,
                "scale: the model itself brings the shorter side of every photograph to {own} pixels"
            );
        }
        let least_side = match embedder.network() {
            Network::Images(encoder) => encoder.kind().min_size(),
            _ => 1,
        };
        Ok(Self {
            model,
            scale: scale.0,
            least_side,
        })
    }

    /// The photograph at the model's scale.
    pub(crate) fn frame(self, image: Image) -> Result<Frame> {
        let Self { model, scale, .. } = self;
        image.frame(
            self.least_side,
            |path| Ok(model.read(path, scale)?),
            |frame| Ok(model.rescale(frame, scale)?),
        )
    }

    /// The embeddings of photographs, (photographs, width).
    pub(crate) fn embed(self, images: Vec<Image>) -> Result<Vec<f32>> {
        let frames = frames(images, |image| self.frame(image))?;
        Ok(self.model.embedder().embed(&frames)?)
    }
}

/// The photographs of several surfaces, one after the other.
pub(crate) struct Surfaces<'py> {
    /// Those that are still to come.
    to_come: Bound<'py, PyIterator>,
    /// What is left of the last surface.
    photographs: Option<Images<'py>>,
    /// Photographs of each surface so far.
    pub(crate) counts: Vec<usize>,
}

impl<'py> Surfaces<'py> {
    /// Of an iterable of surfaces, each a photograph or an iterable of photographs.
    pub(crate) fn new(surfaces: &Bound<'py, PyAny>) -> PyResult<Self> {
        if is_one(surfaces) {
            let problem = "found one photograph, expected one or several for each surface";
            return Err(PyTypeError::new_err(format!("photographs: {problem}")));
        }
        Ok(Self {
            to_come: surfaces.try_iter()?,
            photographs: None,
            counts: Vec::new(),
        })
    }

    fn next_surface(&mut self) -> Option<Result<Images<'py>>> {
        let surface = self.to_come.next()?;
        let of = format!("surface {}: ", self.counts.len());
        self.counts.push(0);
        let photographs = || images(of, &surface?);
        Some(photographs())
    }
}

impl Iterator for Surfaces<'_> {
    type Item = Result<Image>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(image) = self.photographs.as_mut().and_then(Iterator::next) {
                if let Some(count) = self.counts.last_mut() {
                    *count += 1;
                }
                return Some(image);
            }
            match self.next_surface()? {
                Ok(photographs) => self.photographs = Some(photographs),
                Err(error) => return Some(Err(error)),
            }
        }
    }
}
