//! Losses of several properties, pooled and remembered.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use proptest::prelude::*;
use sps_viewselect::{
    Exhaustive, Greedy, LossError, Pooled, Remembered, SelectError, Selector, Sets, SharedLoss,
};

use crate::problems::uniform;
use crate::support::{all_sets, losses_of, problem, select, select_on, short_vb_nvs};

/// The loss of a property is the sum of its values at the views: its optimum are the views of least
/// value. Counts the sets that it and its clones are asked for.
#[derive(Clone)]
struct Sums {
    picks: usize,
    /// Shape (properties, views).
    values: Vec<Vec<f64>>,
    ordered: bool,
    asked: Arc<AtomicU64>,
}

impl Sums {
    fn new(picks: usize, values: Vec<Vec<f64>>) -> Self {
        Self {
            picks,
            values,
            ordered: false,
            asked: Arc::default(),
        }
    }

    fn named(name: &str, views: usize, picks: usize, properties: usize) -> Self {
        let mut numbers = uniform(name);
        let row = |_| numbers.by_ref().take(views).collect();
        Self::new(picks, (0..properties).map(row).collect())
    }
}

impl SharedLoss for Sums {
    fn views(&self) -> usize {
        self.values[0].len()
    }

    fn picks(&self) -> usize {
        self.picks
    }

    fn properties(&self) -> usize {
        self.values.len()
    }

    fn ordered(&self) -> bool {
        self.ordered
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        self.asked.fetch_add(sets.len() as u64, Ordering::Relaxed);
        for (set, losses) in sets.iter().zip(losses.chunks_exact_mut(self.values.len())) {
            for (values, loss) in self.values.iter().zip(losses) {
                *loss = set.iter().map(|&view| values[view]).sum();
            }
        }
        Ok(())
    }
}

fn pooled(shared: &dyn SharedLoss, property: usize, amount: f64) -> Pooled<'_> {
    Pooled::new(shared, property, amount).unwrap_or_else(|error| panic!("{error}"))
}

/// The M views of least value, ascending.
fn least(values: &[f64], picks: usize) -> Vec<usize> {
    let mut views: Vec<usize> = (0..values.len()).collect();
    views.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    views.truncate(picks);
    views.sort_unstable();
    views
}

