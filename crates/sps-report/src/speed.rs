//! Speed against error: every setting in a table, and two questions answered.

use sps_experiment::results::{AdaptiveResult, Costs, MethodResult, Number, Results, Speed};
use sps_experiment::text::number;

use super::table::{Cell, Row, Table};
use super::tables::frames;

/// What stands before the name of a method on the front.
const ON_FRONT: &str = "●";

/// The tables; none where the config does not ask for them.
pub(crate) fn tables(results: &Results) -> Vec<Table> {
    let Some(speed) = &results.speed else {
        return Vec::new();
    };
    let mut tables = vec![answers(results, speed), settings(results, speed)];
    tables.extend(adaptive(results));
    tables
}

fn answers(results: &Results, speed: &Speed) -> Table {
    let row = |question: String, id: &Option<String>| {
        let found = id.as_ref().and_then(|id| results.method(id));
        Row::measured(vec![
            question.into(),
            found.map_or("none", |method| &method.label).into(),
            in_milliseconds(found.and_then(|method| method.costs.predict_seconds_per_surface)),
            Cell::number(found.and_then(|method| method.means.r2_mean), 3),
            Cell::number(found.and_then(|method| method.means.mae_mean), 2),
        ])
    };
    let best = results.methods.iter().filter_map(|m| m.means.r2_mean);
    let best = number(best.reduce(f64::max), 3);
    let share = number(Some(100.0 * speed.within_error), 1);
    let limit = number(Some(1e3 * speed.within_seconds), 1);
    let columns = ["Question", "Answer", "ms per surface", "R²", "MAE"];
    let rows = [
        row(
            format!("The fastest setting within {share} % of the best error"),
            &speed.fastest_within_error,
        ),
        row(
            format!("The best error within {limit} ms per surface"),
            &speed.best_within_seconds,
        ),
    ];
    Table::new("questions", "Two questions", columns, rows).about(format!(
        "The error is 1 - R², the share of variance left unexplained; the best R² is {best}. \
         Which is best is decided on the surfaces that it is reported on: of methods that \
         hardly differ chance picks one, so read the answer beside the intervals below."
    ))
}

fn settings(results: &Results, speed: &Speed) -> Table {
    let top8 = results.has_top8();
    let mut columns = vec!["Setting", "R²", "over reruns", "MAE", "% error"];
    columns.extend(top8.then_some("% error, top 8"));
    columns.extend([
        "ms",
        "decode",
        "encode",
        "head",
        "frames",
        "multiply-adds, G",
        "memory, MiB",
        "training, s",
        "encoder training, s",
        "encoder",
    ]);
    let mut methods: Vec<&MethodResult> = results.methods.iter().collect();
    let slowest =
        |method: &MethodResult| method.costs.predict_seconds_per_surface.unwrap_or(f64::MAX);
    methods.sort_by(|a, b| slowest(a).total_cmp(&slowest(b)));
    let rows = methods.into_iter().map(|method| {
        let (means, reruns) = (&method.means, &method.means.over_reruns);
        let is_on_front = speed.front.contains(&method.id);
        let mark = if is_on_front { ON_FRONT } else { "" };
        let mut cells = vec![
            format!("{mark} {}", method.label).trim().into(),
            Cell::interval(means.r2_mean, means.r2_mean_interval, 3),
            Cell::range(reruns.r2_mean, 3),
            Cell::spread(means.mae_mean, reruns.mae_mean, 2),
            Cell::spread(
                means.median_percent_error_mean,
                reruns.median_percent_error_mean,
                1,
            ),
        ];
        let of_top8 = || {
            let range = reruns.median_percent_error_top8;
            Cell::spread(means.median_percent_error_top8, range, 1)
        };
        cells.extend(top8.then(of_top8));
        cells.extend(costs(&method.costs));
        cells.push(method.encoder.as_str().into());
        Row::measured(cells)
    });
    let title = "Every setting, from fast to slow";
    Table::new("settings", title, columns, rows).about(format!(
        "{ON_FRONT} marks the Pareto front: no other setting is both faster and better. R² with \
         {}; elsewhere, after the mean, the lowest and \
         the highest of the reruns. Seconds, in ms, are medians over single surfaces, without \
         the cache: all properties together, of an adaptive setting one; simulated frames are \
         rendered where photographs would be decoded. Frames are decoded and encoded for one \
         surface. Memory is the encoder's and the most that one estimate allocates at any time. \
         Training is that of heads or ridges, all properties and reruns together.",
        results.intervals_in_words()
    ))
}

fn costs(costs: &Costs) -> Vec<Cell> {
    let scaled = |value: Number, unit: f64| value.map(|value| value / unit);
    vec![
        in_milliseconds(costs.predict_seconds_per_surface),
        in_milliseconds(costs.decode_seconds_per_surface),
        in_milliseconds(costs.encode_seconds_per_surface),
        in_milliseconds(costs.head_seconds_per_surface),
        looked_at(costs),
        Cell::number(scaled(costs.multiply_adds_per_surface, 1e9), 3),
        Cell::number(scaled(costs.peak_memory_bytes, f64::from(1 << 20)), 1),
        Cell::number(Some(costs.train_seconds), 1),
        Cell::number(Some(costs.encoder_train_seconds), 1),
    ]
}

pub(super) fn in_milliseconds(seconds: Number) -> Cell {
    Cell::number(seconds.map(|seconds| 1e3 * seconds), 2)
}

pub(super) fn looked_at(costs: &Costs) -> Cell {
    let (decoded, encoded) = (
        costs.frames_decoded_per_surface,
        costs.frames_encoded_per_surface,
    );
    if decoded == encoded {
        return frames(encoded);
    }
    format!("{} decoded, {} encoded", frames(decoded), frames(encoded)).into()
}

/// How the settings fared that spend what a scene needs; none where there are none.
fn adaptive(results: &Results) -> Option<Table> {
    let methods = results.methods.iter();
    let adaptive = methods.filter_map(|method| Some((method, method.adaptive.as_ref()?)));
    let rows = adaptive.map(|(method, of)| adaptive_row(method, of));
    let columns = [
        "Setting",
        "width asked for",
        "mean width",
        "narrow enough, %",
        "truths to hold, %",
        "held, %",
        "views, mean",
        "estimates that took 1, 2, … views, %",
    ];
    let caption = "One view after the other is looked at, until the interval of the estimate is as \
                  narrow as asked for or there are no more. Widths are in standard deviations of \
                  the training readings.";
    let title = "Views until the interval is narrow enough";
    let table = Table::new("adaptive", title, columns, rows);
    table.about(caption).unless_empty()
}

fn adaptive_row(method: &MethodResult, of: &AdaptiveResult) -> Row {
    let percent = |share: f64| Cell::number(Some(100.0 * share), 0);
    let shares = of.share_of_views.iter();
    let shares: Vec<String> = shares.map(|&share| percent(share).to_string()).collect();
    Row::measured(vec![
        method.label.as_str().into(),
        Cell::number(Some(of.width), 2),
        Cell::number(Some(of.mean_width), 2),
        percent(of.narrow),
        percent(of.level),
        Cell::number(Some(100.0 * of.coverage), 1),
        Cell::number(Some(of.mean_views), 2),
        shares.join(", ").into(),
    ])
}
