//! What was written can be read.

use sps_metrics::Level;

#[test]
fn a_level_survives_json() {
    let text = serde_json::to_string(&Level::P95).expect("it is plain data");
    assert_eq!(
        serde_json::from_str::<Level>(&text).expect("as written"),
        Level::P95
    );
    assert!(serde_json::from_str::<Level>("1.5").is_err());
}
