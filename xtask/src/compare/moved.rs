//! How far each score moved from one run to another.

use rayon::prelude::*;
use serde::Serialize;
use sps_metrics::{Bootstrap, BootstrapError, Compared, Samples, Scored};

use super::Run;
use super::held::Held;
use crate::progress::Progress;
use crate::results::{Kind, MethodResult, Number};

/// A score in both runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Moved {
    pub method: String,
    /// `null`: the mean over properties.
    pub property: Option<String>,
    pub score: Kind,
    pub first: Number,
    pub second: Number,
    /// The second less the first.
    pub difference: Number,
    pub interval: Option<[f64; 2]>,
    /// Whether both were scored on the same surfaces with the same readings.
    pub paired: bool,
    /// Why there is no interval.
    pub reason: Option<String>,
}

/// Every score of methods that both runs have: means over properties first.
pub(super) fn scores(first: &Run, second: &Run, methods: &[[&MethodResult; 2]]) -> Vec<Moved> {
    let mut asked = Vec::new();
    // Means over other properties are other means.
    if first.results.properties == second.results.properties {
        for kind in Kind::WITH_MEANS {
            asked.extend(methods.iter().map(|of| (*of, None, kind)));
        }
    }
    for kind in Kind::ALL {
        for of in methods {
            let properties = first.results.properties.iter();
            let common = properties.filter(|code| second.results.properties.contains(code));
            asked.extend(common.map(|property| (*of, Some(property), kind)));
        }
    }
    let progress = Progress::new("scores compared", asked.len());
    let moved = asked.into_par_iter().map(|(of, property, kind)| {
        let moved = moved(first, second, of, property, kind);
        progress.advance(1);
        moved
    });
    moved.collect()
}

fn moved(
    first: &Run,
    second: &Run,
    [then, now]: [&MethodResult; 2],
    property: Option<&String>,
    kind: Kind,
) -> Moved {
    let value = |method: &MethodResult| match property {
        Some(property) => kind.of(&method.scores).get(property).copied().flatten(),
        None => kind.mean(&method.means),
    };
    let (before, after) = (value(then), value(now));
    let difference = before.zip(after).map(|(before, after)| after - before);
    let properties: Vec<&String> = match property {
        Some(one) => vec![one],
        None => first.results.properties.iter().collect(),
    };
    let pairs = pairs(first, second, &then.id, &properties);
    let found = difference.map(|difference| match &pairs {
        Some(pairs) => paired(&first.bootstrap(), kind, pairs, difference),
        None => unpaired([first, second], &then.id, &properties, kind, difference),
    });
    let (interval, reason) = match found {
        Some(Ok(interval)) => (Some(interval), None),
        Some(Err(reason)) => (None, Some(reason.to_string())),
        None => (None, Some("a score is missing".to_owned())),
    };
    Moved {
        method: then.id.clone(),
        property: property.cloned(),
        score: kind,
        first: before,
        second: after,
        difference,
        interval,
        paired: pairs.is_some(),
        reason,
    }
}

/// Two runs' estimates for the same surfaces in one rerun.
struct Pair<'r> {
    first: &'r Held,
    second: &'r Held,
    /// Of the run whose resamples keep more together.
    units: &'r [usize],
}

/// The reruns of one run beside those of the other; `None` where surfaces or readings differ. Of runs
/// with as many reruns each goes with its own; otherwise those of either run come up again in turn
/// until all have come up equally often.
fn pairs<'r>(
    first: &'r Run,
    second: &'r Run,
    method: &str,
    properties: &[&String],
) -> Option<Vec<Pair<'r>>> {
    let mut pairs = Vec::new();
    let second_keeps_more = second.outcomes.unit > first.outcomes.unit;
    for property in properties {
        let mine = first.outcomes.get(method, property);
        let theirs = second.outcomes.get(method, property);
        if mine.is_empty() || theirs.is_empty() {
            return None;
        }
        for at in 0..least_common_multiple(mine.len(), theirs.len()) {
            let (first, second) = (&mine[at % mine.len()], &theirs[at % theirs.len()]);
            if !first.pairs_with(second) {
                return None;
            }
            let units = if second_keeps_more { second } else { first };
            pairs.push(Pair {
                first,
                second,
                units: &units.units,
            });
        }
    }
    Some(pairs)
}

fn least_common_multiple(a: usize, b: usize) -> usize {
    let (mut x, mut y) = (a, b);
    while y > 0 {
        (x, y) = (y, x % y);
    }
    a / x * b
}

