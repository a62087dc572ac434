//! Selectors are read from a config, selections are written.

use sps_viewselect::{
    Baseline, Equidistant, EquidistantAt, Greedy, Nvs, Selection, SetFunction, TemporalRelations,
    VbNvs,
};

use crate::support::{problem, select};

#[test]
fn a_selector_is_read_from_toml() {
    let text = r"
        evaluations = 5000
        [policy]
        learning-rate = 0.1
        baseline = { moving-mean = { decay = 0.9 } }
        [search]
        shortlist = 7
    ";
    let found: VbNvs = toml::from_str(text).expect("a selector");
    let mut expected = VbNvs {
        evaluations: 5000,
        ..VbNvs::default()
    };
    expected.policy.learning_rate = 0.1;
    expected.policy.baseline = Baseline::MovingMean { decay: 0.9 };
    expected.search.shortlist = 7;
    assert_eq!(found, expected);
    let plain: Nvs = toml::from_str("policy = { baseline = \"none\" }").expect("a selector");
    assert_eq!(plain.policy.baseline, Baseline::None);
    let relations: TemporalRelations = toml::from_str("scales = [2]").expect("relations");
    assert_eq!(relations.scales, [2]);
    let ends: Equidistant = toml::from_str("at = \"ends\"").expect("a selector");
    assert_eq!(ends.at, EquidistantAt::Ends);
    let centres: Equidistant = toml::from_str("at = \"centres\"").expect("a selector");
    let default: Equidistant = toml::from_str("").expect("a selector");
    assert_eq!((centres, default), (Equidistant::default(), centres));
    assert!(toml::from_str::<Equidistant>("at = \"middle\"").is_err());
}

#[test]
fn unknown_keys_are_refused() {
    for (text, key) in [("star = 3", "star"), ("pair_width = 3", "pair_width")] {
        let error = toml::from_str::<Greedy>(text).expect_err("an unknown key");
        assert!(error.to_string().contains(key), "{error}");
    }
    assert!(toml::from_str::<Nvs>("policy = { rate = 1.0 }").is_err());
}

#[test]
fn a_selection_survives_json() {
    let loss = SetFunction::new(5, 2, |set: &[usize]| set[0] as f64 / 3.0);
    let selection = select(&Greedy::default(), &problem(&loss));
    let text = serde_json::to_string(&selection).expect("JSON");
    let back: Selection = serde_json::from_str(&text).expect("a selection");
    assert_eq!(back, selection);
}
