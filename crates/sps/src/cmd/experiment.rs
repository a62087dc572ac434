use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use glob::Pattern;
use sps_experiment::config::{self, Experiment, Setting};
use sps_experiment::files::read_text;
use sps_experiment::run::{self, CONFIG};
use sps_experiment::work::{Shard, Work};
use sps_report as report;

use crate::output::print_json;

/// Run an experiment, or finish one that was stopped
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
    sps experiment configs/ablation.toml\n  \
    sps experiment configs/ablation.toml --set reruns=1 --set 'properties=[\"fRS\"]' \
    --out runs/quick\n  \
    sps experiment configs/multi-view.toml --only 'nvs*' --set methods.nvs.views=5 \
    --out runs/nvs-5\n  \
    sps experiment configs/ablation.toml --dry-run\n  \
    sps experiment configs/ablation.toml --shard 2/4\n  \
    sps experiment configs/ablation.toml --merge")]
#[expect(clippy::struct_excessive_bools, reason = "each is an option")]
pub struct Args {
    /// The experiment's TOML file; docs/config.md and crates/sps-experiment/src/config/defaults.toml say what its keys mean
    config: PathBuf,
    /// Override a key of the config, such as seed=1 or methods.ID.views=3; VALUE is TOML, or else a text
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<Setting>,
    /// The folder to write to [default: runs/ and the config's name]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Do every trial again, also those that are finished in the folder
    #[arg(long)]
    fresh: bool,
    /// Only the methods whose ids match this, `*` standing for any letters; may be given several times
    #[arg(long, value_name = "PATTERN")]
    only: Vec<Pattern>,
    /// List the methods, those of sweeps and the floors included, each with all its settings, and exit
    #[arg(long)]
    list: bool,
    /// Print the content of results.json
    #[arg(long, conflicts_with_all = ["list", "dry_run", "shard"])]
    json: bool,
    /// Say how much is done and how much is missing, and exit; writes nothing
    #[arg(long, conflicts_with = "fresh")]
    dry_run: bool,
    /// Do the K-th of N parts and write no report; other processes or machines do the other parts
    #[arg(long, value_name = "K/N", conflicts_with = "merge")]
    shard: Option<Shard>,
    /// Make the results and the report of the parts that --shard left below these folders [default: the
    /// one to write to]
    #[arg(long, value_name = "DIR", num_args = 0.., conflicts_with_all = ["fresh", "dry_run"])]
    merge: Option<Vec<PathBuf>>,
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
    let default = Path::new("runs").join(&experiment.name);
    let folder = args.out.clone().unwrap_or(default);
    if args.dry_run {
        experiment.work = Work::None;
        print!("{}", run::outlook(&experiment, &folder, args.shard)?);
        return Ok(());
    }
    if let Some(shard) = args.shard {
        experiment.work = Work::Shard(shard);
        let own = run::shard(&experiment, shard, &folder, args.fresh)?;
        println!("{}", own.display());
        return Ok(());
    }
    if args.out.is_none() {
        ensure_same_settings(&experiment, &folder)?;
    }
    let (folder, results) = match &args.merge {
        None => run::run(&experiment, &folder, args.fresh)?,
        Some(runs) => {
            experiment.work = Work::Encoding;
            let own = std::slice::from_ref(&folder);
            let runs = if runs.is_empty() { own } else { runs };
            run::merge(&experiment, &folder, runs)?
        }
    };
    report::write(&folder)?;
    if args.json {
        return print_json(&results);
    }
    print!("{}", report::summary(&results).terminal());
    println!("{}", folder.file("report.html").display());
    Ok(())
}

/// That a folder which was not named has no report of other settings, which would be replaced.
fn ensure_same_settings(experiment: &Experiment, folder: &Path) -> Result<()> {
    let path = folder.join(CONFIG);
    if !path.exists() {
        return Ok(());
    }
    let there: toml::Table = sps_dataset::parse_toml(&path, &read_text(&path)?)?;
    if let Some(differing) = config::differing_keys(&there, &experiment.resolved.parse()?).first() {
        let (path, folder) = (path.display(), folder.display());
        bail!(
            "{path}: {differing}; `--out DIR` keeps that run, `--out {folder}` replaces its report"
        );
    }
    Ok(())
}
