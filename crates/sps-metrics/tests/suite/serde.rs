//! What was written can be read.

use sps_metrics::{Intervals, Level, Metric, Samples, Scored, Scores, TrainingMean};

#[test]
fn scores_and_intervals_survive_json() {
    let samples = Samples {
        truth: &[0.0, 3.0, 1.0, 7.0],
        estimate: &[0.5, 2.0, 1.0, 6.0],
    };
    // One reason inside another.
    let scores = Scores::of(samples, TrainingMean::of(&[f64::NAN]));
    let text = serde_json::to_string(&scores).expect("it is plain data");
    assert_eq!(
        serde_json::from_str::<Scores>(&text).expect("as written"),
        scores
    );

    let interval = Intervals::of_models(Level::P95).interval(&[Scored {
        metric: Metric::Mae,
        samples,
        units: None,
        rerun: 0,
    }]);
    let interval = interval.expect("four surfaces");
    let text = serde_json::to_string(&interval).expect("it is plain data");
    assert_eq!(interval, serde_json::from_str(&text).expect("as written"));
    assert!(serde_json::from_str::<Level>("1.5").is_err());
}
