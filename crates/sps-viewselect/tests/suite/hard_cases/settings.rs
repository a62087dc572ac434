//! Settings out of their range are refused by name.

use sps_viewselect::{
    Baseline, Exhaustive, Greedy, Nadir, Nvs, Random, SelectError, Selector, SetFunction, VbNvs,
};

use crate::support::problem;

/// Holds a selector to refuse a setting.
fn refuses(setting: &str, selector: &dyn Selector) {
    let loss = SetFunction::new(5, 2, |_: &[usize]| 0.0);
    match selector.select(&problem(&loss)) {
        Err(SelectError::Setting { field, .. }) => assert_eq!(field, setting),
        other => panic!("{setting}: {other:?}"),
    }
}

fn changed<S: Default>(change: impl Fn(&mut S)) -> S {
    let mut selector = S::default();
    change(&mut selector);
    selector
}

#[test]
fn each_setting_out_of_range_is_named() {
    let nvs = |setting, change: &dyn Fn(&mut Nvs)| refuses(setting, &changed::<Nvs>(change));
    let vb_nvs = |setting, change: &dyn Fn(&mut VbNvs)| refuses(setting, &changed::<VbNvs>(change));
    refuses("draws", &Random { draws: 0 });
    refuses("view", &Nadir { view: Some(5) });
    refuses("starts", &changed(|greedy: &mut Greedy| greedy.starts = 0));
    for block in [0, (1 << 24) + 1, usize::MAX] {
        refuses("block", &Exhaustive { block, limit: 99 });
    }
    nvs("evaluations", &|nvs| nvs.evaluations = 0);
    nvs("batch", &|nvs| nvs.policy.batch = 0);
    for strange in [f64::NAN, f64::INFINITY, -1.0] {
        nvs("learning-rate", &|nvs| nvs.policy.learning_rate = strange);
        nvs("entropy-weight", &|nvs| nvs.policy.entropy_weight = strange);
        vb_nvs("learning-rate", &|vb| vb.value.learning_rate = strange);
        vb_nvs("weight", &|vb| vb.value.weight = strange);
        let moving = Baseline::MovingMean { decay: strange };
        nvs("decay", &|nvs| nvs.policy.baseline = moving);
    }
    vb_nvs("batch", &|vb| vb.policy.batch = 0);
    vb_nvs("hidden", &|vb| vb.value.hidden = 0);
    vb_nvs("steps", &|vb| vb.value.steps = 0);
    vb_nvs("batch", &|vb| vb.value.batch = 0);
    vb_nvs("starts", &|vb| vb.search.starts = 1);
    vb_nvs("combinations", &|vb| vb.search.combinations = 0);
    vb_nvs("shortlist", &|vb| vb.search.shortlist = 0);
    vb_nvs("rounds", &|vb| vb.search.rounds = 0);
    vb_nvs("evaluations", &|vb| vb.evaluations = 1000);
}
