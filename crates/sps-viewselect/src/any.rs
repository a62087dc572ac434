use serde::{Deserialize, Serialize};

use crate::{
    Equidistant, Exhaustive, Greedy, Nadir, Nvs, Problem, Random, SelectError, Selection, Selector,
    VbNvs,
};

/// Any selector of this crate with its settings: what a config names.
///
/// `kind` is the selector's name in kebab-case, and the other keys are its settings:
///
/// ```
/// use sps_viewselect::{AnySelector, Greedy};
///
/// let config = r#"{ "kind": "greedy", "starts": 2 }"#;
/// let selector: AnySelector = serde_json::from_str(config)?;
/// let greedy = Greedy { starts: 2, ..Greedy::default() };
/// assert_eq!(selector, AnySelector::Greedy(greedy));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
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
    /// What a config may call them, each with what it does.
    pub const NAMES: [(&str, &str); 7] = [
        ("random", "random sets, the best of so many draws"),
        ("equidistant", "the middles of equal parts of the views"),
        ("nadir", "the view in the middle, and its neighbours"),
        ("nvs", "network for view selection, the paper's"),
        ("vb-nvs", "the paper's with a value network"),
        ("greedy", "a local optimum, from several starts"),
        ("exhaustive", "the optimum, by all sets"),
    ];

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_that_of_a_selector() {
        for (name, _) in AnySelector::NAMES {
            let config = format!("{{ \"kind\": \"{name}\" }}");
            let selector: AnySelector = serde_json::from_str(&config).unwrap();
            let written = serde_json::to_value(&selector).unwrap();
            assert_eq!(written["kind"], name);
        }
        let unknown = serde_json::from_str::<AnySelector>(r#"{ "kind": "?" }"#).unwrap_err();
        let listed = unknown.to_string().matches('`').count() / 2 - 1;
        assert_eq!(listed, AnySelector::NAMES.len(), "{unknown}");
    }
}
