//! The figures of an experiment's report, as SVG.

use kuva::backend::svg::SvgBackend;
use kuva::plot::line::LinePlot;
use kuva::plot::{BarPlot, LegendPosition, ScatterPlot};
use kuva::render::figure::Figure as Grid;
use kuva::render::layout::Layout;
use kuva::render::palette::Palette;
use kuva::render::plots::Plot;
use kuva::render::render::render_multiple;
use serde::Serialize;

use super::predictions::Prediction;
use super::table::number;
use crate::results::{MethodResult, Results};

/// A figure with the words around it.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Figure {
    /// Names its file.
    pub name: &'static str,
    pub title: String,
    pub caption: String,
    pub svg: String,
}

/// The figures, in the order of the report.
pub(crate) fn figures(results: &Results, predictions: &[Prediction]) -> Vec<Figure> {
    let mut figures: Vec<Figure> = super::speed::figure(results).into_iter().collect();
    figures.extend(super::learning::figure(results));
    figures.push(r2_bars(results));
    figures.extend(super::fan::fan(results));
    figures.extend(super::selection::curves(results));
    figures.extend(best(results).map(|method| scatter(results, method, predictions)));
    figures
}

fn best(results: &Results) -> Option<&MethodResult> {
    let scored = results.methods.iter().filter(|m| m.means.r2_mean.is_some());
    scored.max_by(|a, b| {
        a.means
            .r2_mean
            .partial_cmp(&b.means.r2_mean)
            .unwrap_or(std::cmp::Ordering::Equal)
    })
}

/// Below this a bar is cut: one property that fails must not flatten all others.
const LOWEST_R2: f64 = -0.5;

fn r2_bars(results: &Results) -> Figure {
    let colours = Palette::okabe_ito();
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
            group.push((shown, colours[index % colours.len()].to_owned()));
        }
        bars = bars.with_group(property.as_str(), group);
    }
    let bars = bars
        .with_asymmetric_error(errors)
        .with_tooltip_labels(hover);
    let plots = vec![Plot::Bar(bars)];
    let width = 260.0 + 76.0 * (results.properties.len() as f64).max(4.0);
    let layout = Layout::auto_from_plots(&plots)
        .with_width(width)
        .with_height(380.0)
        .with_y_axis_max(1.0)
        .with_y_label("R²")
        .with_legend_position(LegendPosition::OutsideBottomColumns);
    Figure {
        name: "r2",
        title: "R² per property and method".to_owned(),
        caption: format!(
            "Whiskers are {:.0} % bootstrap intervals over {}. Bars and whiskers below \
             {LOWEST_R2} are cut there; the table has their values.",
            100.0 * results.interval_level,
            results.dataset.units_in_words()
        ),
        svg: SvgBackend::new().render_scene(&render_multiple(plots, layout)),
    }
}

/// Points of a panel: more hide one another, and make a page that is slow to open.
const MOST_POINTS: usize = 400;

fn scatter(results: &Results, method: &MethodResult, predictions: &[Prediction]) -> Figure {
    let of_method = |property: &str| {
        let all: Vec<&Prediction> = predictions
            .iter()
            .filter(|prediction| prediction.method == method.id && prediction.property == property)
            .collect();
        let step = all.len().div_ceil(MOST_POINTS).max(1);
        all.into_iter().step_by(step).collect::<Vec<_>>()
    };
    let panels = results.properties.iter().map(|property| {
        let points = of_method(property);
        let r2 = method.scores.r2.get(property).copied().flatten();
        panel(&format!("{property}, R² {}", number(r2, 2)), &points)
    });
    let (plots, layouts): (Vec<_>, Vec<_>) = panels.unzip();
    let columns = results.properties.len().clamp(1, 5);
    let (width, height) = if columns == 1 {
        (460.0, 430.0)
    } else {
        (230.0, 215.0)
    };
    let grid = Grid::new(results.properties.len().div_ceil(columns), columns)
        .with_plots(plots)
        .with_layouts(layouts)
        .with_cell_size(width, height);
    Figure {
        name: "estimated-against-measured",
        title: format!("Estimated against measured: {}", method.label),
        caption: format!(
            "Held-out surfaces of all reruns, at most {MOST_POINTS} of them, evenly picked. The \
             dashed line is a perfect estimate. This is the method with the highest mean R²."
        ),
        svg: SvgBackend::new().render_scene(&grid.render()),
    }
}

fn panel(title: &str, points: &[&Prediction]) -> (Vec<Plot>, Layout) {
    let values = points.iter().flat_map(|p| [p.truth, p.estimate]);
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    let (low, high) = if low < high {
        (low, high)
    } else {
        (low - 1.0, low + 1.0)
    };
    let dots = ScatterPlot::new()
        .with_data(points.iter().map(|p| (p.truth, p.estimate)))
        .with_color("#0072b2")
        .with_size(2.2)
        .with_marker_opacity(0.55)
        .with_tooltips()
        .with_tooltip_labels(points.iter().map(|p| {
            format!(
                "{}: measured {:.1}, estimated {:.1}",
                p.surface, p.truth, p.estimate
            )
        }));
    let perfect = LinePlot::new()
        .with_data(vec![(low, low), (high, high)])
        .with_color("#888888")
        .with_stroke_width(1.0)
        .with_dashed();
    let plots = vec![Plot::Line(perfect), Plot::Scatter(dots)];
    let layout = Layout::auto_from_plots(&plots)
        .with_title(title)
        .with_title_size(13)
        .with_label_size(11)
        .with_x_label("measured")
        .with_y_label("estimated")
        .with_tick_size(10)
        .with_ticks(4);
    (plots, layout)
}
