//! The figure of selected roll angles: a fan for each property, method and rerun.

use std::fmt::Write;

use super::figures::Figure;
use crate::results::{MethodResult, Results};

/// Length of a ray in pixels.
const RAY: f64 = 40.0;
const CELL: (f64, f64) = (72.0, 56.0);
/// Left of the first column, and above the first row.
const MARGIN: (f64, f64) = (52.0, 58.0);
/// Between two methods.
const GAP: f64 = 22.0;
pub(super) const COLOURS: [&str; 6] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00",
];

/// The fans of the methods that learned which views to select; none where no method did.
pub(super) fn fan(results: &Results) -> Option<Figure> {
    let angles = &results.dataset.view_angles_deg;
    let methods: Vec<&MethodResult> = results.methods.iter().filter(|m| learned(m)).collect();
    let (first, last) = (angles.first()?, angles.last()?);
    let widest = methods.iter().map(|method| method.label.len()).max()?;
    let reruns = methods.iter().map(|method| method.reruns).max()?;
    // A column of one rerun must still hold the method's name.
    let block = (reruns as f64 * CELL.0).max(6.6 * widest as f64);
    let width = MARGIN.0 + methods.len() as f64 * (block + GAP);
    let height = MARGIN.1 + results.properties.len() as f64 * CELL.1 + 8.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
         width=\"{width:.0}\" height=\"{height:.0}\" font-family=\"system-ui, sans-serif\" \
         font-size=\"12\" fill=\"#1b1f24\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>"
    );
    for (row, property) in results.properties.iter().enumerate() {
        let apex = MARGIN.1 + (row as f64 + 1.0) * CELL.1 - 8.0;
        text(&mut svg, MARGIN.0 - 10.0, apex - 14.0, "end", property);
    }
    for (index, method) in methods.iter().enumerate() {
        let left = MARGIN.0 + index as f64 * (block + GAP);
        text(&mut svg, left, 18.0, "start", &method.label);
        for rerun in 0..method.reruns {
            let x = left + (rerun as f64 + 0.5) * CELL.0;
            text(&mut svg, x, 40.0, "middle", &format!("{}", rerun + 1));
            for (row, property) in results.properties.iter().enumerate() {
                let apex = (x, MARGIN.1 + (row as f64 + 1.0) * CELL.1 - 8.0);
                let views = method.selected_views.get(property);
                let views = views.and_then(|views| views.get(rerun));
                sector(&mut svg, apex, *first, *last);
                for &view in views.into_iter().flatten() {
                    if let Some(&angle) = angles.get(view) {
                        ray(&mut svg, apex, angle, COLOURS[index % COLOURS.len()]);
                    }
                }
            }
        }
    }
    svg.push_str("</svg>");
    Some(Figure {
        name: "selected-views",
        title: "Selected roll angles".to_owned(),
        caption: format!(
            "Each fan spans the dataset's views, from {first:.0} degrees on the left to \
             {last:.0} degrees on the right, with the view straight down upwards; its rays are \
             the views selected for one property (row) in one rerun (numbered columns). A darker \
             ray was selected more than once."
        ),
        svg,
    })
}

/// Whether a selector asked for more sets than the one that it picked.
fn learned(method: &MethodResult) -> bool {
    let mut selections = method.selections.values().flatten();
    selections.any(|selection| selection.evaluations > 1)
}

fn text(svg: &mut String, x: f64, y: f64, anchor: &str, words: &str) {
    let words = words
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;");
    let _ = write!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{words}</text>"
    );
}

/// Where the ray of an angle from the vertical ends.
fn tip((x, y): (f64, f64), degrees: f64, length: f64) -> (f64, f64) {
    let (sin, cos) = degrees.to_radians().sin_cos();
    (x + length * sin, y - length * cos)
}

fn sector(svg: &mut String, apex: (f64, f64), from: f64, to: f64) {
    let (a, b) = (tip(apex, from, RAY), tip(apex, to, RAY));
    let _ = write!(
        svg,
        "<path d=\"M{:.1} {:.1}L{:.1} {:.1}A{RAY} {RAY} 0 0 1 {:.1} {:.1}Z\" fill=\"#eef1f4\" \
         stroke=\"#c6ccd3\" stroke-width=\"0.7\"/>",
        apex.0, apex.1, a.0, a.1, b.0, b.1
    );
}

fn ray(svg: &mut String, apex: (f64, f64), degrees: f64, colour: &str) {
    let end = tip(apex, degrees, RAY);
    let _ = write!(
        svg,
        "<g opacity=\"0.6\"><line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" \
         stroke=\"{colour}\" stroke-width=\"1.8\"/><circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2.8\" \
         fill=\"{colour}\"><title>{degrees:.1}°</title></circle></g>",
        apex.0, apex.1, end.0, end.1, end.0, end.1
    );
}
