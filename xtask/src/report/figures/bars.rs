//! The figure of R² per property and method.

use kuva::plot::{BarPlot, LegendPosition};
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;

use super::{COLOURS, Figure, PAGE, plotted};
use crate::report::table::number;
use crate::results::Results;

/// More whiskers than those of so many methods hide the bars.
const MOST_WHISKERS: usize = 15;

fn caption(results: &Results, whiskers: bool) -> String {
    let cut = format!("Bars below {LOWEST_R2} are cut there; the table has their values.");
    if !whiskers {
        return cut;
    }
    format!("{cut} Whiskers are {}.", results.intervals_in_words())
}

/// Below this a bar is cut: one property that fails must not flatten all others.
const LOWEST_R2: f64 = -0.5;

pub(super) fn figure(results: &Results) -> Figure {
    let labels = results.methods.iter().map(|method| method.label.as_str());
    let mut bars = BarPlot::new()
        .with_legend(labels.collect())
        .with_width(0.86)
        .with_tooltips();
    let mut errors = Vec::new();
    let mut hover = Vec::new();
    for property in &results.properties {
        let mut group = Vec::new();
        for (index, method) in results.methods.iter().enumerate() {
            let value = method.scores.r2.get(property).copied().flatten();
            let interval = method.scores.r2_interval.get(property).copied().flatten();
            let shown = value.unwrap_or(0.0).max(LOWEST_R2);
            let [low, high] = interval.unwrap_or([shown; 2]);
            errors.push((
                (shown - low.max(LOWEST_R2)).max(0.0),
                (high - shown).max(0.0),
            ));
            hover.push(format!(
                "{}, {property}: R² {}",
                method.label,
                number(value, 2)
            ));
            group.push((shown, COLOURS[index % COLOURS.len()]));
        }
        bars = bars.with_group(property.as_str(), group);
    }
    let bars = bars.with_tooltip_labels(hover);
    let whiskers = results.methods.len() <= MOST_WHISKERS;
    let bars = if whiskers {
        bars.with_asymmetric_error(errors)
            .with_error_color("#777777")
            .with_error_cap_width(0.0)
    } else {
        bars
    };
    let plots = vec![Plot::Bar(bars)];
    let layout = Layout::auto_from_plots(&plots)
        .with_y_axis_max(1.0)
        .with_y_label("R²")
        .with_legend_position(LegendPosition::OutsideBottomColumns);
    Figure {
        name: "r2",
        title: "R² per property and method".to_owned(),
        caption: caption(results, whiskers),
        svg: plotted(plots, layout, (PAGE, 300.0)),
    }
}
