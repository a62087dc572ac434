//! Losses that are constant, tied, huge, not numbers, or fail.

use sps_viewselect::{
    Baseline, Greedy, LossError, Nvs, SelectError, Selector, SetFunction, SetLoss, Sets, VbNvs,
};

use crate::support::{all_selectors, all_sets, problem, select, short_nvs, short_vb_nvs};

/// Rewards less their mean over their spread, in one pass each.
fn naive_advantages(losses: &[f64]) -> Vec<f64> {
    let n = losses.len() as f64;
    let mean = losses.iter().sum::<f64>() / n;
    let spread = (losses.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / n).sqrt();
    losses.iter().map(|loss| (mean - loss) / spread).collect()
}

/// A mean that is off by one rounding would make advantages of a constant reward, and
/// standardising would blow them up.
#[test]
fn a_constant_reward_moves_nothing_and_stays_finite() {
    let naive = naive_advantages(&[0.1; 50]);
    println!("constant reward: advantage 0, naive form {:.1e}", naive[0]);
    assert!(naive[0].abs() > 0.9, "the naive form");
    for value in [0.0, -3.5, 0.1, 1e99] {
        let loss = SetFunction::new(9, 3, |_: &[usize]| value);
        for (name, selector) in all_selectors() {
            let selection = select(&*selector, &problem(&loss).distinct(true));
            assert_eq!(selection.loss, value, "{name}");
        }
        for baseline in [Baseline::LeaveOneOut, Baseline::MovingMean { decay: 0.9 }] {
            let mut nvs = short_nvs();
            nvs.policy.baseline = baseline;
            nvs.policy.entropy_weight = 0.0;
            // No advantage, no step: the arg-max of equal logits is view 0.
            assert_eq!(select(&nvs, &problem(&loss)).picks, [0, 0, 0]);
        }
    }
}

/// One set has no others to be compared with: its advantage is 0, and the policy stays uniform.
/// The mean of no others is 0 / 0.
#[test]
fn a_batch_of_one_moves_nothing() {
    let loss = SetFunction::new(9, 3, |set: &[usize]| 9.0 - set[0] as f64);
    let mut nvs = short_nvs();
    nvs.policy.batch = 1;
    nvs.policy.baseline = Baseline::LeaveOneOut;
    nvs.policy.entropy_weight = 0.0;
    assert_eq!(select(&nvs, &problem(&loss)).picks, [0, 0, 0]);
    let losses = [4.0];
    let others = (losses.iter().sum::<f64>() - losses[0]) / (losses.len() - 1) as f64;
    assert!((others - losses[0]).is_nan(), "the naive form");
}

#[test]
fn the_plain_form_learns_too_and_stays_finite_on_a_constant_reward() {
    let nvs = Nvs {
        policy: Nvs::default().policy.plain(),
        ..short_nvs()
    };
    let constant = SetFunction::new(9, 3, |_: &[usize]| 1.0);
    assert_eq!(select(&nvs, &problem(&constant)).loss, 1.0);
    // Negative losses: without a baseline, what is drawn becomes more probable, good sets faster.
    let sum = |set: &[usize]| set.iter().map(|&view| view as f64 - 6.0).sum::<f64>();
    let linear = SetFunction::new(6, 2, sum);
    let selection = select(&nvs, &problem(&linear));
    assert!(selection.loss <= -9.0, "{selection:?}");
}

#[test]
fn huge_and_tiny_losses_stay_finite() {
    for scale in [1e100, 1e-300, 1e-160] {
        let share = |set: &[usize]| set.iter().sum::<usize>() as f64 / 18.0;
        let loss = SetFunction::new(10, 2, |set: &[usize]| -scale * share(set));
        for policy in [short_nvs().policy, short_nvs().policy.plain()] {
            let nvs = Nvs {
                policy,
                evaluations: 5001,
            };
            assert!(select(&nvs, &problem(&loss)).loss.is_finite());
        }
        let selection = select(&short_vb_nvs(), &problem(&loss));
        assert!(selection.loss.is_finite());
    }
}

