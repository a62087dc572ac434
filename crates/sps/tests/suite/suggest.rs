//! Which surfaces to measure next.

use std::fs;

use crate::support::{Ends, Scratch, root, simulated};
use crate::tables::tables;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use sps_dataset::{DatasetFolder, ReadSettings, Source};
use sps_metrics::{Samples, TrainingMean};
use sps_models::encoders::{Depths, Encoder, EncoderKind};
use sps_regress::kernel_ridge::{KernelRidge, KernelRidgeConfig};
use sps_regress::{Embeddings, FittedRegressor, Plan, Readings, Rerun, TrainingData};

#[test]
fn photographs_without_a_row_are_named() {
    let scratch = Scratch::new();
    let frames = scratch.path("data/frames");
    let line = "suggest @data/frames --pixels 32";
    let named = scratch.sps(&format!("{line} --count 3")).said();
    let lines: Vec<&str> = named.lines().collect();
    assert_eq!(lines.len(), 3, "{named}");
    let one = lines[0].strip_prefix(frames.to_str().unwrap()).unwrap();
    let row = format!("photograph,friction\n{},0.5\n", one.trim_start_matches('/'));
    scratch.write("values.csv", row);
    let line = format!("{line} --values @values.csv --count 2");
    let next = scratch.sps(&line).said();
    assert_eq!(next.lines().collect::<Vec<_>>(), lines[1..], "{next}");
}

/// Mean R² over the properties of surfaces held out, fitted to the training surfaces.
fn r2(of: (&Embeddings, &Readings), held_out: &[usize], training: &[usize]) -> f64 {
    let (embeddings, readings) = of;
    let rerun = Rerun::new(0, training.iter().copied());
    let plan = Plan::each(0, readings.properties(), vec![rerun]);
    let ridge = KernelRidge::new(KernelRidgeConfig::default()).unwrap();
    let data = TrainingData::new(embeddings, readings);
    let fitted = ridge.train(&data, &plan).unwrap();
    let asked = embeddings.select(held_out, &[0]).unwrap();
    let all = fitted.predict(&asked).unwrap();
    let r2 = all.iter().enumerate().map(|(column, estimates)| {
        let truths = |surfaces: &[usize]| -> Vec<f64> {
            let truths = surfaces.iter().map(|at| readings.get(*at, column));
            truths.map(Option::unwrap).collect()
        };
        let samples = Samples {
            truth: &truths(held_out),
            estimate: &estimates.values,
        };
        let mean = TrainingMean::of(&truths(training)).unwrap();
        samples.r2(mean).unwrap().value
    });
    r2.sum::<f64>() / all.len() as f64
}

/// How many surfaces are measured.
const MEASURED: [usize; 4] = [10, 20, 40, 80];

/// Mean R² by number of measured surfaces, chosen and at random, over some draws of the surfaces to choose from.
fn curves(dataset: &DatasetFolder, held_out: usize) -> [[f64; 2]; MEASURED.len()] {
    const DRAWS: u64 = 20;
    let encoder = Encoder::built_in(EncoderKind::EfficientNetLiteBody).unwrap();
    let encoder = encoder.with_depths(&Depths::All).unwrap();
    let (embeddings, readings) = tables(dataset, encoder, &[0]);
    let count = dataset.surfaces().len();
    let ridge = KernelRidge::new(KernelRidgeConfig::default()).unwrap();
    let mut sums = [[0.0; 2]; MEASURED.len()];
    for draw in 0..DRAWS {
        let mut random = ChaCha8Rng::seed_from_u64(draw);
        let mut order: Vec<usize> = (0..count).collect();
        for at in (1..count).rev() {
            order.swap(at, random.next_u64() as usize % (at + 1));
        }
        let (held_out, pool) = order.split_at(held_out);
        let r2 = |training: &[usize]| r2((&embeddings, &readings), held_out, training);
        let open = embeddings.select(pool, &[0]).unwrap();
        let most = MEASURED[MEASURED.len() - 1];
        let chosen = ridge.most_telling(&open, &[], most).unwrap();
        let chosen: Vec<usize> = chosen.into_iter().map(|at| pool[at]).collect();
        for (sums, count) in sums.iter_mut().zip(MEASURED) {
            sums[0] += r2(&chosen[..count]) / DRAWS as f64;
            sums[1] += r2(&pool[..count]) / DRAWS as f64;
        }
    }
    for (count, [chosen, random]) in MEASURED.iter().zip(sums) {
        println!("{count} measured: R² {chosen:.3} chosen, {random:.3} at random");
    }
    sums
}

/// The numbers in the row of docs/guide.md that begins with a word.
fn in_the_guide(word: &str) -> Vec<f64> {
    let guide = fs::read_to_string(root().join("docs/guide.md")).unwrap();
    let begin = format!("| {word} |");
    let row = guide.lines().find_map(|line| line.strip_prefix(&begin));
    let cells = row.unwrap().trim_end_matches('|').split('|');
    cells.map(|cell| cell.trim().parse().unwrap()).collect()
}

#[test]
fn chosen_surfaces_teach_more_than_random_ones_do() {
    let folder = root().join("../shared/data/material-ratings");
    if !folder.exists() {
        println!("SKIPPED: {} is not there", folder.display());
        return;
    }
    let dataset = DatasetFolder::open(&folder, &ReadSettings::default()).unwrap();
    let curves = curves(&dataset, 80);
    for (at, word) in ["chosen", "at random"].into_iter().enumerate() {
        let found = curves.map(|both| both[at]);
        let told = in_the_guide(word);
        assert_eq!(told.len(), found.len());
        let mut both = told.iter().zip(found);
        let near = both.all(|(told, found)| (told - found).abs() < 0.005);
        assert!(near, "{word}: the guide has {told:?}, found {found:?}");
    }
    let gains = curves.map(|[chosen, random]| chosen - random);
    assert!(gains[0] > 0.05 && gains[1] > 0.03, "{gains:?}");
    assert!(gains.iter().all(|gain| *gain > -0.01), "{gains:?}");
}

#[test]
fn so_do_simulated_ones() {
    let scratch = simulated("--surfaces 300 --views 1 --size 96 --seed 5");
    let dataset = DatasetFolder::open(&scratch.path("data"), &ReadSettings::default()).unwrap();
    let gains = curves(&dataset, 100).map(|[chosen, random]| chosen - random);
    assert!(gains[0] > 0.0 && gains[1] > 0.0, "{gains:?}");
}
