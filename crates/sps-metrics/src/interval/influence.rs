//! How much each sample draws a score: its influence function (Hampel, "The influence curve and its
//! role in robust estimation", Journal of the American Statistical Association 69, 1974).

use crate::samples::Samples;
use crate::samples::ranks::Order;

/// Of the median of those values that there are. The density of values about it is read off the
/// distance between two of them (McKean and Schrader, "A comparison of methods for studentizing the
/// sample median", Communications in Statistics 13, 1984).
pub(crate) fn of_median(values: &[Option<f64>]) -> Vec<Option<f64>> {
    /// The 99.5th percentile of the normal distribution.
    const Z: f64 = 2.575_829_303_548_900_4;
    let mut ascending: Vec<f64> = values.iter().flatten().copied().collect();
    ascending.sort_unstable_by(f64::total_cmp);
    let Some(last) = ascending.len().checked_sub(1) else {
        return vec![None; values.len()];
    };
    let count = ascending.len() as f64;
    let from = (count - 1.0) / 2.0 - Z * (count / 4.0).sqrt();
    let from = from.round().max(0.0) as usize;
    let standard_error = (ascending[last - from] - ascending[from]) / (2.0 * Z);
    let median = f64::midpoint(ascending[last / 2], ascending[last.div_ceil(2)]);
    let influence = |value: f64| {
        let side = f64::from(i8::from(value > median) - i8::from(value < median));
        side * standard_error * count.sqrt()
    };
    values.iter().map(|value| value.map(influence)).collect()
}

/// Of Spearman's correlation, the correlation of the shares of truths and of estimates that lie below
/// a sample's.
pub(crate) fn of_spearman(samples: Samples<'_>) -> Vec<f64> {
    let count = samples.truth.len() as f64;
    let orders = [samples.truth, samples.estimate].map(Order::of);
    let [truth, estimate] = orders.each_ref().map(|order| {
        let shares = order.ranks().into_iter();
        let shares = shares.map(|rank| rank as f64 / (2.0 * count));
        shares.collect::<Vec<f64>>()
    });
    let of = |a: usize, b: usize| {
        let shares = [&truth, &estimate];
        Product::of([&orders[a], &orders[b]], [shares[a], shares[b]])
    };
    let [tt, te, ee] = [of(0, 0), of(0, 1), of(1, 1)];
    let root = (tt.mean * ee.mean).sqrt();
    let influence = |at: usize| {
        let scale = tt.influence[at] / tt.mean + ee.influence[at] / ee.mean;
        (te.influence[at] - te.mean * scale / 2.0) / root
    };
    (0..samples.truth.len()).map(influence).collect()
}

/// The mean product of two shares, and how much each sample draws it: by its own product, and by being
/// below others.
struct Product {
    mean: f64,
    influence: Vec<f64>,
}

impl Product {
    fn of(orders: [&Order; 2], shares: [&Vec<f64>; 2]) -> Self {
        let count = shares[0].len() as f64;
        let both = shares[0].iter().zip(shares[1]);
        let own: Vec<f64> = both.map(|(a, b)| a * b).collect();
        let mean = own.iter().sum::<f64>() / count;
        let above = [above(orders[0], shares[1]), above(orders[1], shares[0])];
        let influence = own.iter().zip(&above[0]).zip(&above[1]);
        Self {
            mean,
            influence: influence
                .map(|((own, first), second)| own + (first + second) / count - 3.0 * mean)
                .collect(),
        }
    }
}

/// For each sample the sum of `values` over those above it, and half of those level with it.
fn above(order: &Order, values: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; values.len()];
    let mut above = 0.0;
    let starts = [0].into_iter().chain(order.tie_ends.iter().copied());
    let ties: Vec<(usize, usize)> = starts.zip(order.tie_ends.iter().copied()).collect();
    for (start, end) in ties.into_iter().rev() {
        let tie = &order.ascending[start..end];
        let level: f64 = tie.iter().map(|&at| values[at]).sum();
        for &at in tie {
            sums[at] = above + level / 2.0;
        }
        above += level;
    }
    sums
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn shares_of(values: &[i32]) -> Vec<f64> {
        values.iter().map(|&value| f64::from(value)).collect()
    }

    proptest! {
        /// The score of a sample that is repeated very often is what its influence points to: the
        /// derivative of the score when a share `STEP` of all weight moves to that sample.
        #[test]
        fn influences_are_derivatives_by_weight(
            pairs in prop::collection::vec((0..6_i32, 0..6_i32), 4..12),
        ) {
            /// Copies of each sample, and more of one.
            const COPIES: usize = 400;
            const MORE: usize = 4;
            let (truth, estimate): (Vec<i32>, Vec<i32>) = pairs.into_iter().unzip();
            let (truth, estimate) = (shares_of(&truth), shares_of(&estimate));
            let samples = Samples { truth: &truth, estimate: &estimate };
            let Ok(whole) = samples.spearman() else { return Ok(()) };
            let influences = of_spearman(samples);
            for (at, influence) in influences.iter().enumerate() {
                let repeated = |values: &[f64]| -> Vec<f64> {
                    let copies = values.iter().enumerate();
                    let count = |place| COPIES + if place == at { MORE } else { 0 };
                    copies.flat_map(|(place, &v)| std::iter::repeat_n(v, count(place))).collect()
                };
                let (truth, estimate) = (repeated(&truth), repeated(&estimate));
                let moved = Samples { truth: &truth, estimate: &estimate }.spearman();
                let step = MORE as f64 / truth.len() as f64;
                let slope = (moved.expect("as before").value - whole.value) / step;
                prop_assert!((slope - influence).abs() < 0.02 + 0.05 * influence.abs(), "{slope} {influence}");
            }
            prop_assert!(influences.iter().sum::<f64>().abs() < 1e-9);
        }
    }

    /// The median of 1 to 99: of 99 values the ordered places 37 and 63 lie 2.58 standard
    /// deviations of the median's place (99 / 4)^½ from 50.
    #[test]
    fn a_median_is_drawn_by_the_side_that_a_value_lies_on() {
        let values: Vec<Option<f64>> = (1..=99).map(|v| Some(f64::from(v))).chain([None]).collect();
        let influences = of_median(&values);
        let size = (63.0 - 37.0) / (2.0 * 2.575_829_303_548_900_4) * 99.0_f64.sqrt();
        assert_eq!((influences[49], influences[99]), (Some(0.0), None));
        assert!((influences[0].unwrap() + size).abs() < 1e-12);
        assert!((influences[98].unwrap() - size).abs() < 1e-12);
    }
}
