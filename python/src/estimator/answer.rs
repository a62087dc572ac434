//! What is said of a surface.

use std::collections::BTreeMap;

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::{PyIterator, PyList};

/// The estimate of one property, with the interval that holds the truth of a new surface (or of one of
/// a new group, where the surfaces fitted to come in groups) at the model's level.
#[pyclass(module = "sps", frozen, eq, get_all)]
#[derive(Clone, PartialEq)]
pub(crate) struct Estimate {
    /// The property's code, as the model was fitted with it.
    property: String,
    /// Its name in words, or its code again where it has none.
    name: String,
    /// The unit of its values; empty where they have none.
    unit: String,
    /// The estimate, in the unit of the values fitted to.
    value: f64,
    /// The lower end of the interval; None where there is none, and Answer.no_interval says why.
    low: Option<f64>,
    /// The upper end of the interval; None where there is none.
    high: Option<f64>,
}

/// What is said of one surface.
#[pyclass(module = "sps", frozen, eq, get_all)]
#[derive(Clone, PartialEq)]
pub(crate) struct Answer {
    /// One Estimate for each property, in the order of Estimator.properties.
    estimates: Vec<Estimate>,
    /// The p-value of "these photographs are like those that the model was fitted on": where they are,
    /// it is at most q with a probability of at most q. None where the model does not know, and
    /// Estimator.no_familiar says why.
    familiar: Option<f64>,
    /// The reason of each property that has no interval, by its code.
    no_interval: BTreeMap<String, String>,
}

/// What is said of several surfaces: a sequence of Answer, and the same as arrays, NaN where there is no
/// interval or p-value.
#[pyclass(module = "sps", frozen, eq, sequence)]
#[derive(PartialEq)]
pub(crate) struct Answers {
    answers: Vec<Answer>,
    properties: usize,
}

#[pymethods]
impl Answers {
    /// The estimates, float64 (surfaces, properties).
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |estimate| Some(estimate.value))
    }

    /// The lower ends of the intervals, float64 (surfaces, properties).
    #[getter]
    fn low<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |estimate| estimate.low)
    }

    /// The upper ends of the intervals, float64 (surfaces, properties).
    #[getter]
    fn high<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |estimate| estimate.high)
    }

    /// The p-values of "like those that the model was fitted on", float64 (surfaces,).
    #[getter]
    fn familiar<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let answers = self.answers.iter();
        let values = answers.map(|answer| answer.familiar.unwrap_or(f64::NAN));
        PyArray1::from_vec(py, values.collect())
    }

    fn __len__(&self) -> usize {
        self.answers.len()
    }

    fn __getitem__(&self, surface: usize) -> PyResult<Answer> {
        let answer = self.answers.get(surface).cloned();
        answer.ok_or_else(|| PyIndexError::new_err(surface))
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        PyList::new(py, self.answers.clone())?.try_iter()
    }

    fn __repr__(&self) -> String {
        let answers: Vec<String> = self.answers.iter().map(Answer::__repr__).collect();
        format!("Answers([{}])", answers.join(", "))
    }
}

impl Answers {
    pub(super) fn new(answers: Vec<Answer>, properties: usize) -> Self {
        Self {
            answers,
            properties,
        }
    }

    fn array<'py>(
        &self,
        py: Python<'py>,
        of: fn(&Estimate) -> Option<f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let values = self.answers.iter().flat_map(|answer| answer.numbers(of));
        let values = PyArray1::from_vec(py, values.collect());
        values.reshape([self.answers.len(), self.properties])
    }
}

impl Answer {
    fn numbers(&self, of: fn(&Estimate) -> Option<f64>) -> Vec<f64> {
        let numbers = self.estimates.iter().map(of);
        numbers.map(|number| number.unwrap_or(f64::NAN)).collect()
    }
}

impl From<sps_estimator::Answer> for Answer {
    fn from(answer: sps_estimator::Answer) -> Self {
        let estimates = answer.estimates.into_iter();
        let estimates = estimates.map(|estimate| Estimate {
            property: estimate.property,
            name: estimate.name,
            unit: estimate.unit,
            value: estimate.value,
            low: estimate.low,
            high: estimate.high,
        });
        Self {
            estimates: estimates.collect(),
            familiar: answer.familiar,
            no_interval: answer.no_interval,
        }
    }
}

#[pymethods]
impl Estimate {
    fn __repr__(&self) -> String {
        let (property, name, value) = (&self.property, &self.name, self.value);
        let (low, high) = (shown(self.low), shown(self.high));
        format!(
            "Estimate(property={property:?}, name={name:?}, value={value:?}, low={low}, high={high})"
        )
    }
}

#[pymethods]
impl Answer {
    /// The estimates, float64 (properties,).
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.numbers(|estimate| Some(estimate.value)))
    }

    /// The lower ends of the intervals, float64 (properties,); NaN where there is none.
    #[getter]
    fn low<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.numbers(|estimate| estimate.low))
    }

    /// The upper ends of the intervals, float64 (properties,); NaN where there is none.
    #[getter]
    fn high<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.numbers(|estimate| estimate.high))
    }

    pub(super) fn __repr__(&self) -> String {
        let estimates: Vec<String> = self.estimates.iter().map(Estimate::__repr__).collect();
        let (estimates, familiar) = (estimates.join(", "), shown(self.familiar));
        format!("Answer(estimates=[{estimates}], familiar={familiar})")
    }
}

/// As Python shows it.
pub(super) fn shown(value: Option<f64>) -> String {
    value.map_or_else(|| "None".to_owned(), |value| format!("{value:?}"))
}
