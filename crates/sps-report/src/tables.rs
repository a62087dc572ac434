//! The tables of an experiment's report.

use sps_experiment::paper::{self, PaperRow};
use sps_experiment::results::{Gain, GivenIntervals, MethodResult, Number, PerProperty, Results};
use sps_experiment::text::decimals;

use super::learning;
use super::means;
use super::selection;
use super::speed;
use super::table::{Cell, Row, Table};

/// The tables, in the order of the report.
pub fn tables(results: &Results) -> Vec<Table> {
    let mut tables = vec![means::table(results).tested(results.interval_level)];
    tables.extend(speed::tables(results));
    tables.extend(learning::table(results));
    if results.properties.len() > 1 {
        tables.push(per_property(results, &R2));
        if results.has_percentages() {
            tables.push(per_property(results, &PERCENT_ERROR));
        }
        let others = [&MAE, &MAE_OVER_STD, &SPEARMAN];
        tables.extend(others.map(|shown| per_property(results, shown)));
    }
    tables.extend(intervals(results));
    tables.extend(properties(results));
    tables.extend(selection::table(results));
    tables.push(costs(results));
    tables
}

/// A heading with the unit of what is below it, where that has one.
pub(super) fn with_unit(heading: &str, unit: &str) -> String {
    match unit {
        "" => heading.to_owned(),
        unit => format!("{heading} [{unit}]"),
    }
}

/// An empty cell where a method is not compared with the other.
pub fn gained(gain: Option<&Gain>, decimals: usize) -> Cell {
    match gain {
        // An interval over units alone says too little to stand beside a difference.
        Some(gain) => match gain.interval.zip(gain.p) {
            Some((interval, p)) => Cell::gain(gain.value, interval, p, decimals),
            None => Cell::difference(Some(gain.value), None, decimals),
        },
        None => Cell::from(""),
    }
}

/// Printed values per property, and their printed mean.
type Printed<'a> = (&'a PerProperty<f64>, f64);

/// What one of the per-property tables shows.
struct Shown {
    name: &'static str,
    title: &'static str,
    caption: &'static str,
    /// None: as many as the spread of a property's values asks for, and one more.
    decimals: Option<usize>,
    /// Of each property, and on average.
    measured: fn(&MethodResult) -> (&PerProperty<Number>, Number),
    /// By the paper.
    printed: Option<fn(&PaperRow) -> Printed<'_>>,
    /// Whether what a perfect reader of simulated images would reach stands below.
    ceilings: bool,
}

const R2: Shown = Shown {
    name: "r2",
    title: "R² per property",
    caption: "Rows in italics are not measured here: the paper's printed values, and for \
              simulated data the ceiling that a perfect reader of the images would reach.",
    decimals: Some(2),
    measured: |method| (&method.scores.r2, method.means.r2_mean),
    printed: Some(|row| (&row.r2, row.r2_mean)),
    ceilings: true,
};

const PERCENT_ERROR: Shown = Shown {
    name: "percent-error",
    title: "Median percentage error per property",
    caption: "Surfaces whose measured value is exactly zero have no percentage and are left out. \
              Rows in italics are the paper's printed values.",
    decimals: Some(1),
    measured: |method| {
        let mean = method.means.median_percent_error_mean;
        (&method.scores.median_percent_error, mean)
    },
    printed: Some(|row| (&row.median_percent_error, row.median_percent_error_mean)),
    ceilings: false,
};

const MAE_OVER_STD: Shown = Shown {
    name: "mae-over-std",
    title: "Mean absolute error per property, in standard deviations",
    caption: "Over the standard deviation of the property's values over all surfaces.",
    decimals: Some(2),
    measured: |method| (&method.scores.mae_over_std, method.means.mae_over_std_mean),
    ..MAE
};

const SPEARMAN: Shown = Shown {
    name: "spearman",
    title: "Spearman's rank correlation per property",
    caption: "1 where estimates have the order of the measured values.",
    decimals: Some(2),
    measured: |method| (&method.scores.spearman, method.means.spearman_mean),
    ..MAE
};

const MAE: Shown = Shown {
    name: "mae",
    title: "Mean absolute error per property",
    caption: "In the properties' own units. The paper prints the means alone.",
    decimals: None,
    measured: |method| (&method.scores.mae, method.means.mae_mean),
    printed: None,
    ceilings: false,
};

