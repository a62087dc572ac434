//! What a run found, in three sentences.

use sps_experiment::results::{MethodResult, Results};
use sps_experiment::text::counted;
use sps_metrics::holm;

use super::table::with_interval;

/// The best method, what it is ahead of, and which properties it estimates best and worst.
pub(super) fn of(results: &Results) -> Vec<String> {
    let Some(best) = results.best() else {
        return Vec::new();
    };
    let sentences = [
        scored(results, best),
        ahead(results, best),
        properties(results, best),
    ];
    sentences.into_iter().flatten().collect()
}

fn scored(results: &Results, best: &MethodResult) -> Option<String> {
    best.means.r2_mean?;
    let score = with_interval(best.means.r2_mean, best.means.r2_mean_interval, 2);
    let properties = match results.properties.len() {
        1 => "one property".to_owned(),
        count => format!("{count} properties"),
    };
    Some(format!(
        "{} has the highest mean R²: {score} over {properties}, on {} that it was not trained on. 0 is guessing \
         the mean, 1 is no error.",
        best.label,
        counted(best.held_out_surfaces, "surface")
    ))
}

/// Against what the config compares with, corrected for how many that are.
fn ahead(results: &Results, best: &MethodResult) -> Option<String> {
    let gains = &best.gains.r2_mean_gains;
    let compared = results.compared_with().into_iter();
    let tested: Vec<_> = compared
        .filter_map(|other| Some((other, gains.get(&other.id)?.value, gains.get(&other.id)?.p?)))
        .collect();
    let p_values: Vec<f64> = tested.iter().map(|&(_, _, p)| p).collect();
    let [mut ahead, mut level, mut behind] = [const { Vec::new() }; 3];
    for ((other, gain, _), p) in tested.into_iter().zip(holm(&p_values)) {
        let with_gain = format!("{} ({gain:+.3})", other.label);
        match p <= 1.0 - results.interval_level {
            true if gain > 0.0 => ahead.push(with_gain),
            true => behind.push(with_gain),
            false => level.push(other.label.clone()),
        }
    }
    let said = [
        ("it is ahead of", ahead),
        ("it is behind", behind),
        ("it cannot be told apart from", level),
    ];
    let said = said.into_iter().filter(|(_, names)| !names.is_empty());
    let said = said.map(|(what, names)| format!("{what} {}", listed(&names)));
    let said: Vec<String> = said.collect();
    (!said.is_empty()).then(|| format!("Compared with others, {}.", said.join("; ")))
}

fn properties(results: &Results, best: &MethodResult) -> Option<String> {
    let scores = results.properties.iter();
    let mut scores: Vec<(&String, f64)> = scores
        .filter_map(|name| Some((name, best.scores.r2.get(name).copied()??)))
        .collect();
    scores.sort_by(|a, b| b.1.total_cmp(&a.1));
    let [(first, high), .., (last, low)] = scores[..] else {
        return None;
    };
    Some(format!(
        "It estimates {first} best (R² {high:.2}) and {last} worst ({low:.2})."
    ))
}

fn listed(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [one] => one.clone(),
        [some @ .., last] => format!("{} and {last}", some.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::file;
    use sps_experiment::results::Gain;

    #[test]
    fn a_run_is_told_in_sentences() {
        let mut results: Results = serde_json::from_value(file()).unwrap();
        let found = of(&results);
        let best = "has the highest mean R²: 0.50 [0.40, 0.60] over";
        assert!(found[0].contains(best), "{found:?}");

        let mut network = results.methods[0].clone();
        (network.id, network.label) = ("network".to_owned(), "Network".to_owned());
        network.means.r2_mean = Some(0.75);
        results.methods.push(network);
        results.against = vec!["ridge".to_owned()];
        for (value, p, said) in [
            (0.25, 0.01, "it is ahead of Ridge (+0.250)"),
            (0.25, 0.2, "it cannot be told apart from Ridge"),
            (-0.25, 0.01, "it is behind Ridge (-0.250)"),
        ] {
            let gain = Gain {
                value,
                interval: None,
                p: Some(p),
            };
            let gains = &mut results.methods[1].gains.r2_mean_gains;
            gains.insert("ridge".to_owned(), gain);
            let expected = format!("Compared with others, {said}.");
            assert_eq!(of(&results)[1], expected);
        }
        assert_eq!(listed(&["a", "b", "c"].map(str::to_owned)), "a, b and c");
    }
}
