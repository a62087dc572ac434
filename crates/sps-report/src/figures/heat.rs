//! The figure of R² per property and method: a table of coloured cells.

use sps_experiment::results::{MethodResult, Results};
use sps_experiment::text::number;

use super::{Figure, PAGE, escaped};

const ROW: f64 = 15.0;
const LABELS: f64 = 190.0;
/// Letters of a label that fit on its line.
const LETTERS: usize = 40;

pub(super) fn figure(results: &Results) -> Figure {
    Figure {
        name: "r2",
        title: "R² per property and method".to_owned(),
        caption: "The darker the blue, the more of a property is explained; orange is worse than the mean of the \
                  training part. The first column is the mean. A table below has the same numbers."
            .to_owned(),
        svg: svg(results),
    }
}

fn svg(results: &Results) -> String {
    let columns = results.properties.len() + 1;
    let column = ((PAGE - LABELS) / columns as f64).clamp(24.0, 60.0);
    let (head, names) = names(results, column);
    let (width, height) = (
        (LABELS + column * columns as f64).ceil(),
        (head + ROW * results.methods.len() as f64).ceil() + 2.0,
    );
    let rows = results.methods.iter().enumerate();
    let rows = rows.map(|(at, method)| row(results, method, column, head + ROW * at as f64));
    let rows: String = rows.collect();
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         height=\"{height}\" font-family=\"sans-serif\" font-size=\"8.5\"><rect width=\"{width}\" \
         height=\"{height}\" fill=\"#fff\"/>{names}{rows}</svg>"
    )
}

/// The height of the head, and the names of the columns in it. Names longer than codes stand upright.
fn names(results: &Results, column: f64) -> (f64, String) {
    let names = results.properties.iter().map(String::as_str);
    let longest = names.clone().map(|name| name.chars().count()).max();
    let longest = longest.unwrap_or(0) as f64;
    let upright = longest * 5.0 > column;
    let head = if upright { longest * 4.6 + 8.0 } else { ROW };
    let text = |(at, name): (usize, &str)| {
        let (x, y) = (LABELS + column * (at as f64 + 0.5), head - 4.0);
        let turned = if upright {
            format!("transform=\"rotate(-90 {x} {y}) translate(0 3)\"")
        } else {
            "text-anchor=\"middle\"".to_owned()
        };
        format!(
            "<text x=\"{x}\" y=\"{y}\" {turned}>{}</text>",
            escaped(name)
        )
    };
    let all = ["mean"].into_iter().chain(names);
    (head, all.enumerate().map(text).collect())
}

/// A method: its label, its mean and the value of each property.
fn row(results: &Results, method: &MethodResult, column: f64, y: f64) -> String {
    let of_property = |name| method.scores.r2.get(name).copied().flatten();
    let values = results.properties.iter().map(of_property);
    let values = [method.means.r2_mean].into_iter().chain(values);
    let cell = |(at, value): (usize, Option<f64>)| {
        let x = LABELS + column * at as f64;
        let (fill, ink) = colours(value);
        format!(
            "<rect x=\"{x}\" y=\"{y}\" width=\"{}\" height=\"{}\" fill=\"{fill}\"/><text x=\"{}\" \
             y=\"{}\" text-anchor=\"middle\" fill=\"{ink}\">{}</text>",
            column - 1.0,
            ROW - 1.0,
            x + column / 2.0,
            y + 10.5,
            number(value, 2)
        )
    };
    label(&method.label, y) + &values.enumerate().map(cell).collect::<String>()
}

/// Of a cell and of the number in it. Blue from 0 to 1; orange from 0 down to -0.5.
fn colours(value: Option<f64>) -> (String, &'static str) {
    let Some(value) = value else {
        return ("#f0f0f0".to_owned(), "#555");
    };
    let (share, [r, g, b]) = if value < 0.0 {
        ((-2.0 * value).min(1.0), [213.0, 94.0, 0.0])
    } else {
        (value.min(1.0), [0.0, 90.0, 150.0])
    };
    let mixed = [r, g, b].map(|end: f64| (255.0 + (end - 255.0) * share).round() as u8);
    let ink = if share > 0.55 { "#fff" } else { "#111" };
    (
        format!("#{:02x}{:02x}{:02x}", mixed[0], mixed[1], mixed[2]),
        ink,
    )
}

/// On one line or, cut between words, on two.
fn label(label: &str, y: f64) -> String {
    let letters = label.chars().count();
    let spaces = label.match_indices(' ').map(|(at, _)| at);
    let middle = spaces.min_by_key(|at| at.abs_diff(label.len() / 2));
    let text = |text: &str, y: f64, size: f64| {
        let x = LABELS - 5.0;
        format!(
            "<text x=\"{x}\" y=\"{y}\" text-anchor=\"end\" font-size=\"{size}\">{}</text>",
            escaped(text)
        )
    };
    match middle {
        Some(at) if letters > LETTERS => {
            text(&label[..at], y + 6.5, 7.0) + &text(&label[at + 1..], y + 13.5, 7.0)
        }
        _ => text(label, y + 10.5, 8.5),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_go_from_orange_through_white_to_blue() {
        assert_eq!(colours(Some(0.0)).0, "#ffffff");
        assert_eq!(colours(Some(1.0)).0, "#005a96");
        assert_eq!(colours(Some(-7.0)).0, "#d55e00");
        assert_eq!(colours(None).0, "#f0f0f0");
    }

    #[test]
    fn long_labels_have_two_lines_and_markup_is_escaped() {
        let lines = |text: &str| label(text, 0.0).matches("<text").count();
        assert_eq!((lines("Ridge regression"), lines(&"é".repeat(60))), (1, 1));
        assert_eq!(lines(&"ünten ".repeat(12)), 2);
        assert_eq!(escaped("a<b & c"), "a&lt;b &amp; c");
    }
}
