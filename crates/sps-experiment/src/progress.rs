//! Progress of work that takes longer than a second: a bar on a terminal, a line now and then
//! elsewhere.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use tracing::info;

const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// Counts up to a total; shows rate and time left.
pub struct Progress {
    bar: ProgressBar,
    what: String,
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
            "{msg} {wide_bar} {human_pos}/{human_len}, {per_sec}, {eta} left",
        )
        .unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::new(total as u64)
            .with_style(style)
            .with_message(what.to_owned());
        bar.set_position(done as u64);
        bar.reset_eta();
        let next_line =
            (!std::io::stderr().is_terminal()).then(|| Mutex::new(Instant::now() + BETWEEN_LINES));
        Self {
            bar,
            what: what.to_owned(),
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
        let Some(next_line) = &self.next_line else {
            return;
        };
        let Ok(mut next) = next_line.lock() else {
            return;
        };
        let now = Instant::now();
        if now >= *next {
            *next = now + BETWEEN_LINES;
            info!(
                "{}: {} of {}, {} s left",
                self.bar.message(),
                self.bar.position(),
                self.bar.length().unwrap_or_default(),
                self.bar.eta().as_secs()
            );
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
