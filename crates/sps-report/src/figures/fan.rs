//! The figure of selected roll angles: a fan for each property, method and rerun.

use std::fmt::Write;

use sps_experiment::results::{MethodResult, Results};

use super::{COLOURS, Figure, PAGE, escaped};

const RAY: f64 = 21.0;
const CELL: (f64, f64) = (38.0, 30.0);
/// Left of a block's first column, and above its first row.
const MARGIN: (f64, f64) = (30.0, 34.0);
/// Between the letters of a label.
const LETTER: f64 = 4.6;

/// A method's fans, and where they stand.
struct Block<'a> {
    method: &'a MethodResult,
    colour: &'static str,
    left: f64,
    top: f64,
}

/// The fans of the methods that learned which views to select; none where no method did.
pub(super) fn figure(results: &Results) -> Option<Figure> {
    let angles = &results.dataset.view_angles_deg;
    let ends @ [first, last] = [*angles.first()?, *angles.last()?];
    let height = MARGIN.1 + results.properties.len() as f64 * CELL.1;
    let blocks = blocks(results, height);
    let bottom = blocks.last()?.top + height + 4.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {PAGE} {bottom:.0}\" \
         width=\"{PAGE}\" height=\"{bottom:.0}\" font-family=\"system-ui, sans-serif\" \
         font-size=\"9\" fill=\"#1b1f24\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>"
    );
    for block in &blocks {
        block.draw(&mut svg, results, ends);
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

/// The methods side by side, in as many rows as they need.
fn blocks(results: &Results, height: f64) -> Vec<Block<'_>> {
    let (mut left, mut top) = (0.0, 0.0);
    let methods = results.methods.iter().filter(|method| learned(method));
    let blocks = methods.zip(COLOURS.into_iter().cycle());
    let blocks = blocks.map(|(method, colour)| {
        let fans = MARGIN.0 + method.reruns as f64 * CELL.0;
        // A column of one rerun must still hold the method's name.
        let width = fans.max(LETTER * (method.label.chars().count() + 3) as f64);
        if left > 0.0 && left + width > PAGE {
            (left, top) = (0.0, top + height + 12.0);
        }
        let block = Block {
            method,
            colour,
            left,
            top,
        };
        left += width;
        block
    });
    blocks.collect()
}

impl Block<'_> {
    fn draw(&self, svg: &mut String, results: &Results, ends: [f64; 2]) {
        let left = self.left + MARGIN.0;
        let (x, y) = (self.left + 4.0, self.top + 12.0);
        text(svg, x, y, "start", &self.method.label);
        for rerun in 0..self.method.reruns {
            let x = left + (rerun as f64 + 0.5) * CELL.0;
            text(svg, x, self.top + 26.0, "middle", &(rerun + 1).to_string());
        }
        for (row, property) in results.properties.iter().enumerate() {
            let y = self.top + MARGIN.1 + (row as f64 + 1.0) * CELL.1 - 6.0;
            text(svg, left - 4.0, y - 6.0, "end", property);
            let of_reruns = self.method.selected_views.get(property);
            for rerun in 0..self.method.reruns {
                let views = of_reruns.and_then(|views| views.get(rerun));
                let apex = (left + (rerun as f64 + 0.5) * CELL.0, y);
                sector(svg, apex, ends);
                let angles = views.into_iter().flatten();
                for angle in angles.filter_map(|&view| results.dataset.view_angles_deg.get(view)) {
                    ray(svg, apex, *angle, self.colour);
                }
            }
        }
    }
}

/// Whether a selector asked for more sets than the one that it picked.
fn learned(method: &MethodResult) -> bool {
    let mut selections = method.selections.values().flatten();
    selections.any(|selection| selection.evaluations > 1)
}

fn text(svg: &mut String, x: f64, y: f64, anchor: &str, words: &str) {
    let words = escaped(words);
    let _ = write!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{words}</text>"
    );
}

/// Where the ray of an angle from the vertical ends.
fn tip((x, y): (f64, f64), degrees: f64) -> (f64, f64) {
    let (sin, cos) = degrees.to_radians().sin_cos();
    (x + RAY * sin, y - RAY * cos)
}

fn sector(svg: &mut String, apex: (f64, f64), ends: [f64; 2]) {
    let [a, b] = ends.map(|degrees| tip(apex, degrees));
    let _ = write!(
        svg,
        "<path d=\"M{:.1} {:.1}L{:.1} {:.1}A{RAY} {RAY} 0 0 1 {:.1} {:.1}Z\" fill=\"#eef1f4\" \
         stroke=\"#c6ccd3\" stroke-width=\"0.5\"/>",
        apex.0, apex.1, a.0, a.1, b.0, b.1
    );
}

fn ray(svg: &mut String, apex: (f64, f64), degrees: f64, colour: &str) {
    let end = tip(apex, degrees);
    let _ = write!(
        svg,
        "<g opacity=\"0.6\"><line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" \
         stroke=\"{colour}\" stroke-width=\"1.1\"/><circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.7\" \
         fill=\"{colour}\"><title>{degrees:.1}°</title></circle></g>",
        apex.0, apex.1, end.0, end.1, end.0, end.1
    );
}
