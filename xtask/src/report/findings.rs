//! What a run found, in three sentences.

use super::summary::best;
use super::table::{counted, with_interval};
use crate::results::{MethodResult, Results};

/// The best method, what it is ahead of, and which properties it estimates best and worst.
pub(super) fn of(results: &Results) -> Vec<String> {
    let Some(best) = best(results) else {
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
        "{} is the best method: mean R² {score} over {properties}, on {} that it was not trained on. 0 is \
         guessing the mean, 1 is no error.",
        best.label,
        counted(best.held_out_surfaces, "surface")
    ))
}

/// Against what the config compares with.
fn ahead(results: &Results, best: &MethodResult) -> Option<String> {
    let (mut ahead, mut level) = (Vec::new(), Vec::new());
    for other in results.compared_with() {
        let Some(gain) = best.gains.r2_mean_gains.get(&other.id) else {
            continue;
        };
        match gain.interval {
            Some([low, _]) if low > 0.0 => {
                ahead.push(format!("{} (+{:.2})", other.label, gain.value));
            }
            Some(_) => level.push(other.label.clone()),
            None => (),
        }
    }
    let ahead = (!ahead.is_empty()).then(|| format!("It is ahead of {}", listed(&ahead)));
    let level = (!level.is_empty()).then(|| {
        format!(
            "chance does not rule out that {} does as well",
            listed(&level)
        )
    });
    match (ahead, level) {
        (Some(ahead), Some(level)) => Some(format!("{ahead}; {level}.")),
        (Some(ahead), None) => Some(format!("{ahead}.")),
        (None, Some(level)) => Some(format!("Beside it, {level}.")),
        (None, None) => None,
    }
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
    use crate::results::Gain;
    use crate::results::schema::file;

    #[test]
    fn a_run_is_told_in_sentences() {
        let results: Results = serde_json::from_value(file()).unwrap();
        let found = of(&results);
        assert!(
            found[0].contains("is the best method: mean R² 0.50 [0.40, 0.60] over"),
            "{found:?}"
        );

        let mut results = results;
        let mut network = results.methods[0].clone();
        (network.id, network.label) = ("network".to_owned(), "Network".to_owned());
        network.means.r2_mean = Some(0.75);
        let gain = |low| Gain {
            value: 0.25,
            interval: Some([low, 0.4]),
            p: None,
        };
        network
            .gains
            .r2_mean_gains
            .insert("ridge".to_owned(), gain(0.1));
        results.methods.push(network);
        results.against = vec!["ridge".to_owned()];
        assert_eq!(of(&results)[1], "It is ahead of Ridge (+0.25).");
        let gains = &mut results.methods[1].gains.r2_mean_gains;
        gains.insert("ridge".to_owned(), gain(-0.1));
        let level = "Beside it, chance does not rule out that Ridge does as well.";
        assert_eq!(of(&results)[1], level);
        assert_eq!(listed(&["a", "b", "c"].map(str::to_owned)), "a, b and c");
    }
}
