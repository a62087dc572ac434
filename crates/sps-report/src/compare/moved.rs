//! How far each score moved from one run to another.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::Serialize;
use sps_experiment::progress::Progress;
use sps_experiment::results::{Kind, MethodResult, Number};
use sps_metrics::{IntervalError, Samples, ScoreInterval, Scored, holm};

use super::Run;
use super::held::{Held, Outcomes};

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
    /// The p-value of no difference, and the same after Holm's correction for the rows of its table
    /// that differ.
    pub p: Number,
    pub corrected_p: Number,
    /// Whether it is clear of 0 after the correction.
    pub clear: bool,
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
    let mut moved: Vec<Moved> = moved.collect();
    correct(&mut moved, 1.0 - first.results.interval_level);
    moved
}

/// Two scores that are nearer to one another differ by rounding.
const ROUNDING: f64 = 1e-9;

impl Moved {
    /// Whether the score of one run is not that of the other.
    pub(super) fn is_other(&self) -> bool {
        match self.difference {
            Some(difference) => difference.abs() > ROUNDING,
            None => self.first != self.second,
        }
    }

    /// Whether it moved by more than `tolerance`, and by more than chance where that is known; or is
    /// no longer there.
    pub(super) fn is_past(&self, tolerance: f64) -> bool {
        match self.difference {
            Some(difference) => {
                difference.abs() > tolerance && (self.clear || self.interval.is_none())
            }
            None => self.first.is_some(),
        }
    }

    /// The table that it stands in: that of means, or that of its score.
    pub(super) fn table(&self) -> Option<Kind> {
        self.property.as_ref().map(|_| self.score)
    }
}

/// Corrects the p-values of each table for how many it has, and calls those clear of 0 that are at
/// most `tails`.
fn correct(all: &mut [Moved], tails: f64) {
    let mut tables: BTreeMap<Option<Kind>, Vec<(&mut Moved, f64)>> = BTreeMap::new();
    for moved in all.iter_mut().filter(|moved| moved.is_other()) {
        if let Some(p) = moved.p {
            tables.entry(moved.table()).or_default().push((moved, p));
        }
    }
    for rows in tables.into_values() {
        let p_values: Vec<f64> = rows.iter().map(|(_, p)| *p).collect();
        for ((moved, _), p) in rows.into_iter().zip(holm(&p_values)) {
            moved.corrected_p = Some(p);
            moved.clear = p <= tails;
        }
    }
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
    let [mine, theirs] = [first, second].map(|run| {
        let held = |property: &&String| run.outcomes.get(&then.id, property);
        properties.iter().map(held).collect::<Vec<&[Held]>>()
    });
    let mut both = mine.iter().zip(&theirs);
    let paired = both.all(|(mine, theirs)| pair(mine, theirs));
    let found = difference.map(|_| apart([first, second], [&theirs, &mine], kind, paired));
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
        // The mean over reruns and properties is the same as that over all of them, unless some
        // have none.
        interval: interval.zip(difference).map(|(found, difference)| {
            let moved = difference - found.estimate;
            [found.low + moved, found.high + moved]
        }),
        p: interval.map(|found| found.p),
        corrected_p: None,
        clear: false,
        paired,
        reason,
    }
}

/// Whether both are of the same surfaces with the same readings: rerun by rerun, or where one run
/// has more reruns all of them of the same.
fn pair(mine: &[Held], theirs: &[Held]) -> bool {
    let (Some(first), Some(_)) = (mine.first(), theirs.first()) else {
        return false;
    };
    if mine.len() == theirs.len() {
        let mut pairs = mine.iter().zip(theirs);
        return pairs.all(|(mine, theirs)| mine.rerun == theirs.rerun && mine.pairs_with(theirs));
    }
    let mut all = mine.iter().chain(theirs);
    all.all(|held| first.pairs_with(held))
}

/// The interval of the second run's mean score less the first's; of `paired` ones by the units of the
/// run that keeps more together.
fn apart(
    [first, second]: [&Run; 2],
    [theirs, mine]: [&[&[Held]]; 2],
    kind: Kind,
    paired: bool,
) -> Result<ScoreInterval, IntervalError> {
    let (of_first, of_second) = (&first.outcomes, &second.outcomes);
    let (units, other) = match (paired, of_second.unit > of_first.unit) {
        (true, true) => (of_second, of_second),
        (true, false) => (of_first, of_first),
        (false, _) => (of_second, of_first),
    };
    let (theirs, mine) = (judged(kind, theirs, units), judged(kind, mine, other));
    let (theirs, mine) = (scored(kind, &theirs)?, scored(kind, &mine)?);
    if paired {
        first.intervals.difference(&theirs, &mine)
    } else {
        first.intervals.independent_difference(&theirs, &mine)
    }
}

