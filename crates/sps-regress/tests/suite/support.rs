//! What several topics are tested with.

use ndarray::Array2;
use sps_regress::{Embeddings, Plan, Readings, Rerun, TrainingData, Views};

/// Surfaces, and the readings of properties `p0`, `p1` and so on.
pub(crate) struct Set {
    pub(crate) embeddings: Embeddings,
    pub(crate) readings: Readings,
}

impl Set {
    pub(crate) fn of(embeddings: Embeddings, columns: &[Vec<Option<f64>>]) -> Self {
        let names = (0..columns.len()).map(|p| format!("p{p}")).collect();
        let row = |s: usize| columns.iter().map(|column| column[s]).collect();
        let rows: Vec<Vec<_>> = (0..columns[0].len()).map(row).collect();
        Self {
            embeddings,
            readings: Readings::new(names, &rows).unwrap(),
        }
    }

    pub(crate) fn data(&self) -> TrainingData<'_> {
        TrainingData::new(&self.embeddings, &self.readings)
    }

    /// Of the first surfaces, or others, and some of the views.
    pub(crate) fn plan(&self, training: impl IntoIterator<Item = usize>, views: &[usize]) -> Plan {
        let plan = Plan::each(3, self.readings.properties(), vec![Rerun::new(0, training)]);
        plan.with_views(&Views::Fixed(views.to_vec()))
    }
}

/// The solution of a system whose last column is its right side, by elimination with the rows as they stand.
pub(crate) fn solved(mut system: Array2<f64>) -> Vec<f64> {
    for at in 0..system.nrows() {
        let pivot = &system.row(at) / system[[at, at]];
        for mut row in system.rows_mut() {
            let factor = row[at];
            row.scaled_add(-factor, &pivot);
        }
        system.row_mut(at).assign(&pivot);
    }
    system.column(system.nrows()).to_vec()
}
