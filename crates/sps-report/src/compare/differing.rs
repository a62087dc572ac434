//! What two runs were computed from and with, where it differs.

use serde::Serialize;
use sps_experiment::config::{Differing, differing_keys};
use sps_experiment::results::Results;

use super::Run;

/// One side of what a run depends on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Aspect {
    pub name: &'static str,
    /// Empty where it is the same in both.
    pub differing: Vec<Differing>,
}

/// Config, sources, data and machine.
pub(super) fn aspects(first: &Run, second: &Run) -> Vec<Aspect> {
    let differs = |key: &str, of: fn(&Results) -> String| {
        let [first, second] = [first, second].map(|run| of(&run.results));
        (first != second).then(|| Differing {
            key: key.to_owned(),
            first: Some(first),
            second: Some(second),
        })
    };
    let sources = [differs("source_hash", |r| r.provenance.source_hash.clone())];
    let data = [
        differs("data_hash", |r| r.provenance.data_hash.clone()),
        differs("name", |r| r.dataset.name.clone()),
        differs("surfaces", |r| r.dataset.surfaces.to_string()),
        differs("units", |r| r.dataset.units.to_string()),
        differs("views", |r| r.dataset.views.to_string()),
    ];
    let machine = [
        differs("cpu", |r| r.provenance.cpu.clone()),
        differs("threads", |r| r.provenance.threads.to_string()),
    ];
    let aspect = |name, differing| Aspect { name, differing };
    vec![
        aspect("config", differing_keys(&first.config, &second.config)),
        aspect("sources", sources.into_iter().flatten().collect()),
        aspect("data", data.into_iter().flatten().collect()),
        aspect("machine", machine.into_iter().flatten().collect()),
    ]
}
