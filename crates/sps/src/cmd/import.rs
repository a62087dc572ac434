use std::path::PathBuf;

use anyhow::Result;

use crate::importing::{Import, Request};

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
    /// The names of the table's columns, one a line, where its first line does not have them; without
    /// a column that says which photographs a row is of, rows are in the order of their names, and
    /// blanks may stand for commas
    #[arg(long, value_name = "FILE")]
    columns: Option<PathBuf>,
    /// Folders in that of the photographs, one for each view, with the same names in each
    #[arg(long, value_name = "FOLDER,...", value_delimiter = ',')]
    views: Vec<String>,
    /// The roll angle of each view in degrees, 0 straight down; by default evenly spaced from 0 to 45
    #[arg(
        long,
        value_name = "DEGREES,...",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    angles: Vec<f64>,
    /// Take materials from names: 001_baked_clay01.jpg is surface 001-baked-clay, of baked-clay
    #[arg(long)]
    materials_from_names: bool,
    /// The folder to write the dataset to
    #[arg(long, value_name = "DATASET")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let import = Import::find(&Request {
        photographs: &args.photographs,
        values: &args.values,
        columns: args.columns.as_deref(),
        views: &args.views,
        angles: &args.angles,
        materials_from_names: args.materials_from_names,
    })?;
    import.write(&args.out)?;
    let [surfaces, views, groups] = import.counts();
    println!(
        "{}: {surfaces} surfaces in {groups} groups, photographs of each: {views}. It was assumed that",
        args.out.display()
    );
    for assumed in import.assumed() {
        println!("- {assumed};");
    }
    let properties = import.properties().iter().map(ToString::to_string);
    println!("Properties: {}.", properties.collect::<Vec<_>>().join(", "));
    let without_row = import.without_row();
    if !without_row.is_empty() {
        let first = without_row
            .iter()
            .take(3)
            .map(|path| path.display().to_string());
        let more = if without_row.len() > 3 { ", ..." } else { "" };
        println!(
            "Left out, for no row is of them: {} photographs ({}{more}).",
            without_row.len(),
            first.collect::<Vec<_>>().join(", ")
        );
    }
    println!("`inspect {}` shows what is in it.", args.out.display());
    Ok(())
}
