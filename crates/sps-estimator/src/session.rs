//! As many photographs as a surface needs, one after the other.

use std::borrow::Borrow;

use sps_dataset::Frame;

use crate::error::{Result, refuse};
use crate::estimator::{Answer, Estimator};

/// Looks at one surface until every interval is narrow enough, or the model has no further view.
///
/// A model that was fitted to be looked at one by one ([`Recipe::one_by_one`](crate::Recipe)) says
/// after each photograph what it estimates. Its intervals hold the truth after every number of
/// photographs at once, so that the coverage stands wherever one stops.
///
/// `E` is what holds the model: a reference, or an `Arc` where the session outlives the place that began
/// it.
pub struct Session<E> {
    estimator: E,
    width: f64,
    /// Of the photographs so far.
    embeddings: Vec<f32>,
    views: usize,
    over: bool,
}

/// What is said after a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct Looked {
    /// The photographs so far.
    pub views: usize,
    /// The estimates from them.
    pub answer: Answer,
    /// For each property whether its interval is as narrow as asked.
    pub narrow: Vec<bool>,
    /// The roll angle to look from next, in degrees; `None` where there is no need to, or no further
    /// view.
    pub next: Option<f64>,
}

impl<E: Borrow<Estimator>> Session<E> {
    /// Begins to look at one surface, until no interval is wider than `width` standard deviations of
    /// the readings that the model was fitted on.
    ///
    /// # Errors
    /// A width that is not above 0, a model that takes all its views at once, one without an interval
    /// for some property.
    pub fn new(estimator: E, width: f64) -> Result<Self> {
        if !(width.is_finite() && width > 0.0) {
            return refuse("width", width, "standard deviations, above 0");
        }
        let model: &Estimator = estimator.borrow();
        let views = model.about.angles.len();
        if model.fitted.steps().len() < views {
            let expected = "a model that looks at its views one by one";
            return refuse("model", format!("{views} views at once"), expected);
        }
        if let Some((property, reason)) = model.no_interval().into_iter().next() {
            return refuse(property, format!("no interval: {reason}"), "an interval");
        }
        Ok(Self {
            estimator,
            width,
            embeddings: Vec::new(),
            views: 0,
            over: false,
        })
    }

    /// The roll angle to look from next, in degrees; `None` where it is over.
    pub fn next_angle(&self) -> Option<f64> {
        let angles = &self.estimator.borrow().about.angles;
        angles.get(self.views).copied().filter(|_| !self.over)
    }

    /// Looks at the next photograph, which has the model's scale.
    ///
    /// # Errors
    /// A session that is over, what the encoder says.
    pub fn look(&mut self, photograph: &Frame) -> Result<Looked> {
        if self.next_angle().is_none() {
            let found = format!("one more after {}", self.views);
            return refuse("photographs", found, "none: the session is over");
        }
        let model: &Estimator = self.estimator.borrow();
        self.embeddings.extend(model.embedder.embed(&[photograph])?);
        self.views += 1;
        let embeddings = model.embedder.table(&self.embeddings, 1, self.views)?;
        let predictions = model.fitted.predict(&embeddings)?;
        let narrow = model.fitted.narrow(&predictions, self.width).concat();
        self.over = narrow.iter().all(|narrow| *narrow);
        Ok(Looked {
            views: self.views,
            answer: model.answer(&predictions, &embeddings, 0..1),
            narrow,
            next: self.next_angle(),
        })
    }
}
