//! Selects the best few views (or sensors) of many: the paper's selectors, greedy, exhaustive and
//! baselines, behind one trait.
//!
//! Use it where M of N inputs are to be kept, and the loss of any M of them can be asked for: views
//! of a camera, sensors of a machine, columns of a table. The crate knows nothing else about them.
//!
//! The selectors NVS and VB-NVS are those of Purri and Dana, "Teaching Cameras to Feel", ECCV 2020
//! (section "Viewpoint Selector Framework"). Beside them stands [`Exhaustive`], the true optimum, so
//! that every selector's distance from it can be told ([`Selection::regret`]).
//!
//! Which two of forty thermometers along a rod tell its mean temperature? Each reads the profile at
//! its place, and the estimate is the mean of the two readings:
//!
//! ```
//! use sps_viewselect::{Equidistant, Exhaustive, Problem, Selector, SetFunction, VbNvs};
//!
//! // The mean of x^p over a rod of length 1 is 1 / (p + 1).
//! let loss = SetFunction::new(40, 2, |sensors: &[usize]| {
//!     let error = |power: i32| {
//!         let reading = |&sensor: &usize| ((sensor as f64 + 0.5) / 40.0).powi(power);
//!         let estimate = sensors.iter().map(reading).sum::<f64>() / 2.0;
//!         (estimate - 1.0 / f64::from(power + 1)).powi(2)
//!     };
//!     (1..=3).map(error).sum()
//! });
//! let problem = Problem::new(&loss)?.distinct(true).seed(1);
//!
//! // Gauss's two points, 0.211 and 0.789, lie in the cells of sensors 8 and 31; sets are ordered.
//! let optimum = Exhaustive::default().select(&problem)?;
//! assert_eq!((optimum.picks, optimum.evaluations), (vec![8, 31], 40 * 39));
//!
//! let equidistant = Equidistant::default().select(&problem)?;
//! let learned = VbNvs { evaluations: 5000, ..VbNvs::default() }.select(&problem)?;
//! assert!(optimum.loss <= learned.loss && learned.loss < equidistant.loss);
//! # Ok::<(), sps_viewselect::SelectError>(())
//! ```
//!
//! # What is where
//!
//! - The question: [`SetLoss`], implemented for the loss at hand in ten lines, or [`SetFunction`]
//!   around a plain function. [`Problem`] checks it once and holds what all selectors have in
//!   common: whether views must be distinct, and the seed.
//! - Several questions at once: a [`SharedLoss`] gives a set's losses for all properties,
//!   [`Pooled`] is the loss of one of them shrunk towards the mean over all, and [`Remembered`]
//!   computes each set once.
//! - The answer: every [`Selector`] returns a [`Selection`], with picks, loss curve, evaluations
//!   and wall time.
//! - Baselines: [`Random`], [`Equidistant`] at centres or from end to end, [`Nadir`].
//! - Learned: [`Nvs`], trained by REINFORCE as [`PolicyTraining`] says, and [`VbNvs`], with a value
//!   network as [`ValueTraining`] and [`ValueSearch`] say. [`Policy`] is the distribution over sets
//!   with its gradient, for those who train it beside something else.
//! - Searched: [`Greedy`], a good local optimum; [`Exhaustive`], the optimum.
//! - Any of these by its name, with its settings: [`AnySelector`].
//! - [`TemporalRelations`] picks no fixed set: it draws ordered groups of views for the relation
//!   heads of a temporal relation network.
//!
//! # Randomness and threads
//!
//! Losses are asked for in parallel, on rayon's pool. Every draw comes from a ChaCha stream keyed by
//! (seed, purpose, index), and every sum is taken in a fixed order: the same seed gives the same
//! picks for any number of threads.
//!
//! Selectors are read from a config with serde, by kebab-case keys of which unknown ones are refused;
//! selections are written.

mod adam;
mod any;
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
mod remembered;
mod selection;
mod sets;
mod shared;
mod softmax;
mod stream;
#[cfg(test)]
#[path = "../tests/suite/uniform.rs"]
mod uniform;
mod value;
mod value_search;
mod vb_nvs;
mod vector;

pub use any::AnySelector;
pub use baselines::{Equidistant, EquidistantAt, Nadir, Random};
pub use error::SelectError;
pub use exhaustive::Exhaustive;
pub use greedy::Greedy;
pub use loss::{LossError, SetFunction, SetLoss};
pub use nvs::Nvs;
pub use policy::Policy;
pub use problem::{Problem, Selector};
pub use reinforce::{Baseline, PolicyTraining};
pub use relations::{RelationSampler, Relations, TemporalRelations};
pub use remembered::Remembered;
pub use selection::{CurvePoint, Selection};
pub use sets::{SetList, Sets};
pub use shared::{Pooled, SharedLoss};
pub use vb_nvs::{ValueSearch, ValueTraining, VbNvs};

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
