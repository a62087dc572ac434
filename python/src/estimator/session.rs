//! One photograph after the other.

use std::sync::Arc;

use pyo3::prelude::*;
use sps_estimator::Scale as Brought;

use super::answer::{Answer, shown};
use super::photographs::{Reader, Scale};
use crate::errors::Raises;
use crate::images::Image;

/// Looks at one surface until every interval is narrow enough, or the model has no further view; made
/// by Estimator.session.
///
/// The intervals hold the truth after every number of photographs at once, so that what they promise
/// stands wherever one stops. A session is for one thread at a time: RuntimeError where two use it.
#[pyclass(module = "sps")]
pub(crate) struct Session {
    model: Arc<sps_estimator::Estimator>,
    session: sps_estimator::Session<Arc<sps_estimator::Estimator>>,
}

/// What is said after a photograph.
#[pyclass(module = "sps", frozen, get_all)]
pub(crate) struct Looked {
    /// The photographs so far.
    views: usize,
    /// The Answer from them.
    answer: Answer,
    /// For each property whether its interval is as narrow as asked, in the order of the estimates.
    narrow: Vec<bool>,
    /// The roll angle to look from next, in degrees; None where there is no need to, or no further
    /// view.
    next_angle: Option<f64>,
}

impl Session {
    pub(crate) fn new(
        model: &Arc<sps_estimator::Estimator>,
        width: f64,
    ) -> sps_estimator::Result<Self> {
        Ok(Self {
            model: Arc::clone(model),
            session: sps_estimator::Session::new(Arc::clone(model), width)?,
        })
    }
}

#[pymethods]
impl Session {
    /// The roll angle to look from next, in degrees; None where the session is over.
    #[getter]
    fn next_angle(&self) -> Option<f64> {
        self.session.next_angle()
    }

    /// Looks at the next photograph, a path or an array (height, width, 3), from next_angle; `scale` as
    /// in Estimator.predict.
    ///
    /// Raises ValueError where the session is over, and what Estimator.predict raises.
    #[pyo3(
        signature = (photograph, *, scale = Scale(Brought::OfModel)),
        text_signature = "(self, photograph, *, scale='model')"
    )]
    fn look(
        &mut self,
        py: Python<'_>,
        photograph: &Bound<'_, PyAny>,
        scale: Scale,
    ) -> Raises<Looked> {
        let photograph = Image::new("the photograph".to_owned(), photograph)?;
        let Self { model, session } = self;
        let reader = Reader::new(model, scale, false)?;
        let looked = py.detach(|| anyhow::Ok(session.look(&reader.frame(photograph)?)?))?;
        Ok(Looked {
            views: looked.views,
            answer: looked.answer.into(),
            narrow: looked.narrow,
            next_angle: looked.next,
        })
    }
}

#[pymethods]
impl Looked {
    fn __repr__(&self) -> String {
        let (views, answer) = (self.views, self.answer.__repr__());
        let next = shown(self.next_angle);
        format!("Looked(views={views}, answer={answer}, next_angle={next})")
    }
}
