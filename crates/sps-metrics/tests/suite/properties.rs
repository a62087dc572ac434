//! Means over properties and over reruns.

use sps_metrics::{
    Better, PropertyScore, Undefined, mean_over_all, mean_over_best, mean_over_named, over_reruns,
};

fn scores(values: &[(&str, Result<f64, Undefined>)]) -> Vec<PropertyScore> {
    let scores = values.iter().map(|(property, value)| PropertyScore {
        property: (*property).to_owned(),
        value: value.clone(),
    });
    scores.collect()
}

#[test]
fn undefined_properties_are_left_out_and_reported() {
    let scores = scores(&[
        ("fRS", Ok(2.0)),
        ("cDF", Err(Undefined::AllTruthsZero { samples: 7 })),
        ("tCO", Ok(6.0)),
        ("cYD", Ok(1.0)),
    ]);
    let reported = [("cDF".to_owned(), Undefined::AllTruthsZero { samples: 7 })];

    let all = mean_over_all(&scores);
    assert_eq!(all.value, Ok(3.0));
    assert_eq!(all.properties, ["fRS", "tCO", "cYD"]);
    assert_eq!(all.left_out, reported);
    assert!(!all.is_complete());

    let named = mean_over_named(&scores, &["cDF", "cYD"]);
    assert_eq!(named.value, Ok(1.0));
    assert_eq!(named.left_out, reported);

    let best = mean_over_best(&scores, 2, Better::Higher);
    assert_eq!(best.value, Ok(4.0));
    assert_eq!(best.properties, ["tCO", "fRS"]);
    assert_eq!(best.left_out, reported);
    assert!(best.is_complete());

    let too_many = mean_over_best(&scores, 8, Better::Lower);
    assert_eq!(too_many.value, Ok(3.0));
    assert_eq!((too_many.properties.len(), too_many.wanted), (3, 8));
    assert!(!too_many.is_complete());
}

#[test]
fn equal_scores_keep_their_order() {
    let scores = scores(&[
        ("a", Ok(0.0)),
        ("b", Ok(1.0)),
        ("c", Ok(-0.0)),
        ("d", Ok(1.0)),
    ]);
    let best = |better| mean_over_best(&scores, 3, better).properties;
    assert_eq!(best(Better::Higher), ["b", "d", "a"]);
    assert_eq!(best(Better::Lower), ["a", "c", "b"]);
}

#[test]
fn nothing_to_average_says_so() {
    let undefined = scores(&[("fRS", Err(Undefined::Empty))]);
    let nothing = Err(Undefined::NothingDefined { of: 1 });
    assert_eq!(mean_over_all(&undefined).value, nothing);
    assert_eq!(mean_over_named(&[], &["fRS"]).value, nothing);
    let left_out = [("fRS".to_owned(), Undefined::NotScored)];
    assert_eq!(mean_over_named(&[], &["fRS"]).left_out, left_out);
    let nothing = Err(Undefined::NothingDefined { of: 8 });
    assert_eq!(mean_over_best(&[], 8, Better::Lower).value, nothing);
}

#[test]
fn a_property_counts_once() {
    let twice = scores(&[("fRS", Ok(1.0)), ("fRS", Ok(2.0))]);
    let repeated = Err(Undefined::RepeatedProperty {
        property: "fRS".to_owned(),
    });
    assert_eq!(mean_over_all(&twice).value, repeated);
    assert_eq!(mean_over_best(&twice, 1, Better::Lower).value, repeated);
    assert_eq!(mean_over_named(&twice, &["fRS"]).value, repeated);
    let named = mean_over_named(&twice[..1], &["fRS", "fRS"]);
    assert_eq!(named.value, repeated);
}

#[test]
fn a_score_that_is_not_finite_is_none() {
    let scores = scores(&[("fRS", Ok(f64::NAN)), ("cDF", Ok(4.0))]);
    let mean = mean_over_all(&scores);
    assert_eq!(mean.value, Ok(4.0));
    let reason = mean.left_out[0].1.to_string();
    assert_eq!(reason, "value 0 is NaN (1 of 1 samples are not finite)");
    let best = mean_over_best(&scores, 2, Better::Higher);
    assert_eq!(best.properties, ["cDF"]);
}

#[test]
fn reruns_have_mean_and_sample_deviation() {
    // Deviations -1.5, -0.5, 0.5, 1.5: squares sum to 5, of which a third.
    let summary = over_reruns([1.0, 2.0, 3.0, 4.0].map(Ok));
    assert_eq!(summary.mean, Ok(2.5));
    assert_eq!(summary.std, Ok((5.0_f64 / 3.0).sqrt()));

    let one = over_reruns([Err(Undefined::Empty), Ok(0.5)]);
    assert_eq!(one.mean, Ok(0.5));
    let (found, needed) = (1, 2);
    assert_eq!(one.std, Err(Undefined::TooFewSamples { found, needed }));
    assert_eq!((one.reruns, one.left_out), (1, vec![(0, Undefined::Empty)]));

    let none = over_reruns([Err(Undefined::OutOfRange)]);
    assert_eq!(none.mean, Err(Undefined::NothingDefined { of: 1 }));
    assert_eq!(none.std, none.mean);
    assert_eq!(over_reruns([]).mean, Err(Undefined::Empty));
    assert!(over_reruns([Ok(1.0), Ok(f64::NAN)]).mean.is_err());
}
