use std::path::PathBuf;

use anyhow::{Result, ensure};
use sps_estimator::Estimator;
use sps_experiment::config::{Experiment, Setting};
use sps_experiment::train;

/// Fit a model that `predict` can use
#[derive(clap::Args)]
#[command(
    after_help = "Prints how well models of this kind do on the splits of the config, then fits \
    the one to keep on all surfaces but those that calibrate its intervals.\n\nExample:\n  \
    sps train configs/smoke.toml --out models/smoke"
)]
pub struct Args {
    /// An experiment's TOML file; its `train` says which method, and how intervals are calibrated
    config: PathBuf,
    /// Override a key of the config; VALUE is TOML, or else a text
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<Setting>,
    /// The folder to write the model to
    #[arg(long, value_name = "MODEL_DIR")]
    out: PathBuf,
    /// Replace a model that is in the folder
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let experiment = Experiment::read(&args.config, &args.settings)?;
    let out = &args.out;
    ensure!(
        args.force || !Estimator::is_in(out),
        "{} holds a model; `--force` replaces it",
        out.display()
    );
    train::train(&experiment, out, &mut |line| println!("{line}"))?;
    println!("{}", out.display());
    Ok(())
}
