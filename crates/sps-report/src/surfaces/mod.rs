//! Surfaces as the best method saw them, measured and estimated values side by side.

mod pictures;
mod ranked;

use std::collections::BTreeSet;
use std::path::Path;

use serde::Serialize;
use serde_json::{Value, json};
use sps_experiment::predictions::Prediction;
use sps_experiment::results::{MethodResult, Results};
use sps_experiment::text::number;

use super::Estimates;
use super::scales::{Scale, Scales, scales};
use super::table::{Cell, Row, Table};
use pictures::{Sight, in_words, sights};
use ranked::{Ranked, picked, ranked};

#[derive(Serialize)]
pub(super) struct Gallery {
    pub caption: String,
    /// Why there are no pictures, where there are none.
    missing: Option<String>,
    groups: Vec<Group>,
    /// The same in few words.
    #[serde(skip)]
    pub table: Table,
}

#[derive(Serialize)]
struct Group {
    title: &'static str,
    cards: Vec<Card>,
}

#[derive(Serialize)]
struct Card {
    surface: String,
    material: String,
    looked_at: String,
    pictures: Vec<Value>,
    lines: Vec<Value>,
    error: String,
}

/// Pictures of one surface, at most.
const MOST_PICTURES: usize = 3;

const GROUPS: [&str; 3] = ["The best", "The median", "The worst"];

/// The surfaces of which a method made the best, the median and the worst estimates; none where it made
/// none.
pub(super) fn gallery(
    folder: &Path,
    results: &Results,
    estimates: &Estimates<'_>,
) -> Option<Gallery> {
    let (method, predictions) = (estimates.method, &estimates.predictions);
    let scales = scales(predictions);
    let ranked = ranked(&results.properties, predictions, &scales);
    let picked = picked(ranked.len());
    let chosen = picked.iter().flat_map(|places| &ranked[places.clone()]);
    let chosen: Vec<&Ranked<'_>> = chosen.collect();
    chosen.first()?;
    let views = chosen.iter().map(|one| views(method, one));
    let views: Vec<Vec<usize>> = views.collect();
    let wanted = chosen.iter().zip(&views);
    let wanted = wanted.map(|(one, views)| (one.surface, spread(views)));
    let seen = sights(folder, &wanted.collect::<Vec<_>>());
    let missing = seen.as_ref().err().map(|error| format!("{error:#}"));
    let seen = seen.unwrap_or_else(|_| chosen.iter().map(|_| Sight::default()).collect());
    let cards = chosen.iter().zip(&views).zip(seen);
    let mut cards =
        cards.map(|((one, views), sight)| Card::of(one, &scales, looked_at(results, views), sight));
    let groups = GROUPS.into_iter().zip(&picked);
    let groups = groups.map(|(title, places)| Group {
        title,
        cards: cards.by_ref().take(places.len()).collect(),
    });
    let groups: Vec<Group> = groups.filter(|group| !group.cards.is_empty()).collect();
    Some(Gallery {
        caption: caption(method),
        missing,
        table: table(&groups),
        groups,
    })
}

fn caption(method: &MethodResult) -> String {
    format!(
        "Held-out surfaces of which {}, the best of the methods that look at a photograph, made the \
         best, the median and the worst estimates: by how far they are off, in standard deviations of the measured values, on \
         average over the properties. The line is what was measured, the dot what was estimated, \
         between the lowest and the highest value of all held-out surfaces.",
        method.label
    )
}

/// The views that a method looked at, for any property, in their order; each once.
fn views(method: &MethodResult, of: &Ranked<'_>) -> Vec<usize> {
    let views = of.values.iter().flat_map(|value| {
        let of_splits = method.selected_views.get(&value.property);
        let views = of_splits.and_then(|splits| splits.get(value.rerun));
        let all = views.map_or(0, Vec::len);
        let looked_at = value.views.unwrap_or(all);
        views.into_iter().flatten().take(looked_at).copied()
    });
    let views: BTreeSet<usize> = views.collect();
    views.into_iter().collect()
}

/// At most as many views as are shown, from the first to the last.
fn spread(views: &[usize]) -> Vec<usize> {
    if views.len() <= MOST_PICTURES {
        return views.to_vec();
    }
    let last = views.len() - 1;
    let places = (0..MOST_PICTURES).map(|at| at * last / (MOST_PICTURES - 1));
    places.map(|place| views[place]).collect()
}

fn looked_at(results: &Results, views: &[usize]) -> String {
    let angles = &results.dataset.view_angles_deg;
    let angles: Vec<&f64> = views.iter().filter_map(|&view| angles.get(view)).collect();
    match angles.as_slice() {
        [] => String::new(),
        [one] => format!("seen from {}", in_words(**one)),
        [first, .., last] => format!(
            "seen from {} angles, {} to {}",
            angles.len(),
            in_words(**first),
            in_words(**last)
        ),
    }
}

impl Card {
    fn of(of: &Ranked<'_>, scales: &Scales<'_>, looked_at: String, sight: Sight) -> Self {
        let lines = of.values.iter().filter_map(|value| {
            let scale = scales.get(value.property.as_str())?;
            Some(line(value, scale))
        });
        Self {
            surface: of.surface.to_owned(),
            material: sight.material,
            looked_at,
            pictures: sight.pictures,
            lines: lines.collect(),
            error: number(Some(of.error), 2),
        }
    }
}

/// A property's values, and where they lie among those of all surfaces, in percent.
fn line(value: &Prediction, scale: &Scale) -> Value {
    let [low, high] = scale.ends;
    let at = |value: f64| {
        let share = if low < high {
            (value - low) / (high - low)
        } else {
            0.5
        };
        (1000.0 * share).round() / 10.0
    };
    json!({
        "property": value.property,
        "measured": number(Some(value.truth), 1),
        "estimated": number(Some(value.estimate), 1),
        "measured_at": at(value.truth),
        "estimated_at": at(value.estimate),
    })
}

/// For those who read text.
fn table(groups: &[Group]) -> Table {
    let cards = groups.iter().flat_map(|group| {
        let cards = group.cards.iter();
        cards.map(move |card| (group.title, card))
    });
    let rows = cards.map(|(title, card)| {
        let cells = [
            title,
            &card.surface,
            &card.material,
            &card.looked_at,
            &card.error,
        ];
        Row::measured(cells.map(Cell::from).to_vec())
    });
    let columns = ["", "surface", "material", "seen from", "off by, deviations"];
    Table::new("surfaces", "Surfaces", columns, rows)
}
