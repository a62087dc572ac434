//! What regressions of sps-regress are fitted to.

use sps_dataset::{DatasetFolder, Source, TactileSettings};
use sps_estimator::{Embedder, Network};
use sps_models::encoders::Encoder;
use sps_regress::{Embeddings, Readings};

/// The embeddings of these views of all surfaces, and the readings of all properties.
pub(crate) fn tables(
    dataset: &DatasetFolder,
    encoder: Encoder,
    views: &[usize],
) -> (Embeddings, Readings) {
    let embedder = Embedder::new(Network::Images(encoder), None).unwrap();
    let count = dataset.surfaces().len();
    let of_surface = |at| views.iter().map(move |view| dataset.frame(at, *view));
    let frames = (0..count).flat_map(of_surface).map(Result::unwrap);
    let values = embedder.embed(&frames.collect::<Vec<_>>()).unwrap();
    let embeddings = embedder.table(&values, count, views.len()).unwrap();

    let settings = TactileSettings::default();
    let averages = dataset.tactile().averages(&settings, count);
    let names = averages.properties().iter().map(ToString::to_string);
    let names: Vec<String> = names.collect();
    let row = |at| names.iter().map(|name| averages.value(at, name)).collect();
    let rows: Vec<Vec<_>> = (0..count).map(row).collect();
    (embeddings, Readings::new(names, &rows).unwrap())
}
