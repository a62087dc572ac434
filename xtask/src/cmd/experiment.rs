use std::path::PathBuf;

use anyhow::Result;
use glob::Pattern;

use crate::config::{self, Experiment, Setting};
use crate::report;
use crate::run;

/// Run an experiment, or finish one that was stopped
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
    cargo xtask experiment configs/ablation.toml\n  \
    cargo xtask experiment configs/ablation.toml --set reruns=1 --set 'properties=[\"fRS\"]' \
    --out runs/quick\n  \
    cargo xtask experiment configs/multi-view.toml --only 'nvs*' --set methods.nvs.views=5 \
    --out runs/nvs-5")]
pub(crate) struct Args {
    /// The experiment's TOML file
    config: PathBuf,
    /// Override a key of the config, a method by its id or place in it; VALUE is TOML, or else a text
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<Setting>,
    /// The folder to write to [default: runs/ and the config's name]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Forget the trials that were finished in the folder
    #[arg(long)]
    fresh: bool,
    /// Only the methods whose ids match this, `*` standing for any letters; may be given several times
    #[arg(long, value_name = "PATTERN")]
    only: Vec<Pattern>,
    /// List the methods with their settings, defaults and inherited ones included, and exit
    #[arg(long)]
    list: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let mut experiment = Experiment::read(&args.config, &args.settings)?;
    if !args.only.is_empty() {
        experiment.keep_only(&args.only)?;
    }
    if args.list {
        print!("{}", config::list(&experiment)?);
        return Ok(());
    }
    let folder = args
        .out
        .clone()
        .unwrap_or_else(|| PathBuf::from("runs").join(&experiment.name));
    let results = run::run(&experiment, &folder, args.fresh)?;
    print!("{}", report::summary(&results).terminal());
    println!("{}", folder.join("report.html").display());
    Ok(())
}