/// What is scored, and of which units.
struct Judged {
    rerun: usize,
    truth: Vec<f64>,
    estimate: Vec<f64>,
    units: Vec<usize>,
}

fn judged(kind: Kind, all: &[&[Held]], units: &Outcomes) -> Vec<Judged> {
    let judged = all.iter().copied().flatten().map(|held| {
        let [truth, estimate] = held.judged(kind);
        Judged {
            rerun: held.rerun,
            truth,
            estimate,
            units: units.units_of(held),
        }
    });
    judged.collect()
}

fn scored(kind: Kind, all: &[Judged]) -> Result<Vec<Scored<'_>>, IntervalError> {
    let scored = all.iter().map(|judged| {
        Ok(Scored {
            metric: kind.metric()?,
            samples: Samples {
                truth: &judged.truth,
                estimate: &judged.estimate,
            },
            units: Some(&judged.units),
            rerun: judged.rerun,
        })
    });
    scored.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held(names: [&str; 2], truth: f64) -> Held {
        Held {
            surfaces: names.map(str::to_owned).to_vec(),
            truth: vec![truth; 2],
            ..Held::default()
        }
    }

    #[test]
    fn runs_pair_rerun_by_rerun_or_where_all_are_of_the_same() {
        let (ab, cd) = (held(["a", "b"], 1.0), held(["c", "d"], 1.0));
        let other = held(["a", "b"], 2.0);
        let numbered = |all: &[&Held]| -> Vec<Held> {
            let all = all.iter().copied().cloned().enumerate();
            all.map(|(rerun, held)| Held { rerun, ..held }).collect()
        };
        for (mine, theirs, expected) in [
            (vec![&ab, &cd], vec![&ab, &cd], true),
            (vec![&ab, &cd], vec![&cd, &ab], false),
            (vec![&ab], vec![&other], false),
            (vec![&ab], vec![&ab, &ab], true),
            (vec![&ab], vec![&ab, &cd], false),
            (vec![], vec![&ab], false),
        ] {
            let (mine, theirs) = (numbered(&mine), numbered(&theirs));
            assert_eq!([pair(&mine, &theirs), pair(&theirs, &mine)], [expected; 2]);
        }
    }

    fn row(property: Option<&str>, difference: f64, p: Option<f64>) -> Moved {
        Moved {
            method: "a".to_owned(),
            property: property.map(str::to_owned),
            score: Kind::R2,
            first: Some(0.0),
            second: Some(difference),
            difference: Some(difference),
            interval: None,
            p,
            corrected_p: None,
            clear: false,
            paired: true,
            reason: None,
        }
    }

    #[test]
    fn what_may_be_chance_is_not_past_a_tolerance() {
        let moved = |interval, clear| Moved {
            interval,
            clear,
            ..row(Some("x"), 0.02, Some(0.04))
        };
        let interval = Some([0.001, 0.039]);
        let mut lost = moved(None, false);
        (lost.difference, lost.second) = (None, None);
        for (one, past) in [
            (moved(interval, true), true),
            (moved(interval, false), false),
            // Of one rerun chance is not known.
            (moved(None, false), true),
            (lost, true),
        ] {
            assert_eq!(one.is_past(0.01), past, "{one:?}");
            let lost = one.difference.is_none();
            assert_eq!(one.is_past(0.02), lost, "{one:?}");
        }
    }

    #[test]
    fn each_table_is_corrected_for_the_rows_that_differ() {
        let mut rows = [
            row(None, 0.1, Some(0.04)),
            row(Some("x"), 0.1, Some(0.04)),
            row(Some("y"), 0.1, Some(0.02)),
            row(Some("z"), 0.0, Some(1.0)),
            row(Some("w"), 0.1, None),
        ];
        correct(&mut rows, 0.05);
        let clear = rows.each_ref().map(|row| row.clear);
        assert_eq!(clear, [true, true, true, false, false]);
        let corrected = rows.each_ref().map(|row| row.corrected_p);
        assert_eq!(corrected, [Some(0.04), Some(0.04), Some(0.04), None, None]);
    }
}
