//! Long work that can be watched and interrupted.

use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use sps_experiment::progress::{Follower, follow};

use crate::errors::Raises;

/// Time between two looks whether the work was interrupted.
const BETWEEN_LOOKS: Duration = Duration::from_millis(100);

/// So many of these are done, of so many.
type Step = (String, usize, usize);

struct Watched {
    steps: Sender<Step>,
    over: Arc<AtomicBool>,
}

impl Follower for Watched {
    fn advanced(&self, what: &str, done: usize, total: usize) {
        // Nobody listens any more once the work is over.
        let _ = self.steps.send((what.to_owned(), done, total));
    }

    fn is_over(&self) -> bool {
        self.over.load(Ordering::Relaxed)
    }
}

/// Does `work` on a thread of its own and calls `progress` with each of its steps on this one, which
/// signals interrupt. What either raises ends the work and comes out.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce() -> anyhow::Result<T> + Send,
) -> Raises<T> {
    let progress = progress.map(|progress| progress.clone().unbind());
    let over = Arc::new(AtomicBool::new(false));
    let (sender, steps) = channel();
    let watched = Arc::new(Watched {
        steps: sender,
        over: Arc::clone(&over),
    });
    let look = move |step: Option<Step>| {
        Python::attach(|py| {
            py.check_signals()?;
            if let (Some(progress), Some(step)) = (&progress, step) {
                progress.call1(py, step)?;
            }
            Ok(())
        })
    };
    py.detach(move || {
        thread::scope(|scope| {
            let work = scope.spawn(move || {
                follow(watched);
                work()
            });
            let mut looked: PyResult<()> = Ok(());
            loop {
                let step = match steps.recv_timeout(BETWEEN_LOOKS) {
                    Ok(step) => Some(step),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                if looked.is_ok() {
                    looked = look(step);
                    over.store(looked.is_err(), Ordering::Relaxed);
                }
            }
            let done = work.join().unwrap_or_else(|panic| resume_unwind(panic));
            looked?;
            Ok(done?)
        })
    })
}
