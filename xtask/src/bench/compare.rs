//! What moved since a baseline.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use super::budgets::{Budgets, Ratio};
use super::measured::{Measured, Wall};

/// Everything measured, beside its baseline where there is one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Comparison(Vec<Part>);

/// Numbers of one kind.
#[derive(Clone, Debug, PartialEq)]
struct Part {
    title: String,
    rows: Vec<Row>,
}

#[derive(Clone, Debug, PartialEq)]
struct Row {
    name: String,
    then: String,
    now: String,
    judged: Judged,
}

/// What a change amounts to.
#[derive(Clone, Debug, Default, PartialEq)]
struct Judged {
    change: String,
    budget: String,
    verdict: Verdict,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Verdict {
    #[default]
    None,
    Within,
    Past,
    Slower,
    Faster,
    New,
    NotMeasured,
}

impl Verdict {
    fn within(within: bool) -> Self {
        if within { Self::Within } else { Self::Past }
    }

    const fn text(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Within => "within",
            Self::Past => "PAST",
            Self::Slower => "slower",
            Self::Faster => "faster",
            Self::New => "new",
            Self::NotMeasured => "not measured",
        }
    }
}

/// Sets `now` beside `then`.
pub(crate) fn compare(budgets: &Budgets, then: Option<&Measured>, now: &Measured) -> Comparison {
    let parts = [
        scores(budgets, then, now),
        instructions(budgets, then, now),
        ratios(budgets, then, now),
        wall(then, now),
    ];
    Comparison(parts.into_iter().filter(|p| !p.rows.is_empty()).collect())
}

fn scores(budgets: &Budgets, then: Option<&Measured>, now: &Measured) -> Part {
    let show = |score: &Option<f64>| score.map_or("null".to_owned(), |score| format!("{score:.4}"));
    let judge = |_: &str, then: &Option<f64>, now: &Option<f64>| match (then, now) {
        (Some(then), Some(now)) => {
            let around = budgets.scores.around(*then);
            Judged {
                change: format!("{:+.4}", now - then),
                budget: format!("±{around:.4}"),
                verdict: Verdict::within((now - then).abs() <= around),
            }
        }
        _ => Judged {
            verdict: Verdict::within(then == now),
            ..Judged::default()
        },
    };
    Part {
        title: "Scores of the run".to_owned(),
        rows: rows(then.map(|then| &then.scores), &now.scores, show, judge),
    }
}

fn instructions(budgets: &Budgets, then: Option<&Measured>, now: &Measured) -> Part {
    let other = then.and_then(|then| then.machine.other_instructions(&now.machine));
    let judge = |_: &str, then: &u64, now: &u64| {
        growth(*then as f64, *now as f64, budgets.instructions.more)
    };
    let then = then.map(|then| &then.instructions);
    part("Instructions of the kernels", other, |compared| {
        rows(
            then.filter(|_| compared),
            &now.instructions,
            |&n| thousands(n),
            judge,
        )
    })
}

fn ratios(budgets: &Budgets, then: Option<&Measured>, now: &Measured) -> Part {
    let other = then.and_then(|then| then.machine.other_ratios(&now.machine));
    let judge = |name: &str, then: &f64, now: &f64| {
        let mut budgets = budgets.ratios.iter();
        let budget = budgets.find(|ratio| ratio.name == name);
        budget.map_or_else(Judged::default, |budget| growth(*then, *now, budget.more))
    };
    let then = then.map(|then| &then.ratios);
    part("Ratios of wall times within the run", other, |compared| {
        rows(
            then.filter(|_| compared),
            &now.ratios,
            |r| format!("{r:.3}"),
            judge,
        )
    })
}

