use anyhow::Result;
use serde::Serialize;
use sps_dataset::toccare;
use sps_experiment::text::aligned;
use sps_models::encoders::EncoderKind;
use sps_regress::RegressorKind;
use sps_viewselect::AnySelector;

use crate::output::print_json;

/// List encoders, regressors, selectors of views, or properties that have a name
#[derive(clap::Args)]
#[command(after_help = "Example:\n  sps list encoders")]
pub struct Args {
    #[arg(value_enum)]
    what: What,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum What {
    /// What a config's `encoder.name` may be, with the depths of each and where its weights come from
    Encoders,
    /// What a method's `kind` may be besides a network, a stack and the means
    Regressors,
    /// What a method's `selector.kind` may be
    Selectors,
    /// The fifteen of a SynTouch Toccare; any other code is a property, too
    Properties,
}

#[derive(Serialize)]
struct Entry {
    name: &'static str,
    about: String,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let entries = entries(args.what);
    if args.json {
        return print_json(&entries);
    }
    let line = |entry: Entry| vec![entry.name.to_owned(), entry.about];
    let lines: Vec<_> = entries.into_iter().map(line).collect();
    print!("{}", aligned(&lines, |_| true));
    Ok(())
}

fn entries(what: What) -> Vec<Entry> {
    let entry = |name, about| Entry { name, about };
    match what {
        What::Encoders => EncoderKind::ALL
            .map(|kind| entry(kind.name(), encoder(kind)))
            .into(),
        What::Regressors => RegressorKind::ALL
            .map(|kind| entry(kind.name(), kind.label().to_owned()))
            .into(),
        What::Selectors => AnySelector::NAMES
            .map(|(name, about)| entry(name, about.to_owned()))
            .into(),
        What::Properties => toccare::ALL
            .map(|known| entry(known.code, format!("{} ({})", known.name, known.category)))
            .into(),
    }
}

fn encoder(kind: EncoderKind) -> String {
    let depths = kind.depths();
    let ends = depths.first().zip(depths.last());
    let ends = ends.map_or_else(String::new, |(first, last)| {
        format!("depths {} to {}", first.name, last.name)
    });
    let weights = match kind.check_built_in() {
        Ok(()) => "built-in weights",
        Err(_) => "weights from a file",
    };
    format!("{ends}; {weights}")
}
