use crate::{
    Equidistant, Exhaustive, Greedy, Nadir, Nvs, Problem, Random, SelectError, Selection, Selector,
    VbNvs,
};

/// Any selector of this crate with its settings: what a config names.
///
/// With the feature `serde`, `kind` is the selector's name in kebab-case, and the other keys are its settings:
///
/// ```
/// # #[cfg(feature = "serde")] {
/// use sps_viewselect::{AnySelector, Greedy};
///
/// let config = r#"{ "kind": "greedy", "starts": 2 }"#;
/// let selector: AnySelector = serde_json::from_str(config)?;
/// let greedy = Greedy { starts: 2, ..Greedy::default() };
/// assert_eq!(selector, AnySelector::Greedy(greedy));
/// # }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "kind", rename_all = "kebab-case"))]
#[non_exhaustive]
pub enum AnySelector {
    /// Random sets, the best of so many draws.
    Random(Random),
    /// Equidistant views.
    Equidistant(Equidistant),
    /// The view in the middle.
    Nadir(Nadir),
    /// Network for view selection, the paper's.
    Nvs(Nvs),
    /// The paper's with a value network.
    VbNvs(VbNvs),
    /// A local optimum.
    Greedy(Greedy),
    /// The optimum.
    Exhaustive(Exhaustive),
}

impl AnySelector {
    /// Whether it chooses the same views whatever the loss and the seed.
    pub fn is_fixed(&self) -> bool {
        matches!(self, Self::Equidistant(_) | Self::Nadir(_))
    }

    /// Whether its choice depends on the loss of the sets.
    pub fn learns(&self) -> bool {
        match self {
            Self::Random(random) => random.draws > 1,
            selector => !selector.is_fixed(),
        }
    }
}

impl Selector for AnySelector {
    fn select(&self, problem: &Problem<'_>) -> Result<Selection, SelectError> {
        match self {
            Self::Random(selector) => selector.select(problem),
            Self::Equidistant(selector) => selector.select(problem),
            Self::Nadir(selector) => selector.select(problem),
            Self::Nvs(selector) => selector.select(problem),
            Self::VbNvs(selector) => selector.select(problem),
            Self::Greedy(selector) => selector.select(problem),
            Self::Exhaustive(selector) => selector.select(problem),
        }
    }
}