/// Of `(v - 2)^2` and `(v - 6)^2` the first, drawn by a towards the mean, is
/// `(1 - a / 2)(v - 2)^2 + (a / 2)(v - 6)^2`: a bowl about 2 + 2a of depth 16 (1 - a / 2)(a / 2).
#[test]
fn a_bowl_moves_towards_the_others() {
    let bowl = |centre: f64| (0..90).map(move |v| (f64::from(v) / 10.0 - centre).powi(2));
    let shared = Sums::new(1, vec![bowl(2.0).collect(), bowl(6.0).collect()]);
    for tenths in (0..=10).step_by(5) {
        let amount = f64::from(tenths) / 10.0;
        let first = pooled(&shared, 0, amount);
        let found = select(&Exhaustive::default(), &problem(&first));
        assert_eq!(found.picks, [20 + 2 * tenths as usize]);
        let depth = 16.0 * (1.0 - amount / 2.0) * (amount / 2.0);
        assert!((found.loss - depth).abs() < 1e-12, "{amount}: {found:?}");
        let second = pooled(&shared, 1, amount);
        let found = select(&Exhaustive::default(), &problem(&second));
        assert_eq!(found.picks, [60 - 2 * tenths as usize]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn losses_and_optima_are_those_of_the_formula(
        values in prop::collection::vec(prop::collection::vec(-1.0_f64..1.0, 7), 1..5),
        picks in 1_usize..4,
        property: prop::sample::Index,
        amount in 0.0_f64..1.0,
    ) {
        let property = property.index(values.len());
        let sum = |view: usize| values.iter().map(|row| row[view]).sum::<f64>();
        let mean: Vec<f64> = (0..7).map(|view| sum(view) / values.len() as f64).collect();
        let shared = Remembered::new(Sums::new(picks, values.clone()));

        let loss = pooled(&shared, property, amount);
        let sets = all_sets(7, picks, false);
        for (set, found) in sets.iter().zip(losses_of(&loss, &sets.concat())) {
            let own: f64 = set.iter().map(|&view| values[property][view]).sum();
            let all: f64 = set.iter().map(|&view| mean[view]).sum();
            let expected = (1.0 - amount) * own + amount * all;
            prop_assert!((found - expected).abs() < 1e-12, "{set:?}: {found} {expected}");
        }

        for (amount, expected) in [(0.0, &values[property]), (1.0, &mean)] {
            let loss = pooled(&shared, property, amount);
            let problem = problem(&loss).distinct(true);
            let best = least(expected, picks);
            prop_assert_eq!(&select(&Exhaustive::default(), &problem).picks, &best);
            let mut greedy = select(&Greedy::default(), &problem).picks;
            greedy.sort_unstable();
            prop_assert_eq!(&greedy, &best);
        }
    }
}

/// 9 * 8 * 7 ordered sets are 84 without their order.
#[test]
fn a_set_is_computed_once_for_all_who_ask() {
    for (ordered, sets) in [(false, 84), (true, 504)] {
        let mut sums = Sums::named("shared/once", 9, 3, 4);
        sums.ordered = ordered;
        let shared = Remembered::new(sums.clone());
        for property in 0..4 {
            for amount in [0.0, 0.3, 1.0] {
                let loss = pooled(&shared, property, amount);
                let problem = problem(&loss).distinct(true);
                select_on(1, &Exhaustive::default(), &problem);
                select_on(1, &Greedy::default(), &problem);
            }
        }
        let asked = sums.asked.load(Ordering::Relaxed);
        assert_eq!((asked, shared.sets()), (sets, sets as usize));
        assert_eq!(shared.ordered(), ordered);
    }
}

/// 0.1 + 0.2 + 0.3 is not 0.3 + 0.2 + 0.1 in f64: what is remembered must not depend on who asked
/// first.
#[test]
fn all_orders_of_a_set_are_one_to_the_bit() {
    let sums = Sums::new(3, vec![vec![0.1, 0.2, 0.3]]);
    let of = |shared: &dyn SharedLoss, set: &[usize]| {
        let mut losses = [0.0];
        let sets = Sets::new(set, 3).expect("one set");
        shared.losses(sets, &mut losses).expect("it does not fail");
        losses[0].to_bits()
    };
    assert_ne!(of(&sums, &[0, 1, 2]), of(&sums, &[2, 1, 0]));
    let expected = of(&sums, &[0, 1, 2]);
    for first in all_sets(3, 3, true) {
        let shared = Remembered::new(sums.clone());
        assert_eq!(of(&shared, &first), expected);
        assert_eq!(of(&shared, &[2, 1, 0]), expected);
    }
}

#[test]
fn selections_do_not_depend_on_the_number_of_threads() {
    let sums = Sums::named("shared/threads", 20, 3, 5);
    let selectors: [&dyn Selector; 3] =
        [&Exhaustive::default(), &Greedy::default(), &short_vb_nvs()];
    let all = |threads| {
        let shared = Remembered::new(sums.clone());
        let mut found = Vec::new();
        for property in 0..5 {
            let loss = pooled(&shared, property, 0.4);
            let problem = problem(&loss).seed(3);
            found.extend(selectors.map(|selector| select_on(threads, selector, &problem)));
        }
        // All sets of three of 20 views, repeats included: 22 * 21 * 20 / 6.
        assert_eq!(shared.sets(), 1540);
        found
    };
    let one = all(1);
    for threads in [2, 5] {
        assert_eq!(one, all(threads), "{threads} threads");
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let sums = Sums::named("shared/settings", 4, 2, 3);
    let refused = Pooled::new(&sums, 3, 0.5).expect_err("three properties");
    let expected = "`property` is 3, expected a property that exists";
    assert_eq!(refused.to_string(), expected);
    for amount in [-0.1, 1.1, f64::NAN, f64::INFINITY] {
        let refused = Pooled::new(&sums, 0, amount).expect_err("no share");
        assert!(matches!(refused, SelectError::Setting { field, .. } if field == "amount"));
    }
}

/// A property without a loss spoils the mean, and no property that stays for itself.
#[test]
fn each_for_itself_sees_no_other() {
    let shared = Sums::new(1, vec![vec![3.0, 1.0, 2.0], vec![f64::NAN; 3]]);
    let own = pooled(&shared, 0, 0.0);
    assert_eq!(select(&Exhaustive::default(), &problem(&own)).picks, [1]);
    let drawn = pooled(&shared, 0, 0.1);
    let refused = Exhaustive::default().select(&problem(&drawn));
    assert!(matches!(refused, Err(SelectError::LossOutOfRange { .. })));
}

/// Fails the first time.
struct Shy(Sums, AtomicBool);

impl SharedLoss for Shy {
    fn views(&self) -> usize {
        self.0.views()
    }

    fn picks(&self) -> usize {
        self.0.picks()
    }

    fn properties(&self) -> usize {
        self.0.properties()
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        if self.1.swap(true, Ordering::Relaxed) {
            self.0.losses(sets, losses)
        } else {
            Err("the lamp is not warm yet".into())
        }
    }
}

#[test]
fn a_failure_is_passed_on_and_not_remembered() {
    let sums = Sums::new(1, vec![vec![3.0, 1.0, 2.0]]);
    let shared = Remembered::new(Shy(sums, AtomicBool::new(false)));
    let loss = pooled(&shared, 0, 1.0);
    let error = Exhaustive::default().select(&problem(&loss));
    let error = error.expect_err("the first time");
    let source = std::error::Error::source(&error).expect("the loss's own error");
    assert_eq!(source.to_string(), "the lamp is not warm yet");
    assert_eq!(shared.sets(), 0);
    assert_eq!(select(&Exhaustive::default(), &problem(&loss)).picks, [1]);
    assert!(shared.ordered(), "unless the loss says otherwise");
}
