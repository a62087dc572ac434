//! Selection of views by a Python function.

use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread;

use anyhow::Result;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use rayon::ThreadPoolBuilder;
use serde_json::{Map, Value};
use sps_viewselect::{AnySelector, LossError, Problem, SelectError, Selector, SetLoss, Sets};

use crate::errors::Raises;
use crate::settings::json;

/// The views that were selected, and what they cost.
#[pyclass(module = "sps", frozen, get_all)]
pub(crate) struct Selection {
    /// The selected views, in the order of the slots.
    picks: Vec<usize>,
    /// Their loss.
    loss: f64,
    /// Sets whose loss was asked for, repeats included.
    evaluations: u64,
    /// Sets that the function was called for.
    computed: u64,
    /// Wall time of the selection.
    seconds: f64,
    /// The search as it went, a tuple a round: evaluations so far, mean loss of the round, lowest
    /// loss so far.
    curve: Vec<(u64, f64, f64)>,
}

#[pymethods]
impl Selection {
    fn __repr__(&self) -> String {
        shown!(Selection, self, picks loss evaluations)
    }
}

/// Selects k of n views (or sensors, or columns) whose loss is low.
///
/// `loss` is called with a tuple of k views, each from 0 to n - 1 and in the order of the slots, and
/// returns a number, lower for better. It must be a pure function: the same set has the same loss
/// every time. It is called on the calling thread, and an exception of it ends the search and comes
/// out as itself.
///
/// `method` is a name of `sps list selectors`; `settings` are the method's own, such as
/// `evaluations=2000` for nvs, with dictionaries for those in groups. `distinct` says that no view may come twice in a set, `seed` keys every draw.
///
/// Raises ValueError for unknown methods and settings, sets that cannot be, and losses that are NaN
/// or beyond 1e100.
#[pyfunction]
#[pyo3(signature = (loss, n, k, method = "greedy", *, seed = 0, distinct = false, **settings))]
#[expect(clippy::too_many_arguments, reason = "most are keywords")]
pub(crate) fn select_views(
    py: Python<'_>,
    loss: &Bound<'_, PyAny>,
    n: usize,
    k: usize,
    method: &str,
    seed: u64,
    distinct: bool,
    settings: Option<&Bound<'_, PyDict>>,
) -> Raises<Selection> {
    let method = configured(method, settings)?;
    let (questions, asked) = channel();
    let remote = RemoteLoss {
        views: n,
        picks: k,
        questions,
    };
    let search = move || {
        let problem = Problem::new(&remote)?.distinct(distinct).seed(seed);
        method.select(&problem)
    };
    let found = answer_while(py, loss, k, asked, search)?;
    let curve = found.curve.iter();
    let curve = curve.map(|point| (point.evaluations, point.mean, point.best));
    Ok(Selection {
        picks: found.picks,
        loss: found.loss,
        evaluations: found.evaluations,
        computed: found.computed,
        seconds: found.seconds,
        curve: curve.collect(),
    })
}

/// The selector of this name. Settings have the crate's names, with `_` for `-`.
fn configured(method: &str, settings: Option<&Bound<'_, PyDict>>) -> Result<AnySelector> {
    let mut values = match settings {
        Some(settings) => json(settings)?,
        None => Value::Object(Map::new()),
    };
    kebab_case(&mut values);
    values["kind"] = method.into();
    Ok(serde_json::from_value(values)?)
}

fn kebab_case(value: &mut Value) {
    if let Value::Object(entries) = value {
        for (key, mut value) in std::mem::take(entries) {
            kebab_case(&mut value);
            entries.insert(key.replace('_', "-"), value);
        }
    }
}

/// Sets, (sets, picks), and who waits for their losses.
type Question = (Vec<usize>, SyncSender<Vec<f64>>);

/// A loss that another thread computes.
struct RemoteLoss {
    views: usize,
    picks: usize,
    questions: Sender<Question>,
}

impl SetLoss for RemoteLoss {
    fn views(&self) -> usize {
        self.views
    }

    fn picks(&self) -> usize {
        self.picks
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        let (answer, answered) = sync_channel(1);
        self.questions.send((sets.as_flat().to_vec(), answer))?;
        losses.copy_from_slice(&answered.recv()?);
        Ok(())
    }
}

/// Runs `search` on a thread of its own and answers its questions on this one by calling `loss`: there
/// the function finds its thread's state, can be interrupted, and may use the threads of every pool.
fn answer_while(
    py: Python<'_>,
    loss: &Bound<'_, PyAny>,
    picks: usize,
    questions: Receiver<Question>,
    search: impl FnOnce() -> Result<sps_viewselect::Selection, SelectError> + Send,
) -> Result<sps_viewselect::Selection> {
    let pool = ThreadPoolBuilder::new().num_threads(1).build()?;
    let loss = loss.clone().unbind();
    py.detach(|| {
        thread::scope(|scope| {
            let search = scope.spawn(|| pool.install(search));
            // Ends with the search, which it ends where the function raises: nobody answers any more.
            let answered = questions
                .into_iter()
                .try_for_each(|asked| Python::attach(|py| answer(loss.bind(py), picks, asked)));
            let found = search.join().unwrap_or_else(|panic| resume_unwind(panic));
            answered?;
            Ok(found?)
        })
    })
}

fn answer(loss: &Bound<'_, PyAny>, picks: usize, (sets, waiting): Question) -> PyResult<()> {
    let py = loss.py();
    py.check_signals()?;
    let of = |set| loss.call1((PyTuple::new(py, set)?,))?.extract();
    let losses = sets.chunks_exact(picks).map(of);
    let losses: Vec<f64> = losses.collect::<PyResult<_>>()?;
    // The search waits for them, unless it panicked.
    let _ = waiting.send(losses);
    Ok(())
}