fn per_property(results: &Results, shown: &Shown) -> Table {
    let mut columns = vec!["Method".to_owned()];
    columns.extend(results.properties.iter().map(|code| match shown.decimals {
        None => with_unit(code, results.unit_of(code)),
        Some(_) => code.clone(),
    }));
    columns.push("mean".to_owned());
    let number = |value: Number, std: Option<f64>| {
        let by_spread = || std.map_or(2, |std| decimals(std) + 1);
        Cell::number(value, shown.decimals.unwrap_or_else(by_spread))
    };
    let described = &results.described;
    let widest = described.values().map(|known| known.std).reduce(f64::max);
    let line = |label: String, value: &dyn Fn(&String) -> Number, mean: Number| {
        let mut cells = vec![Cell::from(label)];
        let values = results.properties.iter();
        cells.extend(values.map(|property| {
            let std = described.get(property).map(|known| known.std);
            number(value(property), std)
        }));
        cells.push(number(mean, widest));
        cells
    };
    let mut rows = Vec::new();
    for method in &results.methods {
        let (values, mean) = (shown.measured)(method);
        let value = |property: &String| values.get(property).copied().flatten();
        let label = method.label.clone();
        rows.push(Row::measured(line(label, &value, mean)));
        let paper = printed(results, method);
        let paper = paper.zip(shown.printed).map(|(row, of)| of(row));
        if let Some((values, mean)) = paper.filter(|(values, _)| !values.is_empty()) {
            let value = |property: &String| values.get(property).copied();
            let label = format!("{}, printed in the paper", method.label);
            rows.push(Row::reference(line(label, &value, Some(mean))));
        }
    }
    let ceilings = shown.ceilings.then(|| learning::ceilings(results));
    for (label, ceiling, mean) in ceilings.into_iter().flatten() {
        let value = |property: &String| ceiling.get(property).copied();
        if !ceiling.is_empty() {
            rows.push(Row::reference(line(label.to_owned(), &value, mean)));
        }
    }
    Table::new(shown.name, shown.title, columns, rows).about(shown.caption)
}

fn costs(results: &Results) -> Table {
    let columns = [
        "Method",
        "frames decoded per surface",
        "frames encoded per surface",
        "prediction, ms per surface",
        "training, s",
        "reruns",
    ];
    let rows = results.methods.iter().map(|method| {
        let costs = &method.costs;
        let milliseconds = costs.predict_seconds_per_surface.map(|s| 1e3 * s);
        Row::measured(vec![
            method.label.as_str().into(),
            frames(costs.frames_decoded_per_surface),
            frames(costs.frames_encoded_per_surface),
            Cell::number(milliseconds, 1),
            Cell::number(Some(costs.train_seconds), 1),
            Cell::number(Some(method.reruns as f64), 0),
        ])
    });
    let title = "What an estimate costs";
    Table::new("costs", title, columns, rows).about(costs_caption(results))
}

/// Whole where all properties look at as many frames.
pub(super) fn frames(count: f64) -> Cell {
    Cell::number(Some(count), usize::from(count.fract() != 0.0))
}

fn costs_caption(results: &Results) -> String {
    let mut caption = "Prediction includes decoding or rendering, encoding and the head, measured \
                       on this machine without the cache; training is that of the heads alone, \
                       all properties and reruns together."
        .to_owned();
    if results.methods.iter().any(|m| !m.selections.is_empty()) {
        caption.push_str(
            " Only the views that a method looks at are decoded and encoded: with three selected \
             views that is three frames per surface, and fewer where a view was selected twice. \
             Where each property has views of its own, frames and time are those of estimating \
             one property; elsewhere of all properties together.",
        );
    }
    caption
}

/// The paper's row beside a method, where it may stand there.
pub(super) fn printed(results: &Results, method: &MethodResult) -> Option<&'static PaperRow> {
    let name = method.paper.as_deref();
    name.filter(|_| results.dataset.is_after_the_paper())
        .and_then(paper::row)
}

