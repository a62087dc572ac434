//! How a number changed since the baseline.

/// How a number changed, and whether it may.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Change {
    pub by: String,
    pub budget: String,
    pub verdict: Verdict,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Verdict {
    #[default]
    None,
    Within,
    Past,
    /// Past the budget, but by no more than reruns differ.
    Chance,
    Slower,
    Faster,
    New,
    NotMeasured,
}

impl Verdict {
    pub(super) fn within(within: bool) -> Self {
        if within { Self::Within } else { Self::Past }
    }

    pub(super) const fn text(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Within => "within",
            Self::Past => "PAST",
            Self::Chance => "past, may be chance",
            Self::Slower => "slower",
            Self::Faster => "faster",
            Self::New => "new",
            Self::NotMeasured => "not measured",
        }
    }
}

impl Change {
    /// A number that may grow by the share `more`, and shrink as it likes.
    pub(super) fn growth(then: f64, now: f64, more: f64) -> Self {
        let change = now / then - 1.0;
        Self {
            by: percent(change),
            budget: percent(more),
            verdict: Verdict::within(change <= more),
        }
    }
}

impl From<Verdict> for Change {
    fn from(verdict: Verdict) -> Self {
        Self {
            verdict,
            ..Self::default()
        }
    }
}

pub(super) fn percent(share: f64) -> String {
    format!("{:+.1} %", 100.0 * share)
}
