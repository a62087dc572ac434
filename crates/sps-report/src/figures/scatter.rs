//! The figure of estimated against measured values of the best method.

use kuva::plot::ScatterPlot;
use kuva::render::figure::Figure as Grid;
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;
use sps_experiment::predictions::Prediction;
use sps_experiment::results::Results;
use sps_experiment::text::number;

use super::{COLUMN, Figure, PAGE, line, span, svg};
use crate::Estimates;

/// Between panels, and around them.
const SPACING: f64 = 4.0;
const PADDING: f64 = 8.0;

/// Points of a panel: more hide one another, and make a page that is slow to open.
const MOST_POINTS: usize = 400;

pub(super) fn figure(results: &Results, best: &Estimates<'_>) -> Figure {
    let method = best.method;
    let panels = results.properties.iter().map(|property| {
        let points = best.predictions.iter().copied();
        let points: Vec<_> = points.filter(|one| one.property == *property).collect();
        let step = points.len().div_ceil(MOST_POINTS).max(1);
        let points: Vec<&Prediction> = points.into_iter().step_by(step).collect();
        let r2 = method.scores.r2.get(property).copied().flatten();
        panel(&format!("{property}, R² {}", number(r2, 2)), &points)
    });
    let (plots, layouts): (Vec<_>, Vec<_>) = panels.unzip();
    let columns = results.properties.len().clamp(1, 5);
    let width = if columns == 1 {
        COLUMN
    } else {
        (PAGE - 2.0 * PADDING - SPACING * (columns - 1) as f64) / columns as f64
    };
    let grid = Grid::new(results.properties.len().div_ceil(columns), columns)
        .with_plots(plots)
        .with_layouts(layouts)
        .with_spacing(SPACING)
        .with_padding(PADDING)
        .with_cell_size(width, width);
    Figure {
        name: "estimated-against-measured",
        title: format!("Estimated against measured: {}", method.label),
        caption: format!(
            "Held-out surfaces of all reruns, at most {MOST_POINTS} of them, evenly picked. The \
             dashed line is a perfect estimate. Of the methods that look at a photograph this one has \
             the highest mean R²."
        ),
        svg: svg(grid.render()),
    }
}

fn panel(title: &str, points: &[&Prediction]) -> (Vec<Plot>, Layout) {
    let values = points.iter().flat_map(|p| [p.truth, p.estimate]);
    let [low, high] = match span(values) {
        [low, high] if low < high => [low, high],
        [low, _] => [low - 1.0, low + 1.0],
    };
    let dots = ScatterPlot::new()
        .with_data(points.iter().map(|p| (p.truth, p.estimate)))
        .with_color("#0072b2")
        .with_size(1.4)
        .with_marker_opacity(0.55)
        .with_tooltips()
        .with_tooltip_labels(points.iter().map(|p| {
            format!(
                "{}: measured {:.1}, estimated {:.1}",
                p.surface, p.truth, p.estimate
            )
        }));
    let perfect = line([(low, low), (high, high)], "#888888", 1.0);
    let plots = vec![Plot::Line(perfect.with_dashed()), Plot::Scatter(dots)];
    let layout = Layout::auto_from_plots(&plots)
        .with_title(title)
        .with_scale(0.6)
        .with_x_label("measured")
        .with_y_label("estimated")
        .with_ticks(3);
    (plots, layout)
}
