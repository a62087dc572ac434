//! The figure of speed against error, with the front.

use std::collections::BTreeSet;

use kuva::plot::line::LinePlot;
use kuva::plot::scatter::MarkerShape;
use kuva::plot::{LegendPosition, ScatterPlot};
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;
use sps_experiment::results::speed::{Point, front, looking};
use sps_experiment::results::{MethodResult, Results};
use sps_experiment::text::number;

use super::{COLOURS, Figure, PAGE, plotted, span};
use crate::table::with_interval;

/// The methods in the plane of time and error; none where fewer than two look at a photograph.
pub(super) fn figure(results: &Results) -> Option<Figure> {
    let points = looking(&results.methods);
    if points.len() < 2 {
        return None;
    }
    let mut plots = vec![Plot::Line(staircase(&points))];
    let (key, value) = key(points.iter().map(|point| &results.methods[point.method]));
    plots.extend(marks(results, &points, value));
    let layout = along(Layout::auto_from_plots(&plots), &points)
        .with_y_axis_max(highest(results, &points))
        .with_x_label("milliseconds per surface")
        .with_y_label("error, 1 - R²")
        .with_legend_position(LegendPosition::InsideTopRight);
    Some(Figure {
        name: "speed-error",
        title: "Speed against error".to_owned(),
        caption: format!(
            "One mark for each method that looks at a photograph, a colour for each {}; circles are \
             heads, squares ridge regressions, triangles other kinds, stars stop when they are sure \
             enough. Whiskers are {}. Down and left is better. The line is \
             the front: what lies above and right of it is slower and worse than a setting on it. \
             A mark in the HTML report says its name where one points at it.",
            key,
            results.intervals_in_words()
        ),
        svg: plotted(plots, layout, (PAGE, 400.0)),
    })
}

/// Times that lie far apart stand on a logarithmic axis.
fn along(layout: Layout, points: &[Point]) -> Layout {
    let [least, most] = span(points.iter().map(|point| 1e3 * point.seconds));
    let between = layout
        .with_x_axis_min(0.8 * least)
        .with_x_axis_max(1.25 * most);
    if most > 4.0 * least {
        between.with_log_x()
    } else {
        between
    }
}

/// Above all whiskers, with room for the legend.
fn highest(results: &Results, points: &[Point]) -> f64 {
    let ends = points.iter().flat_map(|point| interval(results, point));
    let [low, high] = span(ends.map(|r2| 1.0 - r2));
    high + 0.25 * (high - low)
}

fn interval(results: &Results, point: &Point) -> [f64; 2] {
    let interval = results.methods[point.method].means.r2_mean_interval;
    interval.unwrap_or([1.0 - point.error; 2])
}

/// What colours stand for, and its value of a method: encoders; where there are more than colours, what they
/// compute in; where there is but one, kinds of estimators.
fn key<'m>(methods: impl Iterator<Item = &'m MethodResult>) -> (&'static str, Value) {
    let encoders: BTreeSet<&str> = methods.map(|method| method.encoder.as_str()).collect();
    match encoders.len() {
        0 | 1 => ("kind of estimator", |method| &method.kind),
        several if several <= COLOURS.len() => ("encoder", |method| &method.encoder),
        _ => ("precision", |method| &method.precision),
    }
}

type Value = fn(&MethodResult) -> &str;

/// From each point of the front right to the next, then down to it.
fn staircase(points: &[Point]) -> LinePlot {
    let slowest = points.iter().map(|point| point.seconds).fold(0.0, f64::max);
    let mut line: Vec<(f64, f64)> = Vec::new();
    for point in front(points) {
        if let Some(&(_, error)) = line.last() {
            line.push((1e3 * point.seconds, error));
        }
        line.push((1e3 * point.seconds, point.error));
    }
    if let Some(&(_, error)) = line.last() {
        line.push((1e3 * slowest, error));
    }
    super::line(line, "#555555", 1.0).with_dashed()
}

fn marks(results: &Results, points: &[Point], value: Value) -> Vec<Plot> {
    let method = |point: &Point| &results.methods[point.method];
    let mut values: Vec<&str> = Vec::new();
    for value in points.iter().map(|point| value(method(point))) {
        if !values.contains(&value) {
            values.push(value);
        }
    }
    let mut plots = Vec::new();
    for (words, colour) in values.into_iter().zip(COLOURS.into_iter().cycle()) {
        let mut legend = Some(words);
        for shape in SHAPES {
            let alike =
                |point: &&Point| value(method(point)) == words && marker(method(point)) == shape;
            let alike: Vec<&Point> = points.iter().filter(alike).collect();
            if alike.is_empty() {
                continue;
            }
            let plot = scattered(results, &alike)
                .with_color(colour)
                .with_marker(shape);
            plots.push(Plot::Scatter(match legend.take() {
                Some(words) => plot.with_legend(words),
                None => plot,
            }));
        }
    }
    plots
}

/// Points with their intervals and names.
fn scattered(results: &Results, points: &[&Point]) -> ScatterPlot {
    let whisker = |point: &&Point| {
        let (r2, [low, high]) = (1.0 - point.error, interval(results, point));
        (high - r2, r2 - low)
    };
    ScatterPlot::new()
        .with_data(points.iter().map(|p| (1e3 * p.seconds, p.error)))
        .with_y_err_asymmetric(points.iter().map(whisker))
        .with_size(4.0)
        .with_marker_opacity(0.85)
        .with_tooltips()
        .with_tooltip_labels(points.iter().map(|point| hover(results, point)))
}

const SHAPES: [MarkerShape; 4] = [
    MarkerShape::Circle,
    MarkerShape::Square,
    MarkerShape::Triangle,
    MarkerShape::Star,
];

fn marker(method: &MethodResult) -> MarkerShape {
    match (&method.adaptive, method.kind.as_str()) {
        (Some(_), _) => MarkerShape::Star,
        (None, "ridge") => MarkerShape::Square,
        (None, "head") => MarkerShape::Circle,
        (None, _) => MarkerShape::Triangle,
    }
}

fn hover(results: &Results, point: &Point) -> String {
    let method = &results.methods[point.method];
    format!(
        "{}: {} ms, R² {}",
        method.label,
        number(Some(1e3 * point.seconds), 2),
        with_interval(method.means.r2_mean, method.means.r2_mean_interval, 3)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_never_stand_for_two_things() {
        let methods = |encoders: usize| -> Vec<MethodResult> {
            let method = |at: usize| MethodResult {
                encoder: format!("encoder {}", at % encoders),
                ..MethodResult::default()
            };
            (0..20).map(method).collect()
        };
        for (encoders, expected) in [(1, "kind of estimator"), (8, "encoder"), (9, "precision")] {
            assert_eq!(key(methods(encoders).iter()).0, expected, "{encoders}");
        }
    }
}