/// The ratios that are past their budgets.
pub(crate) fn ratios_past<'b>(
    budgets: &'b Budgets,
    then: Option<&Measured>,
    now: &Measured,
) -> Vec<&'b Ratio> {
    let rows = ratios(budgets, then, now).rows;
    let past = |name: &str| {
        let mut rows = rows.iter();
        rows.any(|row| row.name == name && row.judged.verdict == Verdict::Past)
    };
    let budgets = budgets.ratios.iter();
    budgets.filter(|ratio| past(&ratio.name)).collect()
}

fn wall(then: Option<&Measured>, now: &Measured) -> Part {
    let show = |wall: &Wall| seconds(wall.median);
    let judge = |_: &str, then: &Wall, now: &Wall| {
        let low = now.interval[0] / then.interval[1] - 1.0;
        let high = now.interval[1] / then.interval[0] - 1.0;
        let change = now.median / then.median - 1.0;
        Judged {
            change: format!("{} [{}, {}]", percent(change), percent(low), percent(high)),
            budget: String::new(),
            verdict: match (low > 0.0, high < 0.0) {
                (true, _) => Verdict::Slower,
                (_, true) => Verdict::Faster,
                _ => Verdict::None,
            },
        }
    };
    let mut rows = rows(then.map(|then| &then.wall), &now.wall, show, judge);
    rows.retain(|row| row.judged.verdict != Verdict::NotMeasured);
    Part {
        title: "Wall times: median of a pass; no budget".to_owned(),
        rows,
    }
}

/// A part whose baseline counts only where there is no reason against it.
fn part(title: &str, other: Option<String>, rows: impl FnOnce(bool) -> Vec<Row>) -> Part {
    let rows = rows(other.is_none());
    Part {
        title: match other {
            Some(reason) => format!("{title}: not compared, {reason}"),
            None => title.to_owned(),
        },
        rows,
    }
}

/// A number that may grow by the share `more`, and shrink as it likes.
fn growth(then: f64, now: f64, more: f64) -> Judged {
    let change = now / then - 1.0;
    Judged {
        change: percent(change),
        budget: percent(more),
        verdict: Verdict::within(change <= more),
    }
}

/// The rows of everything that is on either side; nothing where nothing is there now.
fn rows<T>(
    then: Option<&BTreeMap<String, T>>,
    now: &BTreeMap<String, T>,
    show: impl Fn(&T) -> String,
    judge: impl Fn(&str, &T, &T) -> Judged,
) -> Vec<Row> {
    if now.is_empty() {
        return Vec::new();
    }
    let names = then.into_iter().flat_map(BTreeMap::keys).chain(now.keys());
    let names: BTreeSet<&String> = names.collect();
    let row = |name: &String| {
        let (before, after) = (then.and_then(|then| then.get(name)), now.get(name));
        let judged = match (before, after) {
            (Some(then), Some(now)) => judge(name, then, now),
            (Some(_), None) => Verdict::NotMeasured.into(),
            _ if then.is_some() => Verdict::New.into(),
            _ => Judged::default(),
        };
        Row {
            name: name.clone(),
            then: before.map(&show).unwrap_or_default(),
            now: after.map(&show).unwrap_or_default(),
            judged,
        }
    };
    names.into_iter().map(row).collect()
}

impl From<Verdict> for Judged {
    fn from(verdict: Verdict) -> Self {
        Self {
            verdict,
            ..Self::default()
        }
    }
}

