use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde::Serialize;
use sps_base::files::write_file;
use sps_estimator::{About, Estimator, Precomputed};
use sps_experiment::config::{Experiment, Setting};
use sps_experiment::own::Chosen;
use sps_experiment::train::{self, Trained};
use sps_report as report;

use crate::fitting::{self, PAGE};
use crate::importing::{Frames, Import, Options, Request};
use crate::output::Output;

/// Fit a model to photographs and a table of values, or to what a config names
#[derive(clap::Args)]
#[command(
    group = clap::ArgGroup::new("examples").args(["photographs", "config"]).required(true),
    after_help = "How well it estimates is measured first: ten times, it holds out a tenth of the surfaces and \
    estimates them by a model of the others. Where the table has a column `group`, it holds out whole \
    groups.\n\n`import --help` says which tables are read.\n\nA file of embeddings is as `sps embed` writes it: \
    safetensors, a tensor (photographs, width) for each block, whose metadata names the `files` of the rows. Without \
    `files`, and in .npy, rows are in the order of the photographs' paths.\n\nExamples:\n  \
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
    /// A network to look at photographs by, in place of the built-in one
    #[arg(long, value_name = "FILE.onnx", conflicts_with = "config")]
    encoder: Option<PathBuf>,
    /// Embeddings of the photographs that were computed elsewhere, in place of the built-in encoder's
    #[arg(long, value_name = "FILE", conflicts_with_all = ["config", "encoder", "pixels"])]
    embeddings: Option<PathBuf>,
    /// Share of new surfaces, or groups, whose truth an interval holds
    #[arg(long, value_name = "SHARE", default_value = "0.9", value_parser = share)]
    level: f64,
    /// Keep a small photograph of each surface in the model: `serve` shows those that look most like a new one
    #[arg(long, conflicts_with = "config")]
    keep_photographs: bool,
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
    #[command(flatten)]
    output: Output,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Fitted<'a> {
    model: &'a Path,
    about: &'a About,
    /// Surfaces furthest from what was measured, and by how many standard deviations.
    worst: &'a [(String, f64)],
}

fn share(text: &str) -> Result<f64> {
    let share = text.parse().ok();
    let share = share.filter(|share| *share > 0.0 && *share < 1.0);
    share.context("expected a number between 0 and 1")
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let out = &args.out;
    let folder = out.display();
    ensure!(
        args.force || !Estimator::is_in(out),
        "{folder} holds a model; `--force` replaces it"
    );
    let trained = if let Some(config) = &args.config {
        let experiment = Experiment::read(config, &args.settings)?;
        args.output.say(&train::which(&experiment));
        let trained = train::train(&experiment, &mut |line| args.output.say(line))?;
        let saved = trained.model.save(out);
        saved.with_context(|| out.display().to_string())?;
        trained
    } else {
        let (photographs, values) = (args.photographs.as_deref(), args.values.as_deref());
        let both = photographs.zip(values);
        let (photographs, values) = both.context("expected photographs and --values")?;
        let trained = fit(args, photographs, values)?;
        args.output.say(&out.join(PAGE).display().to_string());
        trained
    };
    args.output.say(&out.display().to_string());
    args.output.json(&Fitted {
        model: out,
        about: trained.model.about(),
        worst: &trained.worst,
    })
}

/// Fits the method that estimates surfaces held out best, and writes the page of all beside the model.
fn fit(args: &Args, photographs: &Path, values: &Path) -> Result<Trained> {
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
    args.output.say(import.described().trim_end());
    let parent = args.out.parent().filter(|parent| *parent != Path::new(""));
    let parent = parent.unwrap_or(Path::new("."));
    fs::create_dir_all(parent).with_context(|| parent.display().to_string())?;
    let work = tempfile::Builder::new().prefix(".fit-").tempdir_in(parent);
    let work = work.with_context(|| parent.display().to_string())?;
    let name = photographs.file_name().unwrap_or("photographs".as_ref());
    let name = Path::new(name).with_extension("").display().to_string();
    // The dataset is called after its folder.
    let data = work.path().join("named").join(&name);
    import.write(&data, Frames::Linked)?;
    let mut settings = vec![
        Setting::new("train.level", args.level),
        Setting::new("train.keep-photographs", args.keep_photographs),
    ];
    if let Some(file) = &args.embeddings {
        // Called after the file, as the report will have it.
        let name = file.file_name().unwrap_or(file.as_os_str());
        let ordered = work.path().join(name);
        let rows = import.rows_of(Precomputed::read(file)?, Some(photographs));
        let rows = rows.with_context(|| file.display().to_string())?;
        write_file(&ordered, &rows.to_bytes()?)?;
        let ordered = ordered.display().to_string();
        settings.push(Setting::new("encoder.embeddings", ordered));
    } else {
        settings.push(Setting::new("encoder.resize", args.pixels as i64));
    }
    if let Some(file) = &args.encoder {
        settings.push(Setting::new("encoder.onnx", file.display().to_string()));
    }
    let chosen = Chosen::of(&data, &name, settings, &work.path().join("run"))?;
    let summary = report::summary(&chosen.results).terminal();
    args.output.say(summary.trim_end());
    args.output.say(&format!(
        "`{}` is kept. It was chosen by these surfaces, which flatters its numbers a little.\n",
        chosen.method
    ));
    let trained = chosen.train(&mut |line| args.output.say(line))?;
    fitting::save(&chosen, &trained, &args.out)?;
    Ok(trained)
}
