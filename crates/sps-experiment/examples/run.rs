//! Runs an experiment and prints the mean R² of each method: `run CONFIG FOLDER`.

use std::env;
use std::path::Path;

use sps_experiment::config::Experiment;
use sps_experiment::run;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [config, folder] = arguments.as_slice() else {
        anyhow::bail!("expected a config and the folder to write to");
    };
    let experiment = Experiment::read(Path::new(config), &[])?;
    let (_folder, results) = run::run(&experiment, Path::new(folder), false)?;
    for method in &results.methods {
        match method.means.r2_mean {
            Some(r2) => println!("{}: {r2:.3}", method.label),
            None => println!("{}: {}", method.label, method.notes.join("; ")),
        }
    }
    Ok(())
}
