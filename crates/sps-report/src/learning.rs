//! How methods learn: R² against the number of training surfaces, for those that were trained on several
//! numbers, and the loss of networks, epoch by epoch.

use std::collections::{BTreeMap, BTreeSet};

use kuva::plot::LegendPosition;
use kuva::plot::line::LinePlot;
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;
use sps_experiment::results::{MethodResult, Number, PerProperty, Results};

use super::figures::{Figure, PAGE, line, plotted, told_apart};
use super::table::{Cell, Row, Table};

/// One method, by the number of surfaces that it was trained on.
struct Curve<'a> {
    label: &'a str,
    points: BTreeMap<usize, &'a MethodResult>,
}

/// The methods that differ in their training surfaces alone, in the order of the report.
fn curves(results: &Results) -> Vec<Curve<'_>> {
    let mut curves: Vec<Curve<'_>> = Vec::new();
    for method in &results.methods {
        let surfaces = method.training_surfaces;
        let Some(label) = base_label(method) else {
            continue;
        };
        match curves.iter_mut().find(|curve| curve.label == label) {
            Some(curve) => {
                curve.points.insert(surfaces, method);
            }
            None => curves.push(Curve {
                label,
                points: BTreeMap::from([(surfaces, method)]),
            }),
        }
    }
    curves.retain(|curve| curve.points.len() > 1);
    curves
}

/// The label without the number that a sweep has put at its end.
fn base_label(method: &MethodResult) -> Option<&str> {
    let swept = format!(", {} training surfaces", method.training_surfaces);
    method.label.strip_suffix(&swept)
}

/// What a perfect reader of the images would reach, of each property and on average; no mean where a
/// property has no ceiling.
pub(super) fn ceilings(results: &Results) -> [(&'static str, &PerProperty<f64>, Number); 2] {
    let data = &results.dataset;
    let ceilings = [
        ("Ceiling, one view", &data.ceiling_one_view),
        ("Ceiling, all views", &data.ceiling_all_views),
    ];
    ceilings.map(|(label, ceiling)| {
        let values = results.properties.iter().map(|code| ceiling.get(code));
        let mean = values.sum::<Option<f64>>();
        let mean = mean.map(|sum| sum / results.properties.len() as f64);
        (label, ceiling, mean)
    })
}

/// Mean R² with its interval; none where every method has one number of training surfaces.
pub(super) fn table(results: &Results) -> Option<Table> {
    let curves = curves(results);
    let numbers = curves.iter().flat_map(|c| c.points.keys().copied());
    let numbers: BTreeSet<usize> = numbers.collect();
    if curves.is_empty() {
        return None;
    }
    let mut columns = vec!["Method".to_owned()];
    columns.extend(numbers.iter().map(usize::to_string));
    let row = |curve: &Curve<'_>| {
        let cell = |surfaces: &usize| {
            let method = curve.points.get(surfaces);
            let interval = method.and_then(|m| m.means.r2_mean_interval);
            Cell::interval(method.and_then(|m| m.means.r2_mean), interval, 3)
        };
        let label = [Cell::from(curve.label)].into_iter();
        Row::measured(label.chain(numbers.iter().map(cell)).collect())
    };
    let ceilings = ceilings(results).into_iter();
    let ceilings = ceilings.filter_map(|(label, _, mean)| {
        let cells = numbers.iter().map(|_| Cell::number(mean, 3));
        let cells = [Cell::from(label)].into_iter().chain(cells).collect();
        mean.map(|_| Row::reference(cells))
    });
    let rows = curves.iter().map(row).chain(ceilings);
    let caption = format!(
        "R² against training surfaces: the mean over the properties, with {}. A \
         ceiling is what a perfect reader of the images would reach.",
        results.intervals_in_words()
    );
    Some(Table::new("learning-curves", "Learning curves", columns, rows).about(caption))
}

/// Where a method lies, and how far its interval reaches below and above.
fn point(surfaces: usize, method: &MethodResult) -> Option<((f64, f64), (f64, f64))> {
    let r2 = method.means.r2_mean?;
    let [low, high] = method.means.r2_mean_interval.unwrap_or([r2; 2]);
    Some(((surfaces as f64, r2), (r2 - low, high - r2)))
}

/// The same, drawn; none where every method has one number of training surfaces.
pub(super) fn figure(results: &Results) -> Option<Figure> {
    let curves = curves(results);
    let numbers = || curves.iter().flat_map(|curve| curve.points.keys());
    let (least, most) = (*numbers().min()? as f64, *numbers().max()? as f64);
    let mut plots: Vec<Plot> = Vec::new();
    for (index, curve) in curves.iter().enumerate() {
        let points = curve.points.iter();
        let (points, whiskers): (Vec<_>, Vec<_>) = points
            .filter_map(|(&surfaces, method)| point(surfaces, method))
            .unzip();
        let line = LinePlot::new()
            .with_data(points)
            .with_y_err_asymmetric(whiskers)
            .with_stroke_width(1.8);
        plots.push(told_apart(line, index, curve.label));
    }
    for (label, _, mean) in ceilings(results) {
        let Some(value) = mean else { continue };
        let line = line([(least, value), (most, value)], "#555555", 1.4);
        let line = if label.ends_with("one view") {
            line.with_dashed()
        } else {
            line.with_dotted()
        };
        plots.push(Plot::Line(line.with_legend(label)));
    }
    let layout = Layout::auto_from_plots(&plots)
        .with_log_x()
        .with_x_axis_min(0.8 * least)
        .with_x_axis_max(1.25 * most)
        .with_x_label("training surfaces")
        .with_y_label("R², mean over properties")
        .with_legend_box(false)
        .with_legend_position(LegendPosition::OutsideBottomColumns);
    Some(Figure {
        name: "learning",
        title: "R² against training surfaces".to_owned(),
        caption: format!(
            "Mean over properties, with {}. The ceilings are what a \
             perfect reader of the images would reach.",
            results.intervals_in_words()
        ),
        svg: plotted(plots, layout, (PAGE, 320.0)),
    })
}

/// The loss of each network's estimates in training; none where no network was trained.
pub(super) fn training(results: &Results) -> Option<Figure> {
    let trained = results.methods.iter();
    let trained = trained.filter(|method| !method.training_losses.is_empty());
    let mut plots: Vec<Plot> = Vec::new();
    for (index, method) in trained.enumerate() {
        let epochs = (1_u32..).map(f64::from);
        let line = LinePlot::new()
            .with_data(epochs.zip(method.training_losses.iter().copied()))
            .with_stroke_width(1.4);
        plots.push(told_apart(line, index, &method.label));
    }
    if plots.is_empty() {
        return None;
    }
    let layout = Layout::auto_from_plots(&plots)
        .with_y_axis_min(0.0)
        .with_x_label("epoch")
        .with_y_label("squared error in training")
        .with_legend_box(false)
        .with_legend_position(LegendPosition::OutsideBottomColumns);
    Some(Figure {
        name: "training",
        title: "How networks were trained".to_owned(),
        caption: "Mean squared error of the estimates in training, in units of the readings' variance, over \
                  all properties and reruns."
            .to_owned(),
        svg: plotted(plots, layout, (PAGE, 320.0)),
    })
}
