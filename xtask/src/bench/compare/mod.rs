//! What moved since a baseline.

mod table;

use std::collections::{BTreeMap, BTreeSet};

use sps_metrics::{holm, over_reruns};

use super::budgets::{Budgets, Ratio};
use super::measured::{Measured, Wall};
use table::{Change, Comparison, Part, Row, Verdict, percent};

/// Sets `now` beside `then`.
pub(crate) fn compare(budgets: &Budgets, then: Option<&Measured>, now: &Measured) -> Comparison {
    let around = |score| budgets.scores.around(score);
    let parts = [
        scores(around, then.map(|then| &then.scores), &now.scores),
        instructions(budgets, then, now),
        ratios(budgets, then, now),
        wall(then, now),
    ];
    Comparison(parts.into_iter().filter(|p| !p.rows.is_empty()).collect())
}

/// Scores in each rerun, by their names.
type Scores = BTreeMap<String, Vec<f64>>;

/// Chance alone makes any score past its budget in so many runs.
const CHANCE: f64 = 0.05;

/// A mean score may lie as far from the baseline's as `around` says of that, and further where the reruns differ so
/// much that it may be chance, after Holm's correction for how many scores there are.
fn scores(around: impl Fn(f64) -> f64, then: Option<&Scores>, now: &Scores) -> Part {
    let mean = |scores: &Vec<f64>| over_reruns(scores.iter().copied().map(Ok)).mean.ok();
    let show =
        |scores: &Vec<f64>| mean(scores).map_or("none".to_owned(), |mean| format!("{mean:.4}"));
    let chance = then.map(|then| chance(then, now)).unwrap_or_default();
    let judge = |name: &str, then: &Vec<f64>, now: &Vec<f64>| match (mean(then), mean(now)) {
        (Some(before), Some(after)) => {
            let around = around(before);
            let may_be_chance = chance.get(name).is_some_and(|p| *p > CHANCE);
            let within = (after - before).abs() <= around;
            Change {
                by: format!("{:+.4}", after - before),
                budget: format!("±{around:.4}"),
                verdict: match (within, may_be_chance) {
                    (true, _) => Verdict::Within,
                    (false, true) => Verdict::Chance,
                    (false, false) => Verdict::Past,
                },
            }
        }
        _ => Verdict::within(then == now).into(),
    };
    Part {
        title: "Scores of the run".to_owned(),
        rows: rows(then, now, show, judge),
    }
}

/// The corrected p-value of each score that has as many reruns in both.
fn chance(then: &Scores, now: &Scores) -> BTreeMap<String, f64> {
    let both = then.iter().filter_map(|(name, then)| {
        let now = now.get(name).filter(|now| now.len() == then.len())?;
        let differences = then.iter().zip(now).map(|(then, now)| Ok(now - then));
        Some((name.clone(), over_reruns(differences).p_value().ok()?))
    });
    let (names, p_values): (Vec<String>, Vec<f64>) = both.unzip();
    names.into_iter().zip(holm(&p_values)).collect()
}

fn instructions(budgets: &Budgets, then: Option<&Measured>, now: &Measured) -> Part {
    let other = then.and_then(|then| then.machine.other_instructions(&now.machine));
    let judge = |_: &str, then: &u64, now: &u64| {
        Change::growth(*then as f64, *now as f64, budgets.instructions.more)
    };
    let then = then.filter(|_| other.is_none());
    let then = then.map(|then| &then.instructions);
    let show = |&count: &u64| thousands(count);
    Part {
        title: title("Instructions of the kernels", other),
        rows: rows(then, &now.instructions, show, judge),
    }
}

fn ratios(budgets: &Budgets, then: Option<&Measured>, now: &Measured) -> Part {
    let other = then.and_then(|then| then.machine.other_ratios(&now.machine));
    let judge = |name: &str, then: &f64, now: &f64| {
        let mut budgets = budgets.ratios.iter();
        let budget = budgets.find(|ratio| ratio.name == name);
        budget.map_or_else(Change::default, |budget| {
            Change::growth(*then, *now, budget.more)
        })
    };
    let then = then.filter(|_| other.is_none());
    let then = then.map(|then| &then.ratios);
    let show = |ratio: &f64| format!("{ratio:.3}");
    Part {
        title: title("Ratios of wall times within the run", other),
        rows: rows(then, &now.ratios, show, judge),
    }
}

