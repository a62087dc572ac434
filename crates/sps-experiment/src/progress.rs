//! Progress of work that takes longer than a second: a bar on a terminal, a line now and then
//! elsewhere.

use std::cell::RefCell;
use std::fmt::Write;
use std::io::IsTerminal;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use tracing::info;

const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// Follows work, and may end it.
pub trait Follower: Send + Sync {
    /// So many of `what` are done, of so many. Work on several threads says so on each.
    fn advanced(&self, what: &str, done: usize, total: usize);

    /// Whether the work is to end, with an error.
    fn is_over(&self) -> bool;
}

thread_local! {
    static FOLLOWER: RefCell<Option<Arc<dyn Follower>>> = const { RefCell::new(None) };
}

/// Has all work that this thread begins from now on followed by `follower`, in place of a bar.
pub fn follow(follower: Arc<dyn Follower>) {
    FOLLOWER.set(Some(follower));
}

/// That whoever follows the work of this thread lets it go on.
pub(crate) fn ensure_wanted() -> Result<()> {
    let over = FOLLOWER
        .with_borrow(|follower| follower.as_ref().is_some_and(|follower| follower.is_over()));
    ensure!(!over, "the work was stopped");
    Ok(())
}

/// Counts up to a total; shows rate and time left.
pub struct Progress {
    follower: Option<Arc<dyn Follower>>,
    bar: ProgressBar,
    what: String,
    begun_at: u64,
    next_line: Option<Mutex<Instant>>,
}

impl Progress {
    /// Starts counting `total` of `what`, for example `frames encoded`.
    pub fn new(what: &str, total: usize) -> Self {
        Self::resumed(what, 0, total)
    }

    /// Goes on counting where `done` were done before.
    pub(crate) fn resumed(what: &str, done: usize, total: usize) -> Self {
        let style = ProgressStyle::with_template(
            "{msg} {wide_bar} {human_pos}/{human_len}, {per_sec}, {left} left",
        )
        .unwrap_or_else(|_| ProgressStyle::default_bar())
        .with_key("left", move |state: &ProgressState, out: &mut dyn Write| {
            let total = state.len().unwrap_or_default();
            let left = left(state.elapsed(), done as u64, state.pos(), total);
            let _ = write!(out, "{}", HumanDuration(left));
        });
        let bar = ProgressBar::new(total as u64)
            .with_style(style)
            .with_message(what.to_owned());
        let follower = FOLLOWER.with_borrow(Clone::clone);
        if follower.is_some() {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        bar.set_position(done as u64);
        bar.reset_eta();
        let next_line =
            (!std::io::stderr().is_terminal()).then(|| Mutex::new(Instant::now() + BETWEEN_LINES));
        Self {
            follower,
            bar,
            what: what.to_owned(),
            begun_at: done as u64,
            next_line,
        }
    }

    /// Says more about what is done now, for example the loss.
    pub fn say(&self, more: &str) {
        self.bar.set_message(format!("{}, {more}", self.what));
    }

    /// Counts `done` more.
    pub fn advance(&self, done: usize) {
        self.bar.inc(done as u64);
        if let Some(follower) = &self.follower {
            let total = self.bar.length().unwrap_or_default() as usize;
            follower.advanced(&self.what, self.bar.position() as usize, total);
            return;
        }
        let Some(Ok(mut next)) = self.next_line.as_ref().map(Mutex::lock) else {
            return;
        };
        let now = Instant::now();
        if now >= *next {
            *next = now + BETWEEN_LINES;
            let (message, done) = (self.bar.message(), self.bar.position());
            let total = self.bar.length().unwrap_or_default();
            let left = left(self.bar.elapsed(), self.begun_at, done, total).as_secs();
            info!("{message}: {done} of {total}, {left} s left");
        }
    }

    /// Whether whoever follows the work ends it.
    pub(crate) fn is_over(&self) -> bool {
        self.follower
            .as_ref()
            .is_some_and(|follower| follower.is_over())
    }
}

/// How long the rest takes if it goes on as on the mean so far: steps may differ by much, as the first
/// search of a rerun does from all that follow.
fn left(elapsed: Duration, begun_at: u64, done: u64, total: u64) -> Duration {
    let (done_here, rest) = (done.saturating_sub(begun_at), total.saturating_sub(done));
    elapsed.mul_f64(rest as f64 / done_here.max(1) as f64)
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
