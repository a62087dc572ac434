//! Intervals that promise to cover a sample of a new group.

use proptest::prelude::*;
use sps_metrics::{ConformalError, GroupConformal, Level, SplitConformal, Undefined};

use crate::support::{level, uniform};

/// The radius in integers: the least residual r with
/// `1000 sum_k (members of k up to r) / N_k >= thousandths (K + 1)`, over a common denominator.
fn exact_radius(groups: &[Vec<u32>], thousandths: usize) -> Option<u32> {
    let common: u128 = groups.iter().map(|group| group.len() as u128).product();
    let reach = |radius: u32| {
        let up_to = |group: &Vec<u32>| group.iter().filter(|&&size| size <= radius).count() as u128;
        let masses = groups.iter().map(|g| up_to(g) * common / g.len() as u128);
        1000 * masses.sum::<u128>() >= thousandths as u128 * (groups.len() as u128 + 1) * common
    };
    let mut all = groups.concat();
    all.sort_unstable();
    all.into_iter().find(|&radius| reach(radius))
}

/// Residuals and group numbers of groups in turn.
fn flat(groups: &[Vec<u32>]) -> (Vec<f64>, Vec<usize>) {
    let residuals = groups.concat().into_iter().map(f64::from).collect();
    let numbers = groups.iter().enumerate();
    let numbers = numbers.flat_map(|(number, group)| vec![90 - 7 * number; group.len()]);
    (residuals, numbers.collect())
}

proptest! {
    /// Also with ties, and whatever the order of the samples.
    #[test]
    fn the_radius_is_that_of_integer_arithmetic(
        groups in prop::collection::vec(prop::collection::vec(0_u32..30, 1..8), 1..12),
        thousandths in 1_usize..1000,
        rotation: prop::sample::Index,
    ) {
        let (mut residuals, mut numbers) = flat(&groups);
        let rotation = rotation.index(residuals.len());
        residuals.rotate_left(rotation);
        numbers.rotate_left(rotation);
        residuals.iter_mut().step_by(2).for_each(|residual| *residual = -*residual);
        let found = GroupConformal::from_residuals(&residuals, &numbers, level(thousandths));
        match (found, exact_radius(&groups, thousandths)) {
            (Ok(found), Some(radius)) => {
                prop_assert_eq!(found.radius, f64::from(radius));
                prop_assert_eq!(found.groups, groups.len());
            }
            (Err(ConformalError::TooFewGroups { found, needed, .. }), None) => {
                prop_assert_eq!(found, groups.len());
                let least = (1..1000).find(|&k| thousandths * (k + 1) <= 1000 * k);
                prop_assert_eq!(Some(needed), least);
            }
            (found, exact) => prop_assert!(false, "{found:?} for {exact:?}"),
        }
    }

    #[test]
    fn one_sample_a_group_is_split_conformal(
        residuals in prop::collection::vec(-5.0_f64..5.0, 1..80),
        ties in 1_usize..4,
        thousandths in 1_usize..1000,
    ) {
        let residuals = residuals.repeat(ties);
        let numbers: Vec<usize> = (0..residuals.len()).rev().collect();
        let grouped = GroupConformal::from_residuals(&residuals, &numbers, level(thousandths));
        match SplitConformal::from_residuals(&residuals, level(thousandths)) {
            Ok(split) => {
                let grouped = grouped.expect("as many groups as samples");
                prop_assert_eq!(grouped.radius.to_bits(), split.radius.to_bits());
                prop_assert_eq!(grouped.groups, split.samples);
            }
            Err(ConformalError::TooFewSamples { found, needed, level }) => {
                let expected = ConformalError::TooFewGroups { found, needed, level };
                prop_assert_eq!(grouped, Err(expected));
            }
            Err(other) => prop_assert!(false, "{other}"),
        }
    }

    /// Of K + 1 exchangeable groups, each left out in turn, the others cover the promised share of
    /// its samples on average, and less than 2 / (K + 1) more: the theorem itself, without a
    /// simulation.
    #[test]
    fn leaving_each_group_out_covers_the_promise(
        sizes in prop::collection::hash_set(1_u32..1_000_000, 40..90),
        cuts in prop::collection::vec(0_usize..40, 7..14),
        spread in 1_u32..40,
        thousandths in 50_usize..850, // six groups reach 6/7
    ) {
        let mut groups = vec![Vec::new(); cuts.len()];
        for (index, size) in sizes.into_iter().enumerate() {
            // The first samples go one to each group, the others anywhere; groups are alike within.
            let of = if index < groups.len() { index } else { cuts[index % cuts.len()] % cuts.len() };
            groups[of].push(size + of as u32 * spread * 1_000_000);
        }
        let mut covered = 0.0;
        for index in 0..groups.len() {
            let mut others = groups.clone();
            let left_out = others.swap_remove(index);
            let (residuals, numbers) = flat(&others);
            let found = GroupConformal::from_residuals(&residuals, &numbers, level(thousandths));
            let radius = found.expect("enough groups").radius;
            let inside = left_out.iter().filter(|&&size| f64::from(size) <= radius).count();
            covered += inside as f64 / left_out.len() as f64;
        }
        let fraction = covered / groups.len() as f64;
        let promised = thousandths as f64 / 1000.0;
        prop_assert!(fraction >= promised - 1e-12, "{fraction} {promised}");
        prop_assert!(fraction < promised + 2.0 / groups.len() as f64, "{fraction} {promised}");
    }
}

const DRAWS: usize = 10_000;
const GROUPS: usize = 19;

