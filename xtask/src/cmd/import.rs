use std::path::PathBuf;

use anyhow::Result;

use crate::importing::Import;

/// Lay photographs and a table of values out as a dataset
#[derive(clap::Args)]
#[command(
    after_help = "The table's first column is `class`, the name of a folder of photographs that have one \
    value, or `photograph`, a path in the folder; then columns may be `material` and `group`. All others \
    are properties by their codes, fRS for one. What is assumed stands in dataset.toml.\n\nExample:\n  \
    cargo xtask import photographs --values values.csv --out data/mine"
)]
pub(crate) struct Args {
    /// The folder of the photographs: PNG, JPEG or EXR
    photographs: PathBuf,
    /// What was measured, as CSV
    #[arg(long, value_name = "FILE.csv")]
    values: PathBuf,
    /// The folder to write the dataset to
    #[arg(long, value_name = "DATASET")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let import = Import::find(&args.photographs, &args.values)?;
    import.write(&args.out)?;
    let [photographs, groups] = import.counts();
    println!(
        "{}: {photographs} photographs in {groups} groups. It was assumed that",
        args.out.display()
    );
    for assumed in import.assumed() {
        println!("- {assumed};");
    }
    println!(
        "`cargo xtask inspect {}` shows what is in it.",
        args.out.display()
    );
    Ok(())
}
