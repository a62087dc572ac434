//! What a run came to, in a table for the terminal.

use sps_experiment::results::Results;
use sps_experiment::results::speed::{Point, best_within, fastest, looking};

use super::speed::{in_milliseconds, looked_at};
use super::table::{Cell, Row, Table};

/// In a word, how the method at this place stands out of those that look at a photograph; empty where it does
/// not.
pub(super) fn mark(results: &Results, at: usize) -> &'static str {
    let points = looking(&results.methods);
    let is = |point: Option<Point>| point.is_some_and(|point| point.method == at);
    let is_best = is(best_within(&points, f64::INFINITY));
    match (is_best, is(fastest(&points, f64::INFINITY))) {
        (true, true) => "best, fastest",
        (true, false) => "best",
        (false, true) => "fastest",
        (false, false) => "",
    }
}

/// Means over properties and what an estimate costs. The best and the fastest method are marked, of
/// those that look at a photograph.
pub fn summary(results: &Results) -> Table {
    let percentages = results.has_percentages();
    let has_unit = results.shared_unit().is_some();
    let mae = if has_unit { "MAE" } else { "MAE / std" };
    let mut columns = vec!["method", "R²", mae];
    columns.extend(percentages.then_some("% error"));
    columns.extend(["frames", "ms per surface", ""]);
    let rows = results.methods.iter().enumerate().map(|(at, method)| {
        let (means, costs) = (&method.means, &method.costs);
        let over_std = means.mae_over_std_mean;
        let error = if has_unit { means.mae_mean } else { over_std };
        let percent = Cell::number(means.median_percent_error_mean, 1);
        let mut cells = vec![
            method.id.as_str().into(),
            Cell::interval(means.r2_mean, means.r2_mean_interval, 3),
            Cell::number(error, 2),
        ];
        cells.extend(percentages.then_some(percent));
        cells.extend([
            looked_at(costs),
            in_milliseconds(costs.predict_seconds_per_surface),
            mark(results, at).into(),
        ]);
        Row::measured(cells)
    });
    let title = format!("{}: means over properties", results.experiment);
    Table::new("summary", title, columns, rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::file;

    #[test]
    fn the_best_and_the_fastest_are_marked() {
        let mut results: Results = serde_json::from_value(file()).unwrap();
        let ridge = results.methods[0].clone();
        let method = |id: &str, r2, frames, seconds| {
            let mut method = ridge.clone();
            method.id = id.to_owned();
            method.means.r2_mean = r2;
            method.means.r2_mean_interval = r2.and(method.means.r2_mean_interval);
            method.costs.frames_decoded_per_surface = frames;
            method.costs.frames_encoded_per_surface = frames;
            method.costs.predict_seconds_per_surface = seconds;
            method
        };
        results.methods.extend([
            method("slow", Some(0.625), 2.0, Some(0.02)),
            // Looks at nothing.
            method("label", Some(0.75), 0.0, Some(0.0)),
            method("failed", None, 1.0, None),
        ]);
        assert_eq!(
            summary(&results).terminal(),
            concat!(
                "single-image: means over properties\n",
                "  method                    R²  MAE  frames  ms per surface\n",
                "  ridge   0.500 [0.400, 0.600]    –       1           10.00  fastest\n",
                "  slow    0.625 [0.400, 0.600]    –       2           20.00  best\n",
                "  label   0.750 [0.400, 0.600]    –       0            0.00\n",
                "  failed                     –    –       1               –\n",
            )
        );
    }
}
