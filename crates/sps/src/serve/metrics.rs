//! Counts of requests, as Prometheus reads them.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use axum::http::StatusCode;

use super::locked;

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

    /// All of them in Prometheus' text format, version 0.0.4.
    pub(super) fn text(&self, sessions: usize) -> String {
        let answered = locked(&self.answered);
        let each = |lines: fn(&str, Tally) -> String| -> String {
            let all = answered.iter().map(|((path, status), tally)| {
                lines(&format!("{{path=\"{path}\",status=\"{status}\"}}"), *tally)
            });
            all.collect()
        };
        let totals = each(|labels, Tally { requests, .. }| {
            format!("sps_requests_total{labels} {requests}\n")
        });
        let seconds = each(|labels, Tally { requests, seconds }| {
            let sum = format!("sps_request_seconds_sum{labels} {seconds}");
            format!("{sum}\nsps_request_seconds_count{labels} {requests}\n")
        });
        let in_flight = self.in_flight.load(Ordering::Relaxed);
        format!(
            "# HELP sps_requests_total Requests answered.\n\
             # TYPE sps_requests_total counter\n{totals}\
             # HELP sps_request_seconds Seconds from a request's head to its answer.\n\
             # TYPE sps_request_seconds summary\n{seconds}\
             # HELP sps_requests_in_flight Requests not answered yet.\n\
             # TYPE sps_requests_in_flight gauge\nsps_requests_in_flight {in_flight}\n\
             # HELP sps_sessions Sessions kept.\n\
             # TYPE sps_sessions gauge\nsps_sessions {sessions}\n"
        )
    }
}

impl InFlight<'_> {
    pub(super) fn answered(&self, path: &str, status: StatusCode, took: Duration) {
        let mut answered = locked(&self.0.answered);
        let of = (path.to_owned(), status.as_u16());
        let tally = answered.entry(of).or_default();
        tally.requests += 1;
        tally.seconds += took.as_secs_f64();
    }
}

impl Drop for InFlight<'_> {
    fn drop(&mut self) {
        self.0.in_flight.fetch_sub(1, Ordering::Relaxed);
    }
}
