//! From a response to the Toccare's scale: a fixed monotone map for each property.
//!
//! The published figure gives five quantiles of each property. Between the quartiles the map is
//! linear in probability; beyond them it is exponential, with the rate at which the density of the
//! values is continuous at the quartile. The response's own quantiles are those of `quantiles.csv` for
//! every simulated set, so a surface's values do not depend on which others there are.

use std::sync::LazyLock;

use super::Values;

/// The response of each property below which a share of 20,000 surfaces lies: measured once; a test
/// below says how.
const QUANTILES: &str = include_str!("quantiles.csv");

/// Minimum, quartiles and maximum of each property, as published.
const PUBLISHED: &str = include_str!("published.csv");

static RESPONSES: LazyLock<Vec<(f64, Values)>> = LazyLock::new(|| table(QUANTILES));

/// Of each property, in the order of [`PUBLISHED`].
static SCALES: LazyLock<[Scale; 15]> = LazyLock::new(|| {
    let published = table(PUBLISHED);
    std::array::from_fn(|i| Scale::new(std::array::from_fn(|at| published[at].1[i])))
});

/// The share of each line of a table, and its values.
fn table(text: &str) -> Vec<(f64, Values)> {
    let lines = text.lines().skip(1).map(|line| {
        let mut cells = line.split(',').map(|cell| cell.parse().expect("a number"));
        let mut next = || cells.next().expect("a cell");
        (next(), std::array::from_fn(|_| next()))
    });
    lines.collect()
}

/// Reads all responses on the scale.
pub(super) fn read(responses: &Values) -> Values {
    std::array::from_fn(|i| SCALES[i].quantile(probability(i, responses[i])))
}

/// The share of surfaces with a lower response, linear between the tabulated ones.
fn probability(property: usize, response: f64) -> f64 {
    let table = &*RESPONSES;
    let above = table.partition_point(|(_, knot)| knot[property] <= response);
    if above == 0 {
        return 0.0;
    }
    if above == table.len() {
        return 1.0;
    }
    let ((p, lo), (q, hi)) = (&table[above - 1], &table[above]);
    let (lo, hi) = (lo[property], hi[property]);
    p + (q - p) * (response - lo) / (hi - lo)
}

/// The published values of a property, and how fast they grow beyond the quartiles.
struct Scale {
    points: [f64; 5],
    /// Below the lower quartile and above the upper one.
    rates: [f64; 2],
}

impl Scale {
    fn new(points: [f64; 5]) -> Self {
        let [min, q1, median, q3, max] = points;
        let rates = [rate(q1 - min, median - q1), rate(max - q3, q3 - median)];
        Self { points, rates }
    }

    /// The value below which a share `p` of the published surfaces lies.
    fn quantile(&self, p: f64) -> f64 {
        let [min, q1, median, q3, max] = self.points;
        let inner = |lo: f64, hi: f64, from: f64| lo + (hi - lo) * (p - from) / 0.25;
        match p {
            p if p < 0.25 => q1 - tail(q1 - min, self.rates[0], 1.0 - p / 0.25),
            p if p < 0.5 => inner(q1, median, 0.25),
            p if p < 0.75 => inner(median, q3, 0.5),
            _ => q3 + tail(max - q3, self.rates[1], (p - 0.75) / 0.25),
        }
    }
}

/// From 0 at `t = 0` to `reach` at `t = 1`, growing or falling off exponentially with rate `k`:
/// `reach (e^(k t) - 1) / (e^k - 1)`.
fn tail(reach: f64, k: f64, t: f64) -> f64 {
    if k.abs() < 1e-6 {
        return reach * t;
    }
    reach * (libm::exp(k * t) - 1.0) / (libm::exp(k) - 1.0)
}

/// The rate `k` at which a [`tail`] leaves with slope `slope`, `reach k / (e^k - 1) = slope`, by bisection.
fn rate(reach: f64, slope: f64) -> f64 {
    let (mut lo, mut hi) = (-20.0f64, 20.0f64);
    for _ in 0..60 {
        let k = 0.5 * (lo + hi);
        let start = if k.abs() < 1e-9 {
            1.0
        } else {
            k / (libm::exp(k) - 1.0)
        };
        if reach * start > slope {
            lo = k;
        } else {
            hi = k;
        }
    }
    0.5 * (lo + hi)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::fmt::Write;

    use sps_dataset::toccare;

    use super::super::responses;
    use super::*;
    use crate::parameters::Specimen;

    /// A hundred full blocks of the assignment, of a seed that nothing else uses.
    const SURFACES: usize = 20_000;
    const SEED: u64 = 0x5ca1_ab1e;

    /// Where this fails after a change of the measurement model, put what it prints below the head of
    /// `quantiles.csv`: `cargo test -p sps-simulate measured -- --nocapture`.
    #[test]
    fn the_responses_are_what_is_measured() {
        let mut columns = vec![Vec::new(); 15];
        for index in 0..SURFACES {
            let found = responses(&Specimen::draw(SEED, index).parameters());
            for (column, response) in columns.iter_mut().zip(found) {
                column.push(response);
            }
        }
        for column in &mut columns {
            column.sort_by(f64::total_cmp);
        }
        let codes = toccare::ALL.map(|property| property.code);
        let mut found = format!("share,{}\n", codes.join(","));
        let ends = (RESPONSES[0].0, RESPONSES[RESPONSES.len() - 1].0);
        assert_eq!(ends, (0.0, 1.0));
        assert!(RESPONSES.is_sorted_by(|(p, _), (q, _)| p < q));
        for (p, _) in RESPONSES.iter() {
            let place = p * (SURFACES - 1) as f64;
            let (i, t) = (place as usize, place - place.floor());
            let next = (i + 1).min(SURFACES - 1);
            write!(found, "{p:?}").unwrap();
            for column in &columns {
                // Four digits after the point are what the file holds.
                let value = column[i] + (column[next] - column[i]) * t;
                write!(found, ",{:?}", (value * 1e4).round() / 1e4).unwrap();
            }
            found.push('\n');
        }
        println!("{found}");
        assert_eq!(found, QUANTILES, "the measurement model changed");
    }

    #[test]
    fn the_quantiles_are_the_published_ones() {
        #[derive(serde::Deserialize)]
        struct Published {
            quantiles: BTreeMap<String, [f64; 5]>,
        }
        let text = include_str!("../../../sps-report/src/published.toml");
        let published: Published = toml::from_str(text).unwrap();
        for (property, scale) in toccare::properties().iter().zip(&*SCALES) {
            let ours = scale.points;
            assert_eq!(ours, published.quantiles[property.code()], "{property}");
            for (p, value) in [0.0, 0.25, 0.5, 0.75, 1.0].into_iter().zip(ours) {
                let error = (scale.quantile(p) - value).abs();
                assert!(error < 1e-9, "{property} at {p}");
            }
        }
    }

    #[test]
    fn values_rise_with_probability_and_density_is_continuous_at_the_quartiles() {
        for scale in &*SCALES {
            let published = scale.points;
            let mut last = -1.0;
            for i in 0..=1000 {
                let value = scale.quantile(f64::from(i) / 1000.0);
                assert!(value >= last, "{published:?} at {i}");
                last = value;
            }
            for p in [0.25, 0.75] {
                let step = 1e-6;
                let before = scale.quantile(p) - scale.quantile(p - step);
                let after = scale.quantile(p + step) - scale.quantile(p);
                assert!((before / after - 1.0).abs() < 1e-3, "{published:?} at {p}");
            }
        }
    }
}
