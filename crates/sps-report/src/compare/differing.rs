//! What two runs were computed from and with, where it differs.

use serde::Serialize;
use sps_experiment::config::{Differing, differing_keys};

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
    let config = differing_keys(&first.config, &second.config);
    let [(then, data), (now, other)] =
        [first, second].map(|run| (&run.results.provenance, &run.results.dataset));
    let sources = [("source_hash", &then.source_hash, &now.source_hash)];
    let readings = [
        ("data_hash", &then.data_hash, &now.data_hash),
        ("name", &data.name, &other.name),
        (
            "surfaces",
            &data.surfaces.to_string(),
            &other.surfaces.to_string(),
        ),
        ("units", &data.units.to_string(), &other.units.to_string()),
        ("views", &data.views.to_string(), &other.views.to_string()),
    ];
    let machine = [
        ("cpu", &then.cpu, &now.cpu),
        (
            "threads",
            &then.threads.to_string(),
            &now.threads.to_string(),
        ),
    ];
    let aspect = |name, differing| Aspect { name, differing };
    vec![
        aspect("config", config),
        aspect("sources", texts(&sources)),
        aspect("data", texts(&readings)),
        aspect("machine", texts(&machine)),
    ]
}

fn texts(values: &[(&str, &String, &String)]) -> Vec<Differing> {
    let differing = values.iter().filter(|(_, first, second)| first != second);
    let found = differing.map(|(key, first, second)| Differing {
        key: (*key).to_owned(),
        first: Some((*first).clone()),
        second: Some((*second).clone()),
    });
    found.collect()
}
