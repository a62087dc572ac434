//! Figures of prediction intervals: how many truths they hold, and whether the wide ones err more.

mod halves;

use kuva::plot::scatter::MarkerShape;
use kuva::plot::{LegendPosition, ScatterPlot};
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;
use sps_experiment::predictions::Prediction;
use sps_experiment::results::{MethodResult, Results};
use sps_experiment::text::number;
use sps_metrics::Level;

use super::Estimates;
use super::figures::{COLOURS, COLUMN, Figure, line, plotted};
use super::scales::scales;

/// The figures of these methods; none where there are too few estimates to calibrate on.
pub(super) fn figures(results: &Results, all: &[Estimates<'_>]) -> Vec<Figure> {
    let coloured: Vec<_> = all.iter().zip(COLOURS.into_iter().cycle()).collect();
    let figures = [coverage(results, &coloured), widths(&coloured)];
    figures.into_iter().flatten().collect()
}

/// A method's estimates, with their colour in both figures.
type Coloured<'a> = (&'a Estimates<'a>, &'static str);

fn coverage(results: &Results, all: &[Coloured<'_>]) -> Option<Figure> {
    let levels = (1..20).filter_map(|at| Level::new(f64::from(at) / 20.0).ok());
    let levels: Vec<Level> = levels.collect();
    // Where both axes say the same.
    let diagonal = line([(0.0, 0.0), (1.0, 1.0)], "#777777", 1.0);
    let mut plots = vec![Plot::Line(diagonal.with_dashed())];
    for (estimates, colour) in all {
        let held = halves::held(&estimates.predictions, &levels);
        if held.is_empty() {
            continue;
        }
        let held = held.into_iter().map(|(level, share)| (level.get(), share));
        let line = line(held, colour, 1.4);
        let legend = estimates.method.label.as_str();
        plots.push(Plot::Line(line.with_legend(legend)));
    }
    let own = all
        .iter()
        .filter_map(|&(estimates, colour)| promised(estimates.method, colour));
    plots.extend(own.map(Plot::Scatter));
    if plots.len() == 1 {
        return None;
    }
    let layout = Layout::auto_from_plots(&plots)
        .with_x_axis_min(0.0)
        .with_x_axis_max(1.0)
        .with_y_axis_min(0.0)
        .with_y_axis_max(1.0)
        .with_x_label("level")
        .with_y_label("share of truths held")
        .with_legend_position(LegendPosition::InsideBottomRight);
    Some(Figure {
        name: "coverage",
        title: "Coverage of intervals".to_owned(),
        caption: format!(
            "Lines: intervals around the estimates are made from one half of the held-out {units} and \
             judged on the other, and the other way round; all properties and reruns together. On the \
             dashed line they hold as many truths as they promise, below it fewer. Stars: the \
             intervals that a method made itself, to stop when it is sure.",
            units = results.dataset.units_in_words()
        ),
        svg: plotted(plots, layout, (COLUMN, 320.0)),
    })
}

/// What a method's own intervals promise and hold.
fn promised(method: &MethodResult, colour: &str) -> Option<ScatterPlot> {
    let own = method.adaptive.as_ref()?;
    let hover = format!(
        "{}: {} % of {} %",
        method.label,
        number(Some(100.0 * own.coverage), 1),
        number(Some(100.0 * own.level), 0)
    );
    Some(
        ScatterPlot::new()
            .with_data([(own.level, own.coverage)])
            .with_marker(MarkerShape::Star)
            .with_size(6.0)
            .with_color(colour)
            .with_tooltips()
            .with_tooltip_labels([hover]),
    )
}

/// Marks of a method.
const BINS: usize = 10;

fn widths(all: &[Coloured<'_>]) -> Option<Figure> {
    let mut plots = Vec::new();
    for &(estimates, colour) in all {
        let bins = bins(&estimates.predictions);
        if bins.is_empty() {
            continue;
        }
        let line = line(bins.iter().copied(), colour, 1.2);
        let line = line.with_legend(estimates.method.label.as_str());
        let marks = ScatterPlot::new()
            .with_data(bins.iter().copied())
            .with_color(colour)
            .with_size(3.0);
        plots.extend([Plot::Line(line), Plot::Scatter(marks)]);
    }
    if plots.is_empty() {
        return None;
    }
    let layout = Layout::auto_from_plots(&plots)
        .with_y_axis_min(0.0)
        .with_x_label("width of the interval, deviations")
        .with_y_label("mean error, deviations")
        .with_legend_position(LegendPosition::InsideBottomRight);
    Some(Figure {
        name: "width-error",
        title: "Width of intervals against error".to_owned(),
        caption: format!(
            "Of methods that make an interval for each estimate. The held-out estimates are in \
             {BINS} parts by the width of their interval, from narrow to wide; a mark is the mean of \
             a part. Widths that say how sure an estimate is rise with the error. Both are in \
             standard deviations of a property's measured values."
        ),
        svg: plotted(plots, layout, (COLUMN, 300.0)),
    })
}

/// Mean width and mean error of each part, where there is something to tell apart.
fn bins(predictions: &[&Prediction]) -> Vec<(f64, f64)> {
    let scales = scales(predictions);
    let pairs = predictions.iter().filter_map(|prediction| {
        let [low, high] = prediction.interval()?;
        let scale = scales.get(prediction.property.as_str())?;
        Some(((high - low) / scale.deviation, scale.error(prediction)))
    });
    let mut pairs: Vec<(f64, f64)> = pairs.collect();
    pairs.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let size = pairs.len() / BINS;
    if size == 0 {
        return Vec::new();
    }
    let mean = |bin: &[(f64, f64)], of: fn(&(f64, f64)) -> f64| {
        bin.iter().map(of).sum::<f64>() / bin.len() as f64
    };
    let bins = (0..BINS).map(|at| &pairs[at * pairs.len() / BINS..(at + 1) * pairs.len() / BINS]);
    bins.map(|bin| (mean(bin, |pair| pair.0), mean(bin, |pair| pair.1)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twenty estimates as far off as their intervals are wide, in any order; the deviation of the
    /// truths -1 and 1 is 1.
    #[test]
    fn parts_go_from_narrow_to_wide() {
        let of = |at: usize| {
            let width = ((7 * at) % 20 + 1) as f64;
            let truth = if at.is_multiple_of(2) { 1.0 } else { -1.0 };
            let estimate = truth + width;
            Prediction {
                property: "fRS".to_owned(),
                truth,
                estimate,
                low: Some(estimate - width / 2.0),
                high: Some(estimate + width / 2.0),
                ..Prediction::default()
            }
        };
        let predictions: Vec<Prediction> = (0..20).map(of).collect();
        let found = bins(&predictions.iter().collect::<Vec<_>>());
        let middles = (0..10).map(|at| 1.5 + 2.0 * f64::from(at));
        assert_eq!(found, middles.map(|m| (m, m)).collect::<Vec<_>>());
        let bare = Prediction::default();
        assert!(bins(&[&bare]).is_empty());
    }
}
