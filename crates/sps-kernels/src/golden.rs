//! The rules by which the scripts in `fixtures/golden` fill tensors.

#[path = "../../../fixtures/golden/rule.rs"]
mod rule;
#[path = "../../../fixtures/golden/weights.rs"]
mod weights;

pub(crate) use rule::{error, uniform};
pub(crate) use weights::weight;