fn properties(results: &Results) -> Option<Table> {
    let rows = results.properties.iter().filter_map(|code| {
        let known = results.described.get(code)?;
        let digits = decimals(known.std);
        Some(Row::measured(vec![
            code.as_str().into(),
            known.name.as_str().into(),
            known.unit.as_str().into(),
            Cell::number(Some(known.std), digits + 1),
            Cell::range(known.range, digits),
        ]))
    });
    let columns = ["code", "name", "unit", "std", "lowest to highest"];
    let caption = "What each code stands for, the unit of its values, and how far these differ over all \
                   surfaces of the dataset.";
    let table = Table::new("properties", "Properties", columns, rows);
    table.about(caption).unless_empty()
}

/// How the intervals fared that came with estimates: a row for each property and one for all; none
/// where no method was given intervals.
fn intervals(results: &Results) -> Option<Table> {
    let methods = results.methods.iter();
    let given = methods.filter_map(|method| Some((method, method.intervals.as_ref()?)));
    let rows = given.flat_map(|(method, intervals)| interval_rows(results, method, intervals));
    let columns = ["Method", "Property", "held, %", "mean width", "width / std"];
    let caption = "The share of held-out readings that lie inside, and how wide the intervals are: in the \
                  property's own unit, and over the standard deviation of its values over all surfaces. All \
                  reruns together.";
    let title = "Intervals that came with estimates";
    let table = Table::new("intervals", title, columns, rows);
    table.about(caption).unless_empty()
}

fn interval_rows(results: &Results, method: &MethodResult, intervals: &GivenIntervals) -> Vec<Row> {
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

#[cfg(test)]
mod tests {
    use sps_dataset::Unit;

    use super::*;
    use crate::about_the_data;
    use crate::fixture::file;
    use sps_experiment::results::Described;

    fn results() -> Results {
        let mut results: Results = serde_json::from_value(file()).unwrap();
        results.dataset.training_surfaces = 290;
        results.methods[0].held_out_surfaces = 323;
        results.methods[0].held_out_units = 8;
        results.dataset.units = 8;
        results
    }

    #[test]
    fn a_row_says_on_how_much_it_stands() {
        let mut results = results();
        for (unit, cell, words) in [
            (None, "323 surfaces", "over surfaces"),
            (Some(Unit::Surface), "323 surfaces", "over surfaces"),
            (Some(Unit::Group), "8 groups, 323 surfaces", "over groups"),
            (
                Some(Unit::Material),
                "8 materials, 323 surfaces",
                "over materials",
            ),
        ] {
            results.dataset.unit = unit;
            let table = means::table(&results);
            assert_eq!(table.columns[..3], ["Method", "held out", "R²"]);
            let cells = table.rows[0].cells.iter().map(ToString::to_string);
            let cells: Vec<String> = cells.collect();
            assert_eq!(cells[..3], ["Ridge", cell, "0.500 [0.400, 0.600]"]);
            assert!(table.caption.contains(words), "{}", table.caption);
        }
        // Without a score it stands on nothing.
        results.methods[0].held_out_surfaces = 0;
        assert_eq!(means::table(&results).rows[0].cells[1].to_string(), "–");
    }

    #[test]
    fn errors_carry_the_unit_of_their_property() {
        let mut results = results();
        let described = |unit: &str, std| Described {
            unit: unit.to_owned(),
            std,
            ..Described::default()
        };
        results.described = [("fRS".to_owned(), described("N", 0.02))].into();
        results.methods[0].scores.mae = [("fRS".to_owned(), Some(0.012_34))].into();
        let table = per_property(&results, &MAE);
        assert_eq!(table.columns[1], "fRS [N]");
        assert_eq!(table.rows[0].cells[1].to_string(), "0.01234");
        assert!(
            means::table(&results)
                .columns
                .contains(&"MAE [N]".to_owned())
        );
        // Of several units there is no mean.
        results.properties.push("heat".to_owned());
        results
            .described
            .insert("heat".to_owned(), described("W", 1.0));
        let columns = means::table(&results).columns;
        assert!(!columns.iter().any(|column| column.starts_with("MAE [")));
        assert!(columns.contains(&"MAE / std".to_owned()));
    }

    #[test]
    fn training_and_held_out_surfaces_are_told_apart() {
        let mut results = results();
        let text = about_the_data(&results);
        assert!(text.contains("trains on 290 surfaces"), "{text}");
        assert!(text.contains("323 different ones"), "{text}");
        assert!(!text.contains("groups"), "{text}");
        results.dataset.unit = Some(Unit::Group);
        let text = about_the_data(&results);
        assert!(text.contains("lie in 8 groups"), "{text}");
    }
}
