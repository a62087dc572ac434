//! Numbers as JSON.

use serde::Serialize;
use sps_estimator::{Described, Estimator};

use super::Mapped;

/// The numbers of a map, row by row. What a place does not have is none for all.
#[derive(Serialize)]
pub(crate) struct Numbers<'a> {
    property: &'a str,
    #[serde(flatten)]
    described: Described,
    level: f64,
    rows: usize,
    columns: usize,
    window: [usize; 2],
    centres: &'a [[f64; 2]],
    values: Vec<f64>,
    low: Option<Vec<f64>>,
    high: Option<Vec<f64>>,
    familiar: Option<Vec<f64>>,
}

impl Mapped<'_> {
    pub(crate) fn numbers(&self, model: &Estimator) -> Numbers<'_> {
        let all = |at: usize| self.places.iter().map(move |place| place[at]);
        let known = |at: usize| all(at).all(f64::is_finite).then(|| all(at).collect());
        let property = self.wanted.property;
        Numbers {
            property,
            described: model.about().describe(property),
            level: model.fitted().level().get(),
            rows: self.grid.rows,
            columns: self.grid.columns,
            window: self.grid.window,
            centres: &self.grid.centres,
            values: all(0).collect(),
            low: known(1),
            high: known(2),
            familiar: known(3),
        }
    }
}