/// The interval of a difference where the same units are drawn for both. Where the training parts
/// differ too, R² of either is about the first one's mean in the resamples, and the interval lies
/// about the `difference` of the scores as they are reported.
fn paired(
    bootstrap: &Bootstrap,
    kind: Kind,
    pairs: &[Pair<'_>],
    difference: f64,
) -> Result<[f64; 2], BootstrapError> {
    let values: Vec<[Vec<f64>; 3]> = pairs
        .iter()
        .map(|Pair { first, second, .. }| {
            let means = &first.training_mean;
            [&first.truth, &second.estimate, &first.estimate]
                .map(|values| judged(kind, values, means))
        })
        .collect();
    let compared = pairs.iter().zip(&values);
    let compared = compared.map(|(pair, [truth, second, first])| {
        Ok(Compared {
            metric: kind.metric()?,
            truth,
            // The bootstrap's difference is the first less the second.
            first: second,
            second: first,
            units: Some(pair.units),
        })
    });
    let compared = compared.collect::<Result<Vec<_>, BootstrapError>>()?;
    let found = bootstrap.mean_difference(&compared)?;
    let apart = difference - found.estimate;
    Ok([found.low + apart, found.high + apart])
}

/// The interval of a difference of two scores that do not depend on one another, from the interval of
/// each: that of Zou and Donner, "Construction of confidence limits about effect measures", Statistics
/// in Medicine 27, 2008.
fn unpaired(
    runs: [&Run; 2],
    method: &str,
    properties: &[&String],
    kind: Kind,
    difference: f64,
) -> Result<[f64; 2], BootstrapError> {
    let interval = |run: &Run| {
        let reruns = properties.iter();
        let reruns = reruns.flat_map(|property| run.outcomes.get(method, property));
        alone(&runs[0].bootstrap(), kind, &reruns.collect::<Vec<_>>())
    };
    Ok(about(difference, &interval(runs[0])?, &interval(runs[1])?))
}

fn about(difference: f64, first: &Reach, second: &Reach) -> [f64; 2] {
    [
        difference - second.below.hypot(first.above),
        difference + second.above.hypot(first.below),
    ]
}

/// How far the interval of a score reaches below and above it.
struct Reach {
    below: f64,
    above: f64,
}

fn alone(bootstrap: &Bootstrap, kind: Kind, reruns: &[&Held]) -> Result<Reach, BootstrapError> {
    let values: Vec<[Vec<f64>; 2]> = reruns
        .iter()
        .map(|held| {
            [&held.truth, &held.estimate].map(|values| judged(kind, values, &held.training_mean))
        })
        .collect();
    let scored = reruns.iter().zip(&values);
    let scored = scored.map(|(held, [truth, estimate])| {
        Ok(Scored {
            metric: kind.metric()?,
            samples: Samples { truth, estimate },
            units: Some(&held.units),
        })
    });
    let scored = scored.collect::<Result<Vec<_>, BootstrapError>>()?;
    let found = bootstrap.mean_interval(&scored)?;
    Ok(Reach {
        below: found.estimate - found.low,
        above: found.high - found.estimate,
    })
}

/// Values as a score takes them.
fn judged(kind: Kind, values: &[f64], training_means: &[f64]) -> Vec<f64> {
    if !kind.is_about_training() {
        return values.to_vec();
    }
    let values = values.iter().zip(training_means);
    values.map(|(value, mean)| value - mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held(error: f64, training_mean: f64) -> Held {
        let truth = vec![1.0, 2.0, 4.0, 7.0];
        Held {
            surfaces: ["a", "b", "c", "d"].map(str::to_owned).to_vec(),
            units: vec![0, 1, 2, 3],
            estimate: truth.iter().map(|truth| truth + error).collect(),
            training_mean: vec![training_mean; truth.len()],
            truth,
        }
    }

    fn interval(kind: Kind, first: &Held, second: &Held, difference: f64) -> [f64; 2] {
        let pairs = [Pair {
            first,
            second,
            units: &first.units,
        }];
        let bootstrap = Bootstrap::new(0).with_resamples(200);
        paired(&bootstrap, kind, &pairs, difference).unwrap()
    }

    /// Errors of 1 and of 3 on every surface: whichever are drawn, MAE and RMSE are 2 apart.
    #[test]
    fn what_is_the_same_on_every_surface_has_no_width() {
        for kind in [Kind::Mae, Kind::Rmse] {
            let [low, high] = interval(kind, &held(1.0, 0.0), &held(3.0, 0.0), 2.0);
            assert!((low - 2.0).abs() < 1e-12 && (high - 2.0).abs() < 1e-12);
        }
        // The same estimates, judged about another mean: the interval lies about the reported
        // difference.
        let moved = interval(Kind::R2, &held(1.0, 3.0), &held(1.0, 5.0), 0.25);
        assert_eq!(moved, [0.25, 0.25]);
        // About the same mean R² does differ, and by how much depends on who is drawn.
        let [low, high] = interval(Kind::R2, &held(1.0, 3.0), &held(0.0, 3.0), 4.0 / 22.0);
        assert!(0.0 < low && low < 4.0 / 22.0 && 4.0 / 22.0 < high);
    }

    #[test]
    fn independent_intervals_add_like_the_sides_of_a_triangle() {
        let first = Reach {
            below: 8.0,
            above: 4.0,
        };
        let second = Reach {
            below: 3.0,
            above: 6.0,
        };
        assert_eq!(about(1.0, &first, &second), [-4.0, 11.0]);
    }

    #[test]
    fn reruns_come_up_equally_often() {
        for (a, b, both) in [(1, 3, 3), (2, 3, 6), (4, 6, 12), (5, 5, 5)] {
            assert_eq!(least_common_multiple(a, b), both);
        }
    }
}
