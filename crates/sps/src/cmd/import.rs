use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::Serialize;

use crate::importing::{Found, Frames, Import, Options, Request};
use crate::output::Output;

/// Lay photographs and a table of values out as a dataset
#[derive(clap::Args)]
#[command(
    after_help = "The table is CSV. One or more of its columns say which photographs a row is of:\n  \
    photograph                a path in the folder: a surface of its own\n  \
    photograph,surface,view   one photograph of a surface; a row for each\n  \
    surface                   a folder of photographs, the views of one surface\n  \
    class                     a folder of photographs, surfaces that share the row's values\n\
    Columns may be `material` and `group`. All others are properties; a code has letters, digits, `-` \
    and `_`. What is assumed stands in dataset.toml.\n\n\
    With --columns, blanks may stand for commas, and no column need say which photographs a row is of: rows are then \
    in the order of the photographs' names.\n\n\
    Example, with photographs in this repository and a values.csv of two lines, `surface,view,photograph,\
    friction` and `denim,0,denim-01/002.png,0.4`:\n  \
    sps import fixtures/tiny-dataset/frames --values values.csv --out data/mine\n\n\
    The material ratings as MatTag publishes them, with a folder for each view:\n  \
    sps import original_images --views non-specular,specular --angles 0,45 \
    --values original_images/ratings.txt --columns original_images/properties_order.txt \
    --materials-from-names --out data/material-ratings"
)]
pub struct Args {
    /// The folder of the photographs: PNG, JPEG or EXR
    photographs: PathBuf,
    /// The table of values
    #[arg(long, value_name = "FILE.csv")]
    values: PathBuf,
    #[command(flatten)]
    options: Options,
    /// The folder to write the dataset to
    #[arg(long, value_name = "DATASET")]
    out: PathBuf,
    #[command(flatten)]
    output: Output,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Imported<'a> {
    dataset: &'a Path,
    #[serde(flatten)]
    found: Found<'a>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let import = Import::find(&Request {
        photographs: &args.photographs,
        values: &args.values,
        options: &args.options,
    })?;
    import.write(&args.out, Frames::Copied)?;
    let dataset = args.out.display();
    args.output.say(&format!(
        "{dataset}: {}`inspect {dataset}` shows what is in it.",
        import.described()
    ));
    args.output.json(&Imported {
        dataset: &args.out,
        found: import.found(),
    })
}
