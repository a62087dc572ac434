//! One view, as many picks as views, more picks than views.

use sps_viewselect::{Problem, SelectError, SetFunction, Sets};

use crate::support::{all_selectors, problem, select};

fn sum(set: &[usize]) -> f64 {
    let slots = set.iter().zip(1..);
    slots.map(|(&view, slot)| (view * slot) as f64).sum()
}

#[test]
fn one_view_is_picked() {
    let loss = SetFunction::new(1, 1, sum);
    for distinct in [false, true] {
        for (name, selector) in all_selectors() {
            let selection = select(&*selector, &problem(&loss).distinct(distinct));
            assert_eq!((selection.picks, selection.loss), (vec![0], 0.0), "{name}");
        }
    }
}

#[test]
fn as_many_picks_as_views() {
    let loss = SetFunction::new(4, 4, sum);
    for (name, selector) in all_selectors() {
        let mut distinct = select(&*selector, &problem(&loss).distinct(true)).picks;
        if ["greedy", "exhaustive", "vb-nvs"].contains(&name) {
            // The largest view in the lightest slot.
            assert_eq!(distinct, [3, 2, 1, 0], "{name}");
        }
        distinct.sort_unstable();
        assert_eq!(distinct, [0, 1, 2, 3], "{name}");
        let free = select(&*selector, &problem(&loss)).picks;
        if ["greedy", "exhaustive", "vb-nvs"].contains(&name) {
            assert_eq!(free, [0, 0, 0, 0], "{name}");
        }
    }
}

#[test]
fn sets_that_cannot_be_are_refused() {
    let of = |views, picks| SetFunction::new(views, picks, sum);
    assert!(matches!(Problem::new(&of(0, 1)), Err(SelectError::NoViews)));
    assert!(matches!(Problem::new(&of(0, 0)), Err(SelectError::NoViews)));
    assert!(matches!(Problem::new(&of(3, 0)), Err(SelectError::NoPicks)));
    let error = Problem::new(&of(3, 4)).expect_err("four of three");
    let expected = "sets of 4 views are wanted of 3 views, expected at most 3";
    assert_eq!(error.to_string(), expected);
    let odd = Sets::new(&[0, 1, 2], 2).expect_err("three in sets of two");
    assert!(matches!(odd, SelectError::Length { found, expected } if [found, expected] == [3, 2]));
    let error = Sets::new(&[], 0).expect_err("sets of none");
    assert!(matches!(error, SelectError::Setting { .. }));
}
