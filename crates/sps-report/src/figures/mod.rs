//! The figures of an experiment's report, as SVG: as wide as a column of a paper, or as both, with
//! letters that can be read there; a page shows them as large as it has room.

mod fan;
mod heat;
mod scatter;
mod speed_error;

use kuva::backend::svg::SvgBackend;
use kuva::plot::line::LinePlot;
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;
use kuva::render::render::{Primitive, Scene, render_multiple};
use sps_experiment::results::Results;

use super::{Estimates, calibration, learning, selection};

/// Pixels, of which 96 are an inch: 89 mm.
pub(super) const COLUMN: f64 = 336.0;
/// Both columns of a page and what is between them: 180 mm.
pub(super) const PAGE: f64 = 680.0;
/// Of letters, lines and gaps, to those of a screen.
const PRINT: f64 = 0.75;

/// Told apart by those who do not see all colours (Okabe and Ito 2008, but yellow and black, which a
/// page of the other brightness swallows; Tol's wine and a grey in their place).
pub(super) const COLOURS: [&str; 8] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#882255", "#777777",
];

/// A figure with the words around it.
#[derive(Clone, Debug)]
pub(crate) struct Figure {
    /// Names its file.
    pub name: &'static str,
    pub title: String,
    pub caption: String,
    pub svg: String,
}

/// The figures, in the order of the report; `estimates` are those of the methods whose single estimates are shown,
/// the best method first.
pub(crate) fn figures(results: &Results, estimates: &[Estimates<'_>]) -> Vec<Figure> {
    let mut figures = vec![heat::figure(results)];
    figures.extend(speed_error::figure(results));
    figures.extend(learning::figure(results));
    figures.extend(learning::training(results));
    figures.extend(fan::figure(results));
    figures.extend(selection::curves(results));
    let best = estimates.first();
    figures.extend(best.map(|best| scatter::figure(results, best)));
    figures.extend(calibration::figures(results, estimates));
    figures
}

/// The least and the largest of these values.
pub(super) fn span(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let none = [f64::INFINITY, f64::NEG_INFINITY];
    let wider = |[low, high]: [f64; 2], value: f64| [low.min(value), high.max(value)];
    values.into_iter().fold(none, wider)
}

/// A line through these points.
pub(super) fn line(
    points: impl IntoIterator<Item = (f64, f64)>,
    colour: &str,
    width: f64,
) -> LinePlot {
    let line = LinePlot::new().with_data(points);
    line.with_color(colour).with_stroke_width(width)
}

/// The line as that of number `index`: where colours come again, lines are broken, which the legend says
/// because it shows colours alone.
pub(super) fn told_apart(line: LinePlot, index: usize, label: &str) -> Plot {
    let line = line.with_color(COLOURS[index % COLOURS.len()]);
    Plot::Line(match index / COLOURS.len() {
        0 => line.with_legend(label),
        1 => line.with_dashed().with_legend(format!("{label} (dashed)")),
        _ => line.with_dotted().with_legend(format!("{label} (dotted)")),
    })
}

/// What stands for a text in SVG.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

/// One plot of this width and height.
pub(super) fn plotted(plots: Vec<Plot>, layout: Layout, (width, height): (f64, f64)) -> String {
    let layout = layout.with_width(width).with_height(height);
    svg(render_multiple(plots, layout.with_scale(PRINT)))
}

/// A drawing that can be shown at any size, as high as all that is in it: of a legend below the axes
/// the layout knows too little.
fn svg(mut scene: Scene) -> String {
    let bottoms = scene.elements.iter().map(|element| match element {
        Primitive::Rect { y, height, .. } => y + height + 1.0,
        Primitive::Text { y, .. } => y + 4.0,
        _ => 0.0,
    });
    scene.height = bottoms.fold(scene.height, f64::max);
    let view = format!(
        "<svg viewBox=\"0 0 {} {}\" ",
        scene.width.ceil(),
        scene.height.ceil()
    );
    let svg = SvgBackend::new().render_scene(&scene);
    svg.replacen("<svg ", &view, 1)
}
