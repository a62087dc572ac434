use std::collections::BTreeMap;

/// The intraclass correlation ICC(1) of values in groups, given as `(group, value)`: which share of
/// the variance lies between groups, by the analysis of variance of the one-way random effects
/// model (Searle, Casella and McCulloch, "Variance Components", 1992, section 3.6; Donner,
/// International Statistical Review 54, 1986).
///
/// With `k` groups of `n_i` values, `N` in all, and the mean squares between and within groups,
///
/// ```text
/// ICC(1) = (between - within) / (between + (n0 - 1) within),
/// n0     = (N - sum of n_i^2 / N) / (k - 1)
/// ```
///
/// Both variances in the quotient are estimated without bias; the plain share of the sum of squares
/// between group means is biased: with pairs formed at random it is one half on average.
///
/// `None` with fewer than two groups, where every group has one value, and where all values are
/// equal.
pub(crate) fn intraclass<'a>(values: impl Iterator<Item = (&'a str, f64)>) -> Option<f64> {
    let mut groups: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (group, value) in values {
        groups.entry(group).or_default().push(value);
    }
    let total: usize = groups.values().map(Vec::len).sum();
    if groups.len() < 2 || groups.len() == total {
        return None;
    }
    let mut values = groups.values().flatten();
    let first = values.next()?;
    if values.all(|value| value.total_cmp(first).is_eq()) {
        return None;
    }
    let size = total as f64;
    let grand = groups.values().flatten().sum::<f64>() / size;
    let (mut between, mut within, mut sizes) = (0.0, 0.0, 0.0);
    for group in groups.values() {
        let count = group.len() as f64;
        let mean = group.iter().sum::<f64>() / count;
        between += count * (mean - grand).powi(2);
        within += group.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
        sizes += count * count;
    }
    let free = (groups.len() - 1) as f64;
    let (between, within) = (between / free, within / (total - groups.len()) as f64);
    let usual = (size - sizes / size) / free;
    let variance = between + (usual - 1.0) * within;
    (variance > 0.0).then(|| (between - within) / variance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_have_the_closed_form() {
        // Group means 1 and 11 about 6: between 2 * 25 * 2 / 1 = 100, within (2 + 2) / 2 = 2,
        // n0 = 2, so 98 / 102.
        let values = [("a", 0.0), ("b", 10.0), ("a", 2.0), ("b", 12.0)];
        let found = intraclass(values.into_iter()).unwrap();
        assert!((found - 98.0 / 102.0).abs() < 1e-15);
    }

    #[test]
    fn groups_of_different_sizes_agree_with_numpy() {
        // import numpy as np
        // groups = [[1.5, 2.0, 0.5, 3.0], [4.0, 6.5], [2.5], [7.0, 5.0, 6.0]]
        // n = np.array([len(g) for g in groups]); N, k = n.sum(), len(n)
        // m = np.array([np.mean(g) for g in groups]); grand = np.mean(np.concatenate(groups))
        // b = (n * (m - grand) ** 2).sum() / (k - 1)
        // w = sum(((np.array(g) - np.mean(g)) ** 2).sum() for g in groups) / (N - k)
        // n0 = (N - (n ** 2).sum() / N) / (k - 1)
        // (b - w) / (b + (n0 - 1) * w)
        let groups = [
            vec![1.5, 2.0, 0.5, 3.0],
            vec![4.0, 6.5],
            vec![2.5],
            vec![7.0, 5.0, 6.0],
        ];
        let named = ["a", "b", "c", "d"].into_iter().zip(&groups);
        let values = named.flat_map(|(name, group)| group.iter().map(move |&x| (name, x)));
        let found = intraclass(values).unwrap();
        assert!((found - 0.771_753_941_989_488).abs() < 1e-12, "{found}");
    }

    #[test]
    fn groups_that_say_all_have_one_and_groups_that_say_nothing_less_than_zero() {
        let all = [("a", 1.0), ("a", 1.0), ("b", 2.0), ("b", 2.0)];
        assert_eq!(intraclass(all.into_iter()), Some(1.0));
        // Equal means: between 0, so -within / within.
        let nothing = [("a", 1.0), ("a", 3.0), ("b", 1.0), ("b", 3.0)];
        assert_eq!(intraclass(nothing.into_iter()), Some(-1.0));
    }

    #[test]
    fn without_groups_there_is_no_share() {
        let of = |values: &[(&'static str, f64)]| intraclass(values.iter().copied());
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[("a", 1.0), ("b", 2.0)]), None);
        assert_eq!(of(&[("a", 1.0), ("a", 2.0)]), None);
        // Their mean, as it is computed, is not exactly 0.1.
        assert_eq!(of(&[("a", 0.1), ("a", 0.1), ("b", 0.1)]), None);
    }
}
