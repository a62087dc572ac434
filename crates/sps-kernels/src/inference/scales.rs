//! How the feature maps of a network in int8 are scaled, and the calibration that finds out.

use crate::error::{Error, Result};
use crate::network::{Layer, Network};

/// The largest number of a map.
const LARGEST: f32 = 255.0;

/// What the numbers of a feature map in memory stand for: `step * (number - zero)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// The step, a normal number above 0.
    pub step: f32,
    /// The number that stands for 0, whole, 0 to 255.
    pub zero: f32,
}

impl Scale {
    /// Of numbers that stand for themselves.
    pub(crate) const UNIT: Self = Self {
        step: 1.0,
        zero: 0.0,
    };

    /// Of values between two ends, 0 among them: it has a number of its own, so that padding is exact.
    fn between(least: f32, most: f32) -> Self {
        // Ends of any size: their difference may be no number.
        let step = most / LARGEST - least / LARGEST;
        // Of values that are all 0, or so small that the step is none.
        if step < f32::MIN_POSITIVE {
            return Self::UNIT;
        }
        Self {
            step,
            zero: (-least / step).round(),
        }
    }

    /// What a number stands for.
    pub(crate) fn value(self, number: f32) -> f32 {
        self.step * (number - self.zero)
    }

    /// The scales that a tensor `(maps, 2)` of this shape holds, one for each map of a network.
    ///
    /// # Errors
    /// When they are not as many as the network has maps, or one is no scale.
    pub fn of_tensor(network: &Network, shape: &[usize], values: &[f32]) -> Result<Vec<Self>> {
        let expected = [network.channels.len(), 2];
        let error = |found: &dyn std::fmt::Display| {
            let what = format_args!(
                "{expected:?}, of each map of {} a finite step above 0 and a whole number of 0 to 255",
                network.name
            );
            Error::input("scales for int8", found, what)
        };
        if shape != expected || values.len() != 2 * expected[0] {
            return Err(error(&format_args!("{shape:?}")));
        }
        let scales = values.chunks_exact(2).map(|row| {
            let (step, zero) = (row[0], row[1]);
            let sound = step.is_normal() && step > 0.0 && (0.0..=LARGEST).contains(&zero);
            if sound && zero.fract() == 0.0 {
                return Ok(Self { step, zero });
            }
            Err(error(&format_args!("{row:?}")))
        });
        scales.collect()
    }
}

/// The scales of a network's maps, in each of which these values were seen.
///
/// # Errors
/// When no image was seen, or a value that is not finite.
pub(super) fn scales(network: &Network, seen: &[Values]) -> Result<Vec<Scale>> {
    let mut scales = seen.iter().map(Values::scale).collect::<Result<Vec<_>>>()?;
    // What is pooled is not scaled anew.
    for (number, layer) in network.layers.iter().enumerate() {
        if let Layer::MaxPool(pool) = layer {
            scales[number + 1] = scales[pool.input];
        }
    }
    Ok(scales)
}

/// How often values occurred, by their upper 16 bits: sign, exponent and seven more.
#[derive(Debug, Clone)]
pub(super) struct Values {
    counts: Vec<u64>,
    least: f32,
    most: f32,
}

impl Values {
    pub(super) fn new() -> Self {
        Self {
            counts: vec![0; 1 << 16],
            least: 0.0,
            most: 0.0,
        }
    }

    pub(super) fn see(&mut self, values: &[f32]) {
        for &value in values {
            self.counts[(value.to_bits() >> 16) as usize] += 1;
            self.least = self.least.min(value);
            self.most = self.most.max(value);
        }
    }

