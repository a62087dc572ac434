//! Counts of requests, as Prometheus reads them.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::http::StatusCode;

#[derive(Default)]
pub(super) struct Metrics {
    in_flight: AtomicUsize,
    /// By route and status.
    answered: Mutex<BTreeMap<(String, u16), Tally>>,
}

#[derive(Clone, Copy, Default)]
struct Tally {
    requests: u64,
    seconds: f64,
}

/// A request until it is answered, or its client has left.
pub(super) struct InFlight<'a>(&'a Metrics);

impl Metrics {
    pub(super) fn enter(&self) -> InFlight<'_> {
        self.in_flight.fetch_add(1, Ordering::Relaxed);
        InFlight(self)
    }

    fn answered(&self) -> MutexGuard<'_, BTreeMap<(String, u16), Tally>> {
        self.answered.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// All of them in Prometheus' text format, version 0.0.4.
    pub(super) fn text(&self, sessions: usize) -> String {
        let mut text = String::new();
        let answered = self.answered();
        let mut family = |name: &str, kind: &str, help: &str, lines: &[String]| {
            let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}");
            for line in lines {
                let _ = writeln!(text, "{name}{line}");
            }
        };
        let each = |line: &dyn Fn(&str, Tally) -> Vec<String>| -> Vec<String> {
            let lines = answered.iter().flat_map(|((path, status), tally)| {
                line(&format!("{{path=\"{path}\",status=\"{status}\"}}"), *tally)
            });
            lines.collect()
        };
        family(
            "sps_requests_total",
            "counter",
            "Requests answered.",
            &each(&|labels, tally| vec![format!("{labels} {}", tally.requests)]),
        );
        family(
            "sps_request_seconds",
            "summary",
            "Seconds from a request's head to its answer.",
            &each(&|labels, tally| {
                vec![
                    format!("_sum{labels} {}", tally.seconds),
                    format!("_count{labels} {}", tally.requests),
                ]
            }),
        );
        let gauge = |value: usize| [format!(" {value}")];
        let in_flight = gauge(self.in_flight.load(Ordering::Relaxed));
        family(
            "sps_requests_in_flight",
            "gauge",
            "Requests not answered yet.",
            &in_flight,
        );
        family("sps_sessions", "gauge", "Sessions kept.", &gauge(sessions));
        text
    }
}

impl InFlight<'_> {
    pub(super) fn answered(&self, path: &str, status: StatusCode, took: Duration) {
        let mut answered = self.0.answered();
        let tally = answered
            .entry((path.to_owned(), status.as_u16()))
            .or_default();
        tally.requests += 1;
        tally.seconds += took.as_secs_f64();
    }
}

impl Drop for InFlight<'_> {
    fn drop(&mut self) {
        self.0.in_flight.fetch_sub(1, Ordering::Relaxed);
    }
}
