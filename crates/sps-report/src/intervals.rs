//! How the intervals fared that came with estimates.

use sps_experiment::results::{GivenIntervals, MethodResult, Results};
use sps_experiment::text::decimals;

use super::table::{Cell, Row, Table};
use super::tables::with_unit;

/// A row for each property and one for all; none where no method was given intervals.
pub(super) fn table(results: &Results) -> Option<Table> {
    let methods = results.methods.iter();
    let given = methods.filter_map(|method| Some((method, method.intervals.as_ref()?)));
    let rows = given.flat_map(|(method, intervals)| rows(results, method, intervals));
    let columns = ["Method", "Property", "held, %", "mean width", "width / std"];
    let caption = "The share of held-out readings that lie inside, and how wide the intervals are: in the \
                  property's own unit, and over the standard deviation of its values over all surfaces. All \
                  reruns together.";
    let title = "Intervals that came with estimates";
    let table = Table::new("intervals", title, columns, rows);
    table.about(caption).unless_empty()
}

fn rows(results: &Results, method: &MethodResult, intervals: &GivenIntervals) -> Vec<Row> {
    let row = |property: String, held: Option<f64>, width: Cell, over_std| {
        let held = Cell::number(held.map(|share| 100.0 * share), 1);
        let label = method.label.as_str().into();
        Row::measured(vec![
            label,
            property.into(),
            held,
            width,
            Cell::number(over_std, 2),
        ])
    };
    let of_property = results.properties.iter().map(|code| {
        let described = results.described.get(code);
        let digits = described.map_or(2, |known| decimals(known.std) + 1);
        let width = intervals.mean_width.get(code).copied();
        let over_std = intervals.mean_width_over_std.get(code).copied().flatten();
        row(
            with_unit(code, results.unit_of(code)),
            intervals.coverage.get(code).copied(),
            Cell::number(width, digits),
            over_std,
        )
    });
    let mean = row(
        "mean".to_owned(),
        Some(intervals.coverage_mean),
        Cell::from(""),
        intervals.mean_width_over_std_mean,
    );
    of_property.chain([mean]).collect()
}
