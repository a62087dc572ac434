use thiserror::Error;

/// The share of cases that an interval shall cover, strictly between 0 and 1.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "f64", into = "f64")
)]
pub struct Level(f64);

/// A level outside of (0, 1).
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error("an interval's level lies strictly between 0 and 1, found {found}")]
pub struct InvalidLevel {
    /// What was found.
    pub found: f64,
}

impl Level {
    /// 90 %.
    pub const P90: Self = Self(0.90);
    /// 95 %.
    pub const P95: Self = Self(0.95);

    /// A level, for example 0.9 for 90 %.
    ///
    /// # Errors
    /// [`InvalidLevel`] unless 0 < `level` < 1.
    pub fn new(level: f64) -> Result<Self, InvalidLevel> {
        if level > 0.0 && level < 1.0 {
            Ok(Self(level))
        } else {
            Err(InvalidLevel { found: level })
        }
    }

    /// The level as a fraction.
    pub const fn get(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for Level {
    type Error = InvalidLevel;

    fn try_from(level: f64) -> Result<Self, InvalidLevel> {
        Self::new(level)
    }
}

impl From<Level> for f64 {
    fn from(level: Level) -> Self {
        level.0
    }
}

/// `count * share` as decimals have it: 10 * 0.9 is 9, also where binary rounding lands next to
/// it.
pub(crate) fn steps(count: usize, share: f64) -> f64 {
    let product = count as f64 * share;
    let nearest = product.round();
    let is_near = (product - nearest).abs() <= slack(product);
    if is_near { nearest } else { product }
}

/// Whether a sum of fractions reaches what [`steps`] gave, as decimals have it: 9 + 9/10 reaches
/// 11 * 0.9. A whole sum reaches it exactly where it is no smaller.
pub(crate) fn reaches(sum: f64, steps: f64) -> bool {
    steps - sum <= slack(steps)
}

/// What binary rounding may put between a product and its decimal value.
fn slack(product: f64) -> f64 {
    4.0 * f64::EPSILON * product.max(1.0)
}
