//! Selection of the best few views (or sensors) of many: NVS, VB-NVS, TRN, greedy, exhaustive and baselines.

mod adam;
mod baselines;
mod critic;
mod error;
mod evaluator;
mod exhaustive;
mod greedy;
mod loss;
mod nvs;
mod policy;
mod problem;
mod reinforce;
mod relations;
mod selection;
mod sets;
mod softmax;
mod stream;
mod value;
mod value_search;
mod vb_nvs;

pub use baselines::{Equidistant, Nadir, Random};
pub use error::SelectError;
pub use exhaustive::Exhaustive;
pub use greedy::Greedy;
pub use loss::{LossError, SetFunction, SetLoss};
pub use nvs::Nvs;
pub use policy::Policy;
pub use problem::{Problem, Selector};
pub use reinforce::{Baseline, PolicyTraining};
pub use relations::{RelationSampler, Relations, TemporalRelations};
pub use selection::{CurvePoint, Selection};
pub use sets::{SetList, Sets};
pub use vb_nvs::{ValueSearch, ValueTraining, VbNvs};
