//! How the selection of views went: a table and the curves of the searches.

use kuva::plot::LegendPosition;
use kuva::plot::line::LinePlot;
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;
use sps_experiment::results::{MethodResult, Number, Results, SelectionResult};

use super::figures::{COLOURS, Figure, PAGE, plotted};
use super::table::{Cell, Row, Table};

/// What each selector found and spent; none where no method selects views.
pub(super) fn table(results: &Results) -> Option<Table> {
    let columns = [
        "Method",
        "R²",
        "loss",
        "regret, %",
        "worst",
        "angle, °",
        "sets asked for",
        "computed",
        "s",
    ];
    let rows = selecting(results).into_iter().map(|method| {
        let all = || selections(method);
        let regrets = sorted(all().filter_map(|one| one.regret));
        let count = |of: fn(&SelectionResult) -> u64| mean(all().map(|one| of(one) as f64));
        Row::measured(vec![
            method.label.as_str().into(),
            Cell::number(method.means.r2_mean, 3),
            Cell::number(mean(all().filter_map(|one| one.loss)), 4),
            Cell::number(median(&regrets).map(|regret| 100.0 * regret), 1),
            Cell::number(regrets.last().map(|regret| 100.0 * regret), 1),
            Cell::number(mean(all().filter_map(|one| one.mean_angle_between_deg)), 1),
            Cell::number(count(|one| one.evaluations), 0),
            Cell::number(count(|one| one.computed), 0),
            Cell::number(mean(all().map(|one| one.seconds)), 2),
        ])
    });
    let caption = "R² on surfaces held out, after training with the views found. All else is of \
                  the search on the training part: loss is the mean squared error of the frozen \
                  estimator in units of the readings' variance; regret is the distance of that \
                  loss to the optimum as a share of the distance of random sets to it, the median \
                  and the worst; all else are means over properties and reruns. The angle is that \
                  between two views; seconds are those of one search.";
    let table = Table::new("selection", "The selection of views", columns, rows);
    table.about(caption).unless_empty()
}

fn selecting(results: &Results) -> Vec<&MethodResult> {
    let methods = results.methods.iter();
    methods.filter(|m| !m.selections.is_empty()).collect()
}

fn selections(method: &MethodResult) -> impl Iterator<Item = &SelectionResult> {
    method.selections.values().flatten()
}

fn mean(values: impl Iterator<Item = f64>) -> Number {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), x| (sum + x, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

fn median(sorted: &[f64]) -> Number {
    let (low, high) = (sorted.len().checked_sub(1)? / 2, sorted.len() / 2);
    Some(f64::midpoint(*sorted.get(low)?, *sorted.get(high)?))
}

/// The top of the figure, in distances of a random set from the lowest loss.
const HIGHEST: f64 = 1.2;
/// Points of a drawn curve.
const POINTS: u32 = 80;

/// The learning curves of the searches that took more than one round; none where none did.
pub(super) fn curves(results: &Results) -> Option<Figure> {
    let mut methods = selecting(results);
    methods.retain(|method| selections(method).any(|one| one.curve.len() > 2));
    let asked = methods.iter().flat_map(|method| selections(method));
    let largest = asked.map(|one| one.evaluations).max()?;
    let mut plots = Vec::new();
    for (index, method) in methods.iter().enumerate() {
        let line = |points: Vec<(f64, f64)>| {
            let line = LinePlot::new().with_data(points);
            line.with_color(COLOURS[index % COLOURS.len()])
        };
        let searches = searches(results, method);
        let best = line(curve(&searches, largest, |point| point.2)).with_stroke_width(2.0);
        plots.push(Plot::Line(best.with_legend(method.label.as_str())));
        let round = curve(&searches, largest, |point| point.1);
        // A search that goes through all sets does not better its rounds.
        if round.iter().all(|&(_, loss)| loss <= HIGHEST) {
            plots.push(Plot::Line(line(round).with_stroke_width(1.0).with_dashed()));
        }
    }
    let layout = Layout::auto_from_plots(&plots)
        .with_log_x()
        .with_x_axis_max(2.0 * largest as f64)
        .with_y_axis_min(0.0)
        .with_y_axis_max(HIGHEST)
        .with_x_label("sets asked for")
        .with_y_label("loss: 0 is the lowest, 1 a random set")
        .with_legend_box(false)
        .with_legend_position(LegendPosition::OutsideBottomColumns);
    Some(Figure {
        name: "search",
        title: "How the searches learn".to_owned(),
        caption: "Loss of the best set so far (solid) and mean loss of a round's sets (dashed) \
                  against the sets asked for; mean over properties and reruns. 0 is the optimum, \
                  or without an exhaustive search the lowest loss that any method found. VB-NVS ends \
                  with sets that it has not tried before, which are not all good."
            .to_owned(),
        svg: plotted(plots, layout, (PAGE, 320.0)),
    })
}

/// A point of a search's curve: the sets asked for, the mean loss of their round, the least so far.
type Point = (u64, f64, f64);

/// The mean curve of searches, at evaluations that grow by a constant factor, from the first that all
/// have.
fn curve(searches: &[Search<'_>], largest: u64, of: fn(&Point) -> f64) -> Vec<(f64, f64)> {
    let longest = searches.iter().map(|search| search.of.evaluations).max();
    let longest = 1.2 * longest.unwrap_or(0) as f64;
    (0..=POINTS)
        .map(|at| (largest as f64).powf(f64::from(at) / f64::from(POINTS)))
        .filter(|&evaluations| evaluations <= longest)
        .filter_map(|evaluations| {
            let values = searches.iter().map(|search| search.at(evaluations, of));
            let values: Option<Vec<f64>> = values.collect();
            Some((evaluations, mean(values?.into_iter())?))
        })
        .collect()
}

/// A search, with the losses that its own are measured between.
struct Search<'a> {
    of: &'a SelectionResult,
    random: f64,
    lowest: f64,
}

impl Search<'_> {
    /// Where the curve was after so many evaluations: 0 is the lowest loss, 1 that of random sets.
    fn at(&self, evaluations: f64, of: fn(&Point) -> f64) -> Number {
        let reached = |point: &&Point| point.0 as f64 <= evaluations;
        let point = self.of.curve.iter().take_while(reached).last()?;
        Some((of(point) - self.lowest) / (self.random - self.lowest))
    }
}

/// The searches of a method in which there was something to find.
fn searches<'a>(results: &Results, method: &'a MethodResult) -> Vec<Search<'a>> {
    let all = method.selections.iter().flat_map(|(property, selections)| {
        let numbered = selections.iter().enumerate();
        numbered.filter_map(move |(rerun, of)| {
            let lowest = of
                .optimum_loss
                .or_else(|| lowest(results, method, property, rerun))?;
            let random = of.random_loss?;
            (random > lowest).then_some(Search { of, random, lowest })
        })
    });
    all.collect()
}

/// The lowest loss that methods found which select as many views.
fn lowest(results: &Results, method: &MethodResult, property: &str, rerun: usize) -> Number {
    let picks = |method: &MethodResult| {
        let views = method.selected_views.get(property)?.get(rerun)?;
        Some(views.len())
    };
    let methods = results.methods.iter();
    let alike = methods.filter(|other| picks(other) == picks(method));
    let losses = alike.filter_map(|other| other.selections.get(property)?.get(rerun)?.loss);
    losses.min_by(f64::total_cmp)
}
