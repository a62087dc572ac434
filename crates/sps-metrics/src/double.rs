//! Sums and products to about 106 bits, as unevaluated pairs of `f64`.
//!
//! Plain `f64` sums depend on the order of what is summed, at 1e8 + small beyond the eighth digit.
//! Here they do not, far below the last bit of an `f64`, and without a fused multiply-add, which
//! is a slow library call where the compiler may not assume the instruction.
//!
//! Algorithms and bounds: Dekker, "A floating-point technique for extending the available
//! precision", 1971; Joldes, Muller and Popescu, "Tight and rigorous error bounds for basic
//! building blocks of double-word arithmetic", 2017 (their algorithms 6, 10 and 17).

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// The value `hi + lo`, with `|lo|` at most half a unit in the last place of `hi`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Double {
    hi: f64,
    lo: f64,
}

impl Double {
    /// `a - b` without rounding.
    pub(crate) fn difference(a: f64, b: f64) -> Self {
        two_sum(a, -b)
    }

    /// Rounded to the nearest `f64`; infinite or NaN once anything on the way overflowed.
    pub(crate) fn value(self) -> f64 {
        self.hi + self.lo
    }

    pub(crate) fn abs(self) -> Self {
        if self.hi < 0.0 { -self } else { self }
    }
}

impl From<f64> for Double {
    fn from(value: f64) -> Self {
        Self { hi: value, lo: 0.0 }
    }
}

impl Neg for Double {
    type Output = Self;

    fn neg(self) -> Self {
        Self {
            hi: -self.hi,
            lo: -self.lo,
        }
    }
}

impl Add for Double {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let high = two_sum(self.hi, other.hi);
        let low = two_sum(self.lo, other.lo);
        let sum = fast_two_sum(high.hi, high.lo + low.hi);
        fast_two_sum(sum.hi, low.lo + sum.lo)
    }
}

impl AddAssign for Double {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Double {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Double {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let product = two_product(self.hi, other.hi);
        let cross = self.hi * other.lo + self.lo * other.hi;
        fast_two_sum(product.hi, product.lo + cross)
    }
}

impl Div for Double {
    type Output = Self;

    fn div(self, divisor: Self) -> Self {
        let quotient = self.hi / divisor.hi;
        let rest = self - divisor * Self::from(quotient);
        fast_two_sum(quotient, rest.value() / divisor.hi)
    }
}

fn two_sum(a: f64, b: f64) -> Double {
    let hi = a + b;
    let b_in_hi = hi - a;
    let lo = (a - (hi - b_in_hi)) + (b - b_in_hi);
    Double { hi, lo }
}

/// Exact where `|a| >= |b|` or `a == 0`.
fn fast_two_sum(a: f64, b: f64) -> Double {
    let hi = a + b;
    Double {
        hi,
        lo: b - (hi - a),
    }
}

/// Exact unless a partial product under- or overflows.
fn two_product(a: f64, b: f64) -> Double {
    let hi = a * b;
    let (a_hi, a_lo) = halves(a);
    let (b_hi, b_lo) = halves(b);
    let lo = ((a_hi * b_hi - hi) + a_hi * b_lo + a_lo * b_hi) + a_lo * b_lo;
    Double { hi, lo }
}

/// Two summands of at most 26 bits each (Veltkamp).
fn halves(a: f64) -> (f64, f64) {
    const SPLITTER: f64 = 134_217_729.0; // 2^27 + 1
    let scaled = SPLITTER * a;
    let hi = scaled - (scaled - a);
    (hi, a - hi)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Integers below 2^62, whose sums and products fit in an `i128`.
    fn exact(value: i64) -> Double {
        let hi = value as f64;
        fast_two_sum(hi, (i128::from(value) - hi as i128) as f64)
    }

    fn integer(value: Double) -> i128 {
        value.hi as i128 + value.lo as i128
    }

    proptest! {
        #[test]
        fn sums_of_integers_are_exact(a in -(1_i64 << 62)..1 << 62, b in -(1_i64 << 62)..1 << 62) {
            prop_assert_eq!(integer(exact(a) + exact(b)), i128::from(a) + i128::from(b));
            prop_assert_eq!(integer(exact(a) - exact(b)), i128::from(a) - i128::from(b));
        }

        #[test]
        fn products_of_53_bits_are_exact(a in -(1_i64 << 53)..1 << 53, b in -(1_i64 << 53)..1 << 53) {
            let product = Double::from(a as f64) * Double::from(b as f64);
            prop_assert_eq!(integer(product), i128::from(a) * i128::from(b));
        }

        #[test]
        fn quotients_multiply_back(a in 1_i64..1 << 62, b in 1_i64..1 << 62) {
            let back = exact(a) / exact(b) * exact(b);
            let error = (back - exact(a)).value().abs();
            prop_assert!(error <= a as f64 * 24.0 * 2f64.powi(-106), "{a} / {b}: {error:e}");
        }
    }

    #[test]
    fn overflow_shows_in_the_value() {
        let huge = Double::from(1e200);
        assert!(!(huge * huge).value().is_finite());
        assert!(
            !(Double::from(f64::MAX) + Double::from(f64::MAX))
                .value()
                .is_finite()
        );
    }
}