/// The ratios that are past their budgets.
pub(crate) fn ratios_past<'b>(
    budgets: &'b Budgets,
    then: Option<&Measured>,
    now: &Measured,
) -> Vec<&'b Ratio> {
    let mut rows = ratios(budgets, then, now).rows;
    rows.retain(|row| row.change.verdict == Verdict::Past);
    let past = |ratio: &&Ratio| rows.iter().any(|row| row.name == ratio.name);
    budgets.ratios.iter().filter(past).collect()
}

fn wall(then: Option<&Measured>, now: &Measured) -> Part {
    let show = |wall: &Wall| seconds(wall.median);
    let judge = |_: &str, then: &Wall, now: &Wall| {
        let low = now.interval[0] / then.interval[1] - 1.0;
        let high = now.interval[1] / then.interval[0] - 1.0;
        let change = now.median / then.median - 1.0;
        Change {
            by: format!("{} [{}, {}]", percent(change), percent(low), percent(high)),
            budget: String::new(),
            verdict: match (low > 0.0, high < 0.0) {
                (true, _) => Verdict::Slower,
                (_, true) => Verdict::Faster,
                _ => Verdict::None,
            },
        }
    };
    let mut rows = rows(then.map(|then| &then.wall), &now.wall, show, judge);
    rows.retain(|row| row.change.verdict != Verdict::NotMeasured);
    Part {
        title: "Wall times: median of a pass; no budget".to_owned(),
        rows,
    }
}

/// With the reason why the baseline does not count, if there is one.
fn title(title: &str, other: Option<String>) -> String {
    let reason = other.map(|reason| format!(": not compared, {reason}"));
    format!("{title}{}", reason.unwrap_or_default())
}

/// The rows of everything that is on either side; nothing where nothing is there now.
fn rows<T>(
    then: Option<&BTreeMap<String, T>>,
    now: &BTreeMap<String, T>,
    show: impl Fn(&T) -> String,
    judge: impl Fn(&str, &T, &T) -> Change,
) -> Vec<Row> {
    if now.is_empty() {
        return Vec::new();
    }
    let names = then.into_iter().flat_map(BTreeMap::keys).chain(now.keys());
    let names: BTreeSet<&String> = names.collect();
    let row = |name: &String| {
        let (before, after) = (then.and_then(|then| then.get(name)), now.get(name));
        let change = match (before, after) {
            (Some(then), Some(now)) => judge(name, then, now),
            (Some(_), None) => Verdict::NotMeasured.into(),
            _ if then.is_some() => Verdict::New.into(),
            _ => Change::default(),
        };
        Row {
            name: name.clone(),
            then: before.map(&show).unwrap_or_default(),
            now: after.map(&show).unwrap_or_default(),
            change,
        }
    };
    names.into_iter().map(row).collect()
}

fn seconds(seconds: f64) -> String {
    match seconds {
        s if s >= 1.0 => format!("{s:.2} s"),
        s if s >= 1e-3 => format!("{:.2} ms", 1e3 * s),
        s => format!("{:.2} µs", 1e6 * s),
    }
}