/// Shares of `DRAWS` in which one sample of a new group was covered, by hierarchical and by split
/// conformal intervals calibrated on `GROUPS` groups of one to a hundred samples. A residual is the
/// group's effect, times what `scale` gives for the group's size, and noise of half the effect.
fn covered_by(name: &str, scale: fn(usize) -> f64) -> (f64, f64) {
    let mut numbers = uniform(name);
    let mut number = || numbers.next().expect("endless");
    let mut covered = (0, 0);
    for _ in 0..DRAWS {
        let (mut residuals, mut groups) = (Vec::new(), Vec::new());
        for group in 0..=GROUPS {
            // Most groups are small, a few large.
            let members = (100.0 * f64::midpoint(1.0, number()).powi(8)) as usize + 1;
            let effect = number() * scale(members);
            // Of the new group, the last, one sample will do: all are alike.
            let taken = if group == GROUPS { 1 } else { members };
            residuals.extend((0..taken).map(|_| effect + 0.5 * number()));
            groups.extend(std::iter::repeat_n(group, taken));
        }
        let new = residuals.pop().expect("the new group's").abs();
        groups.pop();
        let grouped = GroupConformal::from_residuals(&residuals, &groups, Level::P90);
        let split = SplitConformal::from_residuals(&residuals, Level::P90);
        covered.0 += usize::from(new <= grouped.expect("19 groups").radius);
        covered.1 += usize::from(new <= split.expect("19 samples or more").radius);
    }
    let share = |covered| f64::from(covered as u32) / DRAWS as f64;
    (share(covered.0), share(covered.1))
}

/// Of groups that are alike, and where a material that is hard is seldom photographed: most calibration
/// samples are of easy ones.
#[test]
fn samples_of_new_groups_are_covered_at_the_promised_rate() {
    // Three standard errors of a share of 0.9.
    let slack = 3.0 * (0.9 * 0.1 / DRAWS as f64).sqrt();
    let alike: fn(usize) -> f64 = |_| 1.0;
    let hard: fn(usize) -> f64 = |members| if members <= 3 { 3.0 } else { 0.5 };
    for (name, scale, of_split) in [("alike", alike, 0.9 - slack), ("hard", hard, 0.85)] {
        let (grouped, split) = covered_by(&format!("group-conformal/{name}"), scale);
        println!("groups {name}: hierarchical {grouped}, split {split}");
        let most = 0.9 + 2.0 / (GROUPS + 1) as f64 + slack;
        let promised = (0.9 - slack..most).contains(&grouped);
        assert!(promised, "{name}: {grouped}");
        assert!(
            split < of_split,
            "{name}: split conformal would do, {split}"
        );
    }
}

/// K groups reach K / (K + 1) exactly, and then take the largest residual of all.
#[test]
fn seven_groups_reach_seven_eighths() {
    let (residuals, groups) = flat(&(0..7).map(|k| vec![k, k + 20]).collect::<Vec<_>>());
    let found = GroupConformal::from_residuals(&residuals, &groups, level(875));
    assert_eq!(found.map(|found| found.radius), Ok(26.0));
    let refused = GroupConformal::from_residuals(&residuals, &groups, level(876));
    let reason = refused.expect_err("seven groups");
    let said = "7 calibration group(s) allow a level of 7/8, a level of 0.876 needs at least 8";
    assert_eq!(reason.to_string(), said);
    let nine = ConformalError::TooFewGroups {
        found: 7,
        needed: 9,
        level: Level::P90,
    };
    let refused = GroupConformal::from_residuals(&residuals, &groups, Level::P90);
    assert_eq!(refused, Err(nine));
}

/// 11 * 0.9 is 9.900000000000000355 in f64, and 9 + 9/10 as ten groups have it is 9.9.
#[test]
fn fractions_are_not_lost_to_rounding() {
    let mut groups: Vec<Vec<u32>> = (1..10).map(|k| vec![k]).collect();
    groups.push((11..=20).collect());
    let (residuals, numbers) = flat(&groups);
    let found = GroupConformal::from_residuals(&residuals, &numbers, Level::P90);
    assert_eq!(found.map(|found| found.radius), Ok(19.0));

    // A hundred fifths are twenty, half of 39 groups and the new one. Summed in f64 they are less,
    // and the next residual would be taken.
    let groups: Vec<Vec<u32>> = (0..39).map(|k| (5 * k..5 * k + 5).collect()).collect();
    let (residuals, numbers) = flat(&groups);
    let found = GroupConformal::from_residuals(&residuals, &numbers, level(500));
    assert_eq!(found.map(|found| found.radius), Ok(99.0));
    let naive = (0..100).fold(0.0, |sum, _| sum + 1.0 / 5.0);
    assert!(naive < 20.0 - 1e-14, "{naive}");
}

#[test]
fn residuals_and_groups_pair_up_and_are_finite() {
    let half = level(500);
    let residuals = [-1.0, 2.0, -0.5];
    let found = GroupConformal::from_residuals(&residuals, &[4, 4, 9], half);
    // Half of three groups: the second's one sample of 0.5, and one of the first's two.
    let found = found.expect("two groups");
    assert_eq!((found.radius, found.groups, found.level), (1.0, 2, half));

    let reason = ConformalError::GroupMismatch {
        samples: 3,
        groups: 2,
    };
    let refused = GroupConformal::from_residuals(&residuals, &[4, 4], half);
    assert_eq!(refused, Err(reason));
    let refused = GroupConformal::from_residuals(&[], &[], half);
    assert_eq!(refused, Err(Undefined::Empty.into()));
    let refused = GroupConformal::from_residuals(&[1.0, f64::NAN], &[1, 2], half);
    let Err(ConformalError::Undefined(reason)) = refused else {
        panic!("{refused:?}");
    };
    assert!(matches!(reason, Undefined::NonFinite { index: 1, .. }));
}
