//! Settings out of their range are refused by name.

use sps_viewselect::{
    Baseline, Exhaustive, Greedy, Nadir, Nvs, Random, SelectError, Selector, SetFunction, VbNvs,
};

use crate::support::problem;

fn refused(selector: &dyn Selector) -> &'static str {
    let loss = SetFunction::new(5, 2, |_: &[usize]| 0.0);
    match selector.select(&problem(&loss)) {
        Err(SelectError::Setting { field, .. }) => field,
        other => panic!("{other:?}"),
    }
}

fn nvs(change: impl Fn(&mut Nvs)) -> Nvs {
    let mut nvs = Nvs::default();
    change(&mut nvs);
    nvs
}

fn vb_nvs(change: impl Fn(&mut VbNvs)) -> VbNvs {
    let mut vb_nvs = VbNvs::default();
    change(&mut vb_nvs);
    vb_nvs
}

#[test]
fn each_setting_out_of_range_is_named() {
    assert_eq!(refused(&Random { draws: 0 }), "draws");
    assert_eq!(refused(&Nadir { view: Some(5) }), "view");
    assert_eq!(
        refused(&Greedy {
            starts: 0,
            pair_width: 3
        }),
        "starts"
    );
    for block in [0, (1 << 24) + 1, usize::MAX] {
        assert_eq!(refused(&Exhaustive { block, limit: 99 }), "block");
    }
    assert_eq!(refused(&nvs(|nvs| nvs.evaluations = 0)), "evaluations");
    assert_eq!(refused(&nvs(|nvs| nvs.policy.batch = 0)), "batch");
    for strange in [f64::NAN, f64::INFINITY, -1.0] {
        assert_eq!(
            refused(&nvs(|nvs| nvs.policy.learning_rate = strange)),
            "learning-rate"
        );
        assert_eq!(
            refused(&nvs(|nvs| nvs.policy.entropy_weight = strange)),
            "entropy-weight"
        );
        assert_eq!(
            refused(&vb_nvs(|vb| vb.value.learning_rate = strange)),
            "learning-rate"
        );
        assert_eq!(refused(&vb_nvs(|vb| vb.value.weight = strange)), "weight");
        let moving = Baseline::MovingMean { decay: strange };
        assert_eq!(refused(&nvs(|nvs| nvs.policy.baseline = moving)), "decay");
    }
    assert_eq!(refused(&vb_nvs(|vb| vb.policy.batch = 0)), "batch");
    assert_eq!(refused(&vb_nvs(|vb| vb.value.hidden = 0)), "hidden");
    assert_eq!(refused(&vb_nvs(|vb| vb.value.steps = 0)), "steps");
    assert_eq!(refused(&vb_nvs(|vb| vb.value.batch = 0)), "batch");
    assert_eq!(refused(&vb_nvs(|vb| vb.search.starts = 1)), "starts");
    assert_eq!(
        refused(&vb_nvs(|vb| vb.search.combinations = 0)),
        "combinations"
    );
    assert_eq!(refused(&vb_nvs(|vb| vb.search.shortlist = 0)), "shortlist");
    assert_eq!(refused(&vb_nvs(|vb| vb.search.rounds = 0)), "rounds");
    assert_eq!(refused(&vb_nvs(|vb| vb.evaluations = 1000)), "evaluations");
}
