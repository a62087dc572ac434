//! What a dataset holds, as SVG: the values of each property and the shares of its materials.

use kuva::backend::svg::SvgBackend;
use kuva::plot::{BoxPlot, LegendEntry, LegendPosition, LegendShape, PieLabelPosition, PiePlot};
use kuva::render::layout::Layout;
use kuva::render::palette::Palette;
use kuva::render::plots::Plot;
use kuva::render::render::render_multiple;
use sps_dataset::OTHER;
use sps_metrics::Moments;

use super::published::published;

const HERE: &str = "#0072b2";
const GREY: &str = "#bbbbbb";

/// A box per property; `values` holds each property's code and its value on every surface. Beside the
/// published ones where they are after the paper, else in standard deviations, for their units differ.
pub fn boxes(values: &[(String, Vec<f64>)], after_the_paper: bool) -> String {
    let mut boxes = BoxPlot::new().with_width(0.8);
    let mut colours = Vec::new();
    for (code, values) in values {
        colours.push(HERE);
        if !after_the_paper {
            boxes = boxes.with_group(code.as_str(), standardised(values));
            continue;
        }
        boxes = boxes.with_group(code.as_str(), values.iter().copied());
        // Five numbers are their own quantiles.
        let printed = published().quantiles.get(code);
        boxes = boxes.with_group("", printed.into_iter().flatten().copied());
        colours.push(GREY);
    }
    let plots = vec![Plot::Box(
        boxes
            .with_group_colors(colours)
            .with_strip(0.5)
            .with_overlay_color("rgba(0,0,0,0.3)")
            .with_overlay_size(1.0),
    )];
    let layout = Layout::auto_from_plots(&plots)
        .with_width(240.0 + 60.0 * values.len().max(4) as f64)
        .with_height(420.0)
        .with_title("Values over the surfaces; whiskers reach 1.5 boxes");
    let layout = if after_the_paper {
        layout
            .with_y_axis_min(0.0)
            .with_legend_box(false)
            .with_y_label("value, 0 to 100")
            .with_x_tick_rotate(0.0)
            .with_legend_entries(vec![entry("this dataset", HERE), entry("published", GREY)])
            .with_legend_position(LegendPosition::OutsideBottomColumns)
    } else {
        layout
            .with_y_label("standard deviations from the mean")
            .with_x_tick_rotate(-45.0)
    };
    SvgBackend::new().render_scene(&render_multiple(plots, layout))
}

/// Values less their mean, in standard deviations; 0 where they do not differ.
fn standardised(values: &[f64]) -> Vec<f64> {
    let moments: Moments = values.iter().copied().collect();
    let mean = moments.mean().unwrap_or_default();
    let std = moments.sample_std().ok().filter(|std| *std > 0.0);
    let scaled = |value: &f64| (value - mean) / std.unwrap_or(f64::INFINITY);
    values.iter().map(scaled).collect()
}

fn entry(label: &str, colour: &str) -> LegendEntry {
    LegendEntry {
        label: label.to_owned(),
        color: colour.to_owned(),
        shape: LegendShape::Rect,
        dasharray: None,
    }
}

/// A donut of `(label, surfaces)`, in that order from the top, clockwise.
pub fn donut(materials: &[(String, usize)]) -> String {
    let colours = Palette::tol_muted();
    let total: usize = materials.iter().map(|(_, count)| count).sum();
    let mut donut = PiePlot::new()
        .with_inner_radius(80.0)
        .with_label_position(PieLabelPosition::Outside)
        .with_min_label_fraction(0.0)
        .with_tooltips();
    for (index, (label, count)) in materials.iter().enumerate() {
        let share = 100.0 * *count as f64 / total.max(1) as f64;
        let own = &colours[index % colours.len()];
        let colour = if label == OTHER { GREY } else { own };
        let label = format!("{label} {share:.1} %");
        donut = donut.with_slice(label, *count as f64, colour);
    }
    let plots = vec![Plot::Pie(donut)];
    let layout = Layout::auto_from_plots(&plots)
        .with_width(800.0)
        .with_height(480.0)
        .with_title("Surfaces by material");
    SvgBackend::new().render_scene(&render_multiple(plots, layout))
}