/// With a space after every third digit.
fn thousands(count: u64) -> String {
    let digits = count.to_string();
    let threes: Vec<&[u8]> = digits.as_bytes().rchunks(3).rev().collect();
    String::from_utf8_lossy(&threes.join(&b' ')).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::machine::Machine;

    fn budgets() -> Budgets {
        let budgets = "instructions.more = 0.02\nscores = { absolute = 0.01, relative = 0.0 }\n\
            ratio = [{ name = 'a over b', of = 'a', over = 'b', more = 0.4 }]";
        toml::from_str(budgets).unwrap()
    }

    fn measured() -> Measured {
        let wall = Wall {
            median: 2.0,
            interval: [1.5, 2.5],
            shortest: 1.4,
            elements: 1.0,
        };
        Measured {
            machine: Machine::default(),
            ratios: BTreeMap::from([("a over b".to_owned(), 0.2)]),
            instructions: BTreeMap::from([("kernel".to_owned(), 1_000_000)]),
            scores: BTreeMap::from([("r".to_owned(), vec![0.4, 0.6]), ("s".to_owned(), vec![])]),
            wall: BTreeMap::from([("b".to_owned(), wall)]),
        }
    }

    fn past(change: impl FnOnce(&mut Measured)) -> Vec<String> {
        let mut now = measured();
        change(&mut now);
        compare(&budgets(), Some(&measured()), &now).past()
    }

    #[test]
    fn nothing_moved_nothing_past() {
        assert!(past(|_| ()).is_empty());
        let alone = compare(&budgets(), None, &measured()).to_string();
        assert!(alone.contains("1 000 000"), "{alone}");
        assert!(!alone.contains("new"), "{alone}");
    }

    #[test]
    fn each_kind_has_its_budget() {
        let count = |count| past(|m| m.instructions.extend([("kernel".to_owned(), count)]));
        let more = "kernel (1 000 000 to 1 030 000: +3.0 %, budget +2.0 %)";
        assert_eq!(count(1_030_000), [more]);
        assert!(count(1_019_000).is_empty() && count(10).is_empty());
        let ratio = |ratio| past(|m| m.ratios.extend([("a over b".to_owned(), ratio)]));
        assert_eq!((ratio(0.27).len(), ratio(0.29).len()), (0, 1));
        let score = |name: &str, score| past(|m| m.scores.extend([(name.to_owned(), score)]));
        assert!(score("r", vec![0.405, 0.605]).is_empty());
        // A score that became better is no longer what was committed either.
        let better = "r (0.5000 to 0.5200: +0.0200, budget ±0.0100)";
        assert_eq!(score("r", vec![0.42, 0.62]), [better]);
        // One rerun up by 0.01, one by 0.03: that is as likely as not in two. One rerun alone, or
        // another number of them, says nothing of chance.
        assert!(score("r", vec![0.41, 0.63]).is_empty());
        assert_eq!(score("r", vec![0.52]).len(), 1);
        assert_eq!(score("r", vec![]).len(), 1);
        assert_eq!(score("s", vec![0.1]).len(), 1);
        let lost = past(|m| m.scores.retain(|name, _| name != "r"));
        assert_eq!(lost, ["r (0.5000, not measured)"]);
        let slow = past(|m| m.wall.values_mut().for_each(|wall| wall.median = 90.0));
        assert!(slow.is_empty(), "{slow:?}");
    }

    #[test]
    fn other_machines_are_not_compared() {
        let slow = |m: &mut Measured| {
            m.instructions.insert("kernel".to_owned(), 9_000_000);
            m.ratios.insert("a over b".to_owned(), 9.0);
        };
        assert_eq!(past(slow).len(), 2);
        let rest = past(|m| {
            slow(m);
            m.machine.rustc = "rustc 2".to_owned();
        });
        assert_eq!(rest.len(), 1, "{rest:?}");
        let rest = past(|m| {
            slow(m);
            m.machine.vectors = "AVX-512".to_owned();
        });
        assert!(rest.len() == 1 && rest[0].starts_with("kernel"), "{rest:?}");
    }

    #[test]
    fn the_interval_of_a_wall_time_says_whether_it_moved() {
        let mut now = measured();
        let wall = now.wall.get_mut("b").unwrap();
        *wall = Wall {
            median: 4.0,
            interval: [3.0, 4.5],
            ..*wall
        };
        let text = compare(&budgets(), Some(&measured()), &now).to_string();
        // 3.0 / 2.5 and 4.5 / 1.5.
        assert!(text.contains("+100.0 % [+20.0 %, +200.0 %]"), "{text}");
        assert!(text.contains("slower"), "{text}");
    }
}