#[test]
fn ties_go_to_the_lexicographically_first_set() {
    let loss = SetFunction::new(8, 3, |set: &[usize]| f64::from(u8::from(set[0] == 5)));
    for (name, selector) in all_selectors() {
        if ["exhaustive", "vb-nvs"].contains(&name) {
            let picks = select(&*selector, &problem(&loss)).picks;
            assert!(name != "exhaustive" || picks == [0, 0, 0], "{picks:?}");
            assert_ne!(picks[0], 5);
        }
    }
    // Minus zero and zero are one loss.
    let zero = |set: &[usize]| if set[1] == 3 { -0.0 } else { 0.0 };
    let zeros = SetFunction::new(4, 2, zero);
    let exhaustive = sps_viewselect::Exhaustive::default();
    assert_eq!(select(&exhaustive, &problem(&zeros)).picks, [0, 0]);
    let naive = all_sets(4, 2, false).into_iter();
    let naive = naive.min_by(|a, b| f64::total_cmp(&zero(a), &zero(b)));
    assert_eq!(naive.expect("16 sets"), [0, 3], "the naive form");
    // Greedy stays where it began: a tie is no reason to go on.
    let flat = SetFunction::new(8, 3, |_: &[usize]| 2.0);
    let one = Greedy {
        starts: 1,
        ..Greedy::default()
    };
    assert_eq!(select(&one, &problem(&flat)).picks, [1, 3, 6]);
}

#[test]
fn a_loss_that_is_no_number_is_an_error_that_names_the_set() {
    for strange in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e101] {
        let is_strange = |set: &[usize]| set == [2, 2] || set == [1, 3];
        let of_set = |set: &[usize]| if is_strange(set) { strange } else { 1.0 };
        let loss = SetFunction::new(5, 2, of_set);
        for (name, selector) in all_selectors() {
            match selector.select(&problem(&loss)) {
                Err(SelectError::LossOutOfRange { set, loss }) => {
                    assert!(is_strange(&set), "{name}: {set:?}");
                    assert!(loss.is_nan() || loss == strange);
                }
                Err(other) => panic!("{name}: {other}"),
                // Who does not ask for them does not find them.
                Ok(selection) => assert!(
                    name.starts_with("random") || name == "equidistant ends",
                    "{name}: {selection:?}"
                ),
            }
        }
    }
    let nan = SetFunction::new(5, 2, |_: &[usize]| f64::NAN);
    let error = Greedy::default().select(&problem(&nan)).expect_err("NaN");
    let expected = "the loss of the set [0, 3] is NaN, expected a number within 1e100 of 0";
    assert_eq!(error.to_string(), expected);
}

struct Failing;

impl SetLoss for Failing {
    fn views(&self) -> usize {
        4
    }

    fn picks(&self) -> usize {
        2
    }

    fn losses(&self, _: Sets<'_>, _: &mut [f64]) -> Result<(), LossError> {
        Err("the lamp is broken".into())
    }
}

#[test]
fn a_loss_that_fails_ends_the_selection_with_its_reason() {
    for (name, selector) in all_selectors() {
        let error = selector.select(&problem(&Failing)).expect_err(name);
        assert!(matches!(error, SelectError::Loss { .. }), "{name}: {error}");
        let source = std::error::Error::source(&error).expect("the loss's own error");
        assert_eq!(source.to_string(), "the lamp is broken");
    }
}

#[test]
fn rare_good_sets_in_a_flat_loss_do_no_harm() {
    // A needle: only luck finds it, but nothing breaks on the way.
    let needle = |set: &[usize]| if set == [3, 14, 15] { -1.0 } else { 0.0 };
    let loss = SetFunction::new(30, 3, needle);
    assert!(select(&short_nvs(), &problem(&loss)).loss.is_finite());
    let vb_nvs = VbNvs {
        evaluations: 2000,
        ..VbNvs::default()
    };
    assert!(select(&vb_nvs, &problem(&loss)).loss.is_finite());
}
