//! The table that a report begins with: a row for each method, with means over its properties.

use sps_dataset::Unit;
use sps_experiment::paper::PaperRow;
use sps_experiment::results::{MethodResult, Results};
use sps_experiment::text::counted;

use super::speed;
use super::summary;
use super::table::{Cell, Row, Table};
use super::tables::{gained, printed, with_unit};

/// A column of the table of means: what was measured, what the paper prints if it does, and for which
/// data it means something.
struct Mean {
    title: &'static str,
    measured: fn(&MethodResult) -> Cell,
    printed: Option<fn(&PaperRow) -> Cell>,
    shown: fn(&Results) -> bool,
}

const MEANS: [Mean; 7] = [
    Mean {
        title: "R²",
        measured: |method| Cell::interval(method.means.r2_mean, method.means.r2_mean_interval, 3),
        printed: Some(|row| Cell::number(Some(row.r2_mean), 2)),
        shown: |_| true,
    },
    Mean {
        title: "R² about own mean",
        measured: |method| {
            let means = &method.means;
            Cell::interval(means.r2_own_mean_mean, means.r2_own_mean_mean_interval, 3)
        },
        printed: None,
        shown: |results| results.dataset.holds_out_groups(),
    },
    Mean {
        title: "MAE",
        measured: |method| Cell::number(method.means.mae_mean, 2),
        printed: Some(|row| Cell::number(Some(row.mae_mean), 2)),
        shown: |results| results.shared_unit().is_some(),
    },
    Mean {
        title: "MAE / std",
        measured: |method| Cell::number(method.means.mae_over_std_mean, 3),
        printed: None,
        shown: |_| true,
    },
    Mean {
        title: "Spearman",
        measured: |method| Cell::number(method.means.spearman_mean, 3),
        printed: None,
        shown: |_| true,
    },
    Mean {
        title: "% error",
        measured: |method| Cell::number(method.means.median_percent_error_mean, 1),
        printed: Some(|row| Cell::number(Some(row.median_percent_error_mean), 1)),
        shown: Results::has_percentages,
    },
    Mean {
        title: "% error, top 8",
        measured: |method| Cell::number(method.means.median_percent_error_top8, 1),
        printed: Some(|row| Cell::number(Some(row.median_percent_error_top8), 1)),
        shown: Results::has_top8,
    },
];

pub(super) fn table(results: &Results) -> Table {
    let methods = &results.methods;
    let compared =
        results.dataset.is_after_the_paper() && methods.iter().any(|method| method.paper.is_some());
    let shown: Vec<&Mean> = MEANS.iter().filter(|mean| (mean.shown)(results)).collect();
    let mut columns = vec!["Method".to_owned(), "held out".to_owned()];
    for mean in &shown {
        let unit = match mean.title {
            "MAE" => results.shared_unit().unwrap_or_default(),
            _ => "",
        };
        columns.push(with_unit(mean.title, unit));
        let printed = mean.printed.filter(|_| compared);
        columns.extend(printed.map(|_| "paper".to_owned()));
    }
    columns.push("ms per surface".to_owned());
    let against = results.compared_with();
    let gained_on = |other: &&MethodResult| format!("R² gained on {}", other.label);
    columns.extend(against.iter().map(gained_on));
    let rows = methods.iter().enumerate().map(|(at, method)| {
        let paper = printed(results, method);
        let mut cells = vec![method.label.as_str().into(), held_out(results, method)];
        for mean in &shown {
            cells.push((mean.measured)(method));
            let printed = mean.printed.filter(|_| compared);
            let nothing = || Cell::number(None, 0);
            cells.extend(printed.map(|printed| paper.map_or_else(nothing, printed)));
        }
        cells.push(speed::in_milliseconds(
            method.costs.predict_seconds_per_surface,
        ));
        let gains = &method.gains.r2_mean_gains;
        cells.extend(against.iter().map(|other| gained(gains.get(&other.id), 3)));
        Row {
            mark: summary::mark(results, at),
            ..Row::measured(cells)
        }
    });
    Table::new("means", "Means over properties", columns, rows).about(caption(results, compared))
}

/// How much a row stands on.
fn held_out(results: &Results, method: &MethodResult) -> Cell {
    let surfaces = method.held_out_surfaces;
    if surfaces == 0 {
        return Cell::number(None, 0);
    }
    let surfaces = counted(surfaces, "surface");
    match results.dataset.unit {
        Some(unit @ (Unit::Group | Unit::Material)) => {
            let units = counted(method.held_out_units, unit.name());
            format!("{units}, {surfaces}").into()
        }
        Some(Unit::Surface) | None => surfaces.into(),
    }
}

fn caption(results: &Results, compared: bool) -> String {
    let percent = if results.has_percentages() {
        " % error, the median absolute percentage error;"
    } else {
        ""
    };
    let mut caption = format!(
        "R² about the mean of the training part; MAE, the mean absolute error, in the properties' own \
         units, and over the standard deviation of a property's values over all surfaces; Spearman's \
         rank correlation;{percent} means over reruns and properties. Held out are the \
         different surfaces that a row is scored on, all reruns together. ms are those of an \
         estimate, with decoding or rendering. In brackets: {}, paired for differences.",
        results.intervals_in_words()
    );
    if results.test_per_training.is_some() && !results.against.is_empty() {
        caption.push_str(
            " ▲ and ▼ mark differences that are clear of 0 after Holm's correction for how many \
             this table has.",
        );
    }
    if results.dataset.holds_out_groups() {
        caption.push_str(
            " R² about own mean is about the mean of the surfaces held out: where they differ from those \
             trained on as a whole, guessing the training mean has 0 by the first and less by this.",
        );
    }
    if compared {
        caption.push_str(" Columns headed \"paper\" are the printed values.");
    }
    caption
}