impl Comparison {
    /// What is past its budget, in words: also what has one and is no longer measured.
    pub(crate) fn past(&self) -> Vec<String> {
        let rows = self.0.iter().flat_map(|part| &part.rows);
        let past = rows.filter_map(
            |Row {
                 name,
                 then,
                 now,
                 judged,
             }| {
                let Judged {
                    change,
                    budget,
                    verdict,
                } = judged;
                match verdict {
                    Verdict::Past => Some(format!(
                        "{name} ({then} to {now}: {change}, budget {budget})"
                    )),
                    Verdict::NotMeasured => Some(format!("{name} ({then}, not measured)")),
                    _ => None,
                }
            },
        );
        past.collect()
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Part { title, rows } in &self.0 {
            writeln!(f, "\n{title}")?;
            let cells = rows.iter().map(Row::cells);
            let header = ["", "then", "now", "change", "budget", ""].map(str::to_owned);
            let table: Vec<[String; 6]> = [header].into_iter().chain(cells).collect();
            let width = |column: usize| {
                let widths = table.iter().map(|cells| cells[column].chars().count());
                widths.max().unwrap_or_default()
            };
            let widths: [usize; 6] = std::array::from_fn(width);
            for [name, numbers @ .., verdict] in &table {
                let cells = numbers.iter().zip(&widths[1..]);
                let cells: Vec<String> = cells
                    .map(|(cell, width)| format!("  {cell:>width$}"))
                    .collect();
                let line = format!("  {name:<0$}{1}  {verdict}", widths[0], cells.concat());
                writeln!(f, "{}", line.trim_end())?;
            }
        }
        Ok(())
    }
}

impl Row {
    fn cells(&self) -> [String; 6] {
        let Judged {
            change,
            budget,
            verdict,
        } = &self.judged;
        [
            &self.name,
            &self.then,
            &self.now,
            change,
            budget,
            verdict.text(),
        ]
        .map(ToString::to_string)
    }
}

fn percent(share: f64) -> String {
    format!("{:+.1} %", 100.0 * share)
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
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::budgets::{Instructions, Scores};
    use super::super::machine::Machine;
    use super::*;

    fn budgets() -> Budgets {
        Budgets {
            instructions: Instructions { more: 0.02 },
            scores: Scores {
                absolute: 0.01,
                relative: 0.0,
            },
            ratios: vec![Ratio {
                name: "a over b".to_owned(),
                of: "a".to_owned(),
                over: "b".to_owned(),
                more: 0.4,
            }],
        }
    }

    fn measured() -> Measured {
        let wall = Wall {
            median: 2.0,
            interval: [1.5, 2.5],
            shortest: 1.4,
            elements: 1.0,
        };
        Measured {
            machine: Machine {
                processor: "one".to_owned(),
                cores: 2,
                vectors: "AVX2".to_owned(),
                rustc: "rustc 1".to_owned(),
                valgrind: Some("valgrind 3".to_owned()),
            },
            ratios: BTreeMap::from([("a over b".to_owned(), 0.2)]),
            instructions: BTreeMap::from([("kernel".to_owned(), 1_000_000)]),
            scores: BTreeMap::from([("r".to_owned(), Some(0.5)), ("s".to_owned(), None)]),
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
        assert!(
            alone.contains("1 000 000") && !alone.contains("new"),
            "{alone}"
        );
    }

    #[test]
    fn each_kind_has_its_budget() {
        let count = |count| {
            past(|m| {
                m.instructions.insert("kernel".to_owned(), count);
            })
        };
        assert_eq!(
            count(1_030_000),
            ["kernel (1 000 000 to 1 030 000: +3.0 %, budget +2.0 %)"]
        );
        assert!(count(1_019_000).is_empty() && count(10).is_empty());
        let ratio = |ratio| {
            past(|m| {
                m.ratios.insert("a over b".to_owned(), ratio);
            })
        };
        assert_eq!((ratio(0.27).len(), ratio(0.29).len()), (0, 1));
        let score = |name: &str, score| {
            past(|m| {
                m.scores.insert(name.to_owned(), score);
            })
        };
        assert!(score("r", Some(0.505)).is_empty());
        // A score that became better is no longer what was committed either.
        assert_eq!(
            score("r", Some(0.52)),
            ["r (0.5000 to 0.5200: +0.0200, budget ±0.0100)"]
        );
        assert_eq!(
            (score("r", None).len(), score("s", Some(0.1)).len()),
            (1, 1)
        );
        let lost = past(|m| {
            m.scores.remove("r");
        });
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
