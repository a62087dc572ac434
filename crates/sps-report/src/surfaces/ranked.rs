//! The surfaces that a method was asked about, from the best estimates to the worst.

use std::collections::BTreeMap;

use sps_experiment::predictions::Prediction;

use crate::scales::Scales;

/// A held-out surface as a method estimated it.
pub(super) struct Ranked<'a> {
    pub surface: &'a str,
    /// Of each property that was measured, in the order of the report.
    pub values: Vec<&'a Prediction>,
    /// Mean distance of estimates to measured values, in standard deviations of the property's.
    pub error: f64,
}

/// All surfaces once, of the first rerun that held them out; the best first, those of equal error by
/// their names.
pub(super) fn ranked<'a>(
    properties: &[String],
    predictions: &[&'a Prediction],
    scales: &Scales<'_>,
) -> Vec<Ranked<'a>> {
    let mut of_surface: BTreeMap<&str, BTreeMap<&str, &Prediction>> = BTreeMap::new();
    for &prediction in predictions {
        let of = of_surface.entry(&prediction.surface).or_default();
        let first = of.entry(&prediction.property).or_insert(prediction);
        if prediction.rerun < first.rerun {
            *first = prediction;
        }
    }
    let ranked = of_surface.into_iter().filter_map(|(surface, of_property)| {
        let value = |property: &String| of_property.get(property.as_str()).copied();
        let values: Vec<&Prediction> = properties.iter().filter_map(value).collect();
        let error = |value: &&Prediction| Some(scales.get(&value.property[..])?.error(value));
        let errors: Vec<f64> = values.iter().filter_map(error).collect();
        let error = errors.iter().sum::<f64>() / errors.len() as f64;
        error.is_finite().then_some(Ranked {
            surface,
            values,
            error,
        })
    });
    let mut ranked: Vec<Ranked<'_>> = ranked.collect();
    ranked.sort_by(|a, b| a.error.total_cmp(&b.error));
    ranked
}

/// At most so many of each kind.
const OF_A_KIND: usize = 3;

/// The best, those around the median, and the worst, no surface twice.
pub(super) fn picked(count: usize) -> [std::ops::Range<usize>; 3] {
    let each = (count / 3).clamp(1, OF_A_KIND);
    let best = 0..each.min(count);
    let worst = count.saturating_sub(each).max(best.end)..count;
    let middle = (count.saturating_sub(each) / 2).clamp(best.end, worst.start);
    let median = middle..(middle + each).min(worst.start);
    [best, median, worst]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scales::scales;

    #[test]
    fn the_median_lies_between_the_best_and_the_worst() {
        assert_eq!(picked(2000), [0..3, 998..1001, 1997..2000]);
        assert_eq!(picked(9), [0..3, 3..6, 6..9]);
        assert_eq!(picked(4), [0..1, 1..2, 3..4]);
        assert_eq!(picked(3), [0..1, 1..2, 2..3]);
        assert_eq!(picked(2), [0..1, 1..1, 1..2]);
        assert_eq!(picked(1), [0..1, 1..1, 1..1]);
        assert_eq!(picked(0), [0..0, 0..0, 0..0]);
    }

    /// The truths 1, 3, 5, 7 have the deviation √5.
    #[test]
    fn surfaces_are_ranked_by_how_far_their_estimates_are_off() {
        let prediction = |rerun, surface: &str, truth, estimate| Prediction {
            property: "fRS".to_owned(),
            rerun,
            surface: surface.to_owned(),
            truth,
            estimate,
            ..Prediction::default()
        };
        let predictions = [
            prediction(0, "a", 1.0, 4.0),
            prediction(0, "b", 3.0, 3.0),
            prediction(1, "c", 5.0, 4.0),
            prediction(0, "d", 7.0, 9.0),
        ];
        // The first rerun is the one that is shown.
        let again = [prediction(1, "b", 3.0, 30.0), prediction(2, "c", 5.0, 50.0)];
        let first: Vec<&Prediction> = predictions.iter().collect();
        let scales = scales(&first);
        let all: Vec<&Prediction> = again.iter().chain(&predictions).collect();
        let ranked = ranked(&["fRS".to_owned()], &all, &scales);
        let names: Vec<&str> = ranked.iter().map(|one| one.surface).collect();
        assert_eq!(names, ["b", "c", "d", "a"]);
        assert!((ranked[3].error - 3.0 / 5_f64.sqrt()).abs() < 1e-12);
        assert_eq!(scales["fRS"].ends, [1.0, 9.0]);
    }
}