    /// As [`calibrate`](super::calibrate) says.
    fn scale(&self) -> Result<Scale> {
        let seen: Vec<(f64, u64)> = (0_u32..)
            .zip(&self.counts)
            .filter(|(_, count)| **count > 0)
            // The middle of what these bits begin.
            .map(|(bits, &count)| (f64::from(f32::from_bits(bits << 16 | 0x8000)), count))
            .collect();
        if seen.is_empty() || seen.iter().any(|(value, _)| !value.is_finite()) {
            let found = if seen.is_empty() {
                "none"
            } else {
                "such that a feature map is not finite"
            };
            let what = "images to calibrate with";
            return Err(Error::input(what, found, "finite ones"));
        }
        let (least, most) = (f64::from(self.least), f64::from(self.most));
        let ends = |[lower, upper]: [f64; 2]| [lower * least, upper * most];
        let error = |shares: [f64; 2]| {
            let [least, most] = ends(shares);
            let step = (most - least) / f64::from(LARGEST);
            let of_value = |&(value, count): &(f64, u64)| {
                let clipped = value - value.clamp(least, most);
                let rounded = step * step / 12.0;
                let squared = clipped * clipped;
                count as f64 * if clipped == 0.0 { rounded } else { squared }
            };
            seen.iter().map(of_value).sum::<f64>()
        };
        let mut best = (error([1.0; 2]), [1.0; 2]);
        for end in [1, 0, 1] {
            let mut shares = best.1;
            for hundredths in (1..=100).rev() {
                shares[end] = f64::from(hundredths) / 100.0;
                let error = error(shares);
                if error < best.0 {
                    best = (error, shares);
                }
            }
        }
        let [least, most] = ends(best.1).map(|end| end as f32);
        Ok(Scale::between(least, most))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::golden::uniform;

    /// The squared error of values in steps of a scale, one by one.
    fn squared_error(values: &[f32], scale: Scale) -> f64 {
        let error = |&value: &f32| {
            let number = (value / scale.step + scale.zero).round();
            f64::from(scale.value(number.clamp(0.0, LARGEST)) - value).powi(2)
        };
        values.iter().map(error).sum()
    }

    fn scale(values: &[f32]) -> Scale {
        let mut seen = Values::new();
        seen.see(values);
        seen.scale().unwrap()
    }

    /// Of all pairs of hundredths, tried one by one, none is much better.
    #[test]
    fn the_range_is_that_of_the_least_squared_error() {
        let cubed = uniform("cubed", 5000).into_iter();
        let cubed: Vec<f32> = cubed.map(|x| (4.0 * x.powi(9)) as f32).collect();
        let rectified: Vec<f32> = cubed.iter().map(|x| x.max(0.0)).collect();
        let lopsided = cubed.iter().map(|x| if *x < 0.0 { x / 3.0 } else { *x });
        let lopsided: Vec<f32> = lopsided.collect();
        for values in [cubed, rectified, lopsided] {
            let found = squared_error(&values, scale(&values));
            let [least, most] = [f32::min, f32::max].map(|f| values.iter().copied().fold(0.0, f));
            let pairs =
                (1..=25).flat_map(|l| (1..=25).map(move |m| [l, m].map(|h| h as f32 / 25.0)));
            let tried = pairs.map(|[lower, upper]| {
                squared_error(&values, Scale::between(lower * least, upper * most))
            });
            let best = tried.fold(f64::INFINITY, f64::min);
            let whole = squared_error(&values, Scale::between(least, most));
            println!("found {found:.3e}, best {best:.3e}, the whole range {whole:.3e}");
            assert!(found <= 1.05 * best);
        }
    }

    /// One value far from millions of others does not take the steps from them, and the other end stays.
    #[test]
    fn an_outlier_is_clipped() {
        let values = uniform("outlier", 100_000).into_iter().map(|x| x as f32);
        let values: Vec<f32> = values.collect();
        let mut seen = Values::new();
        for _ in 0..100 {
            seen.see(&values);
        }
        seen.see(&[20.0]);
        let found = seen.scale().unwrap();
        let [lower, upper] = [0.0, LARGEST].map(|number| found.value(number));
        assert!((-1.05..-0.9).contains(&lower), "{found:?}");
        assert!((0.9..3.0).contains(&upper), "{found:?}");
    }

    #[test]
    fn zero_has_a_number_of_its_own() {
        let given: [&[f32]; 5] = [&[0.0], &[3.0, 5.0], &[-3.0, -5.0], &[-1.0, 2.0], &[1e-44]];
        for values in given {
            let found = scale(values);
            assert!(found.step.is_normal(), "{found:?}");
            assert_eq!(found.zero.fract(), 0.0, "{found:?}");
            assert!((0.0..=LARGEST).contains(&found.zero), "{found:?}");
            assert_eq!(found.value(found.zero), 0.0);
        }
    }
}
