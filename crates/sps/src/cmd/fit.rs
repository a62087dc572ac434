use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use sps_base::files::write_file;
use sps_estimator::Estimator;
use sps_experiment::config::{Experiment, Setting};
use sps_experiment::own::Chosen;
use sps_experiment::train::{self, Trained};
use sps_report as report;

use crate::importing::{Frames, Import, Options, Request};

/// The page beside a model.
const PAGE: &str = "report.html";

/// Fit a model to photographs and a table of values, or to what a config names
#[derive(clap::Args)]
#[command(
    group = clap::ArgGroup::new("examples").args(["photographs", "config"]).required(true),
    after_help = "Before it fits the model to keep, it holds out a tenth of the surfaces at a time (whole \
    groups, where the table has a column `group`) and says how well others estimate them. `import --help` \
    says which tables are read.\n\nExamples:\n  \
    sps fit fixtures/tiny-dataset/frames --values values.csv --out models/mine\n  \
    sps fit --config configs/smoke.toml --out models/smoke"
)]
pub struct Args {
    /// The folder of the photographs: PNG, JPEG or EXR
    #[arg(requires = "values")]
    photographs: Option<PathBuf>,
    /// The table of values
    #[arg(long, value_name = "FILE.csv", conflicts_with = "config")]
    values: Option<PathBuf>,
    #[command(flatten)]
    options: Options,
    /// Bring the shorter side of every photograph to so many pixels
    #[arg(long, value_name = "PIXELS", default_value = "256", value_parser = clap::value_parser!(u64).range(32..))]
    pixels: u64,
    /// Share of new surfaces, or groups, whose truth an interval holds
    #[arg(long, value_name = "SHARE", default_value = "0.9", value_parser = share)]
    level: f64,
    /// An experiment's TOML file, whose `train` says which method is fitted and how intervals are calibrated
    #[arg(long, value_name = "FILE", conflicts_with_all = ["pixels", "level", "layout"])]
    config: Option<PathBuf>,
    /// Override a key of the config; VALUE is TOML, or else a text
    #[arg(long = "set", value_name = "KEY=VALUE", requires = "config")]
    settings: Vec<Setting>,
    /// The folder to write the model to
    #[arg(long, value_name = "MODEL")]
    out: PathBuf,
    /// Replace a model that is in the folder
    #[arg(long)]
    force: bool,
}

fn share(text: &str) -> Result<f64, String> {
    let share = text
        .parse()
        .ok()
        .filter(|share| *share > 0.0 && *share < 1.0);
    share.ok_or_else(|| "expected a number between 0 and 1".to_owned())
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let out = &args.out;
    ensure!(
        args.force || !Estimator::is_in(out),
        "{} holds a model; `--force` replaces it",
        out.display()
    );
    if let Some(config) = &args.config {
        let experiment = Experiment::read(config, &args.settings)?;
        println!("{}", train::which(&experiment));
        let trained = train::train(&experiment, &mut |line| println!("{line}"))?;
        save(&trained, out)?;
    } else {
        let (photographs, values) = (args.photographs.as_deref(), args.values.as_deref());
        let both = photographs.zip(values);
        let (photographs, values) = both.context("expected photographs and --values")?;
        fit(args, photographs, values)?;
        println!("{}", out.join(PAGE).display());
    }
    println!("{}", out.display());
    Ok(())
}

/// Fits the method that estimates surfaces held out best, and writes the page of all beside the model.
fn fit(args: &Args, photographs: &Path, values: &Path) -> Result<()> {
    let import = Import::find(&Request {
        photographs,
        values,
        options: &args.options,
    })?;
    ensure!(
        import.groups() > 1,
        "{}: found one group, expected at least two, to hold one out",
        values.display()
    );
    print!("{}", import.described());
    let parent = args.out.parent().filter(|parent| *parent != Path::new(""));
    let parent = parent.unwrap_or(Path::new("."));
    fs::create_dir_all(parent).with_context(|| parent.display().to_string())?;
    let work = tempfile::Builder::new().prefix(".fit-").tempdir_in(parent);
    let work = work.with_context(|| parent.display().to_string())?;
    let name = photographs.file_name().unwrap_or("photographs".as_ref());
    let name = Path::new(name).with_extension("").display().to_string();
    // The dataset is called after its folder.
    let named = work.path().join("named");
    fs::create_dir(&named).with_context(|| named.display().to_string())?;
    let data = named.join(&name);
    import.write(&data, Frames::Linked)?;
    let settings = vec![
        Setting::new("encoder.resize", args.pixels as i64),
        Setting::new("train.level", args.level),
    ];
    let chosen = Chosen::of(&data, &name, settings, &work.path().join("run"))?;
    report::write(&chosen.run)?;
    print!("{}", report::summary(&chosen.results).terminal());
    println!(
        "`{}` is kept. It was chosen by these surfaces, which flatters its numbers a little.\n",
        chosen.method
    );
    let trained = chosen.train(&mut |line| println!("{line}"))?;
    save(&trained, &args.out)?;
    let page = chosen.run.file(PAGE);
    let page = fs::read(&page).with_context(|| page.display().to_string())?;
    let to = args.out.join(PAGE);
    write_file(&to, &page).with_context(|| to.display().to_string())
}

fn save(trained: &Trained, out: &Path) -> Result<()> {
    let saved = trained.model.save(out);
    saved.with_context(|| out.display().to_string())
}
