//! Properties of any name: what a dataset says of them, many at once, and what is refused.

use std::fmt::Write as _;

use crate::made::{Made, SURFACES, property};
use sps_dataset::{RangePolicy, Source, TactileSettings};

const OWN: &str = "\
name = \"made\"
properties = [\"hardness\", \"friction\", \"fRS\"]
view-angles-deg = [0.0]

[property.friction]
name = \"coefficient of sliding friction\"
unit = \"1\"
range = [0.0, 2.0]
description = \"On dry steel\"

[property.hardness]
unit = \"Shore A\"
";

fn own(manifest: &str, table: &str) -> Made {
    let made = Made::long(table);
    made.write("dataset.toml", manifest);
    made
}

const TABLE: &str = "surface,location,repeat,fRS,hardness,friction\n\
    a,0,0,12,-3.5,0.25\nb,0,0,150,,2.0\nc,0,0,,80,0\n";

#[test]
fn a_dataset_names_its_own_properties() {
    let dataset = own(OWN, TABLE).open().unwrap();
    let friction = dataset.describe(&property("friction"));
    assert_eq!(friction.name, "coefficient of sliding friction");
    assert_eq!(friction.unit, "1");
    assert_eq!(friction.description, "On dry steel");
    assert_eq!(friction.range.unwrap().ends(), [0.0, 2.0]);
    let hardness = dataset.describe(&property("hardness"));
    assert_eq!([hardness.name, hardness.unit], ["", "Shore A"]);
    // The project knows what the Toccare's codes mean.
    let known = dataset.describe(&property("fRS"));
    assert_eq!(known.name, "sliding resistance");
    let averages = dataset.tactile().averages(&TactileSettings::default(), 3);
    assert_eq!(averages.properties(), ["hardness", "friction", "fRS"]);
    assert_eq!(averages.column("hardness"), [Some(-3.5), None, Some(80.0)]);
    // Only the Toccare's have a nominal range without saying so.
    let outside = dataset.out_of_range().iter();
    let outside = outside.map(|(_, count)| count.below + count.above);
    assert!(outside.eq([0, 0, 1]));
}

#[test]
fn a_reading_outside_of_its_range_is_refused_or_clamped_to_it() {
    let beyond = TABLE.replace("b,0,0,150,,2.0", "b,0,0,150,,2.5");
    let made = own(OWN, &beyond);
    let message = "tactile.csv, line 3: friction of `b` is 2.5, outside 0 to 2, the range that the \
                   dataset declares";
    assert_eq!(made.refusal(), message);
    let clamped = made.open_with(RangePolicy::Clamp).unwrap();
    let readings = &clamped.tactile().readings;
    assert_eq!(readings[1].values, [None, Some(2.0), Some(100.0)]);
    // Without a range there is nothing to clamp to.
    assert_eq!(readings[0].values[0], Some(-3.5));
}

#[test]
fn what_is_said_of_properties_is_said_once_and_of_those_listed() {
    for (more, parts) in [
        (
            "[property.frition]\nunit = \"1\"\n",
            &["`frition` (did you mean `friction`?)"][..],
        ),
        (
            "[ranges]\nfriction = [0.0, 1.0]\n",
            &["the range of `friction`"],
        ),
        (
            "[property.fRS]\nname = \"a\\u001bb\"\n",
            &["`property.fRS`", "one line"],
        ),
        ("[property.fRS]\nunits = \"1\"\n", &["did you mean `unit`?"]),
    ] {
        let message = own(&format!("{OWN}{more}"), TABLE).refusal();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
}

#[test]
fn a_column_that_is_missing_is_named_with_the_one_that_is_near() {
    let refusal = own(OWN, &TABLE.replace("friction", "frictoin")).refusal();
    assert!(refusal.contains("one for `friction`"), "{refusal}");
    assert!(refusal.contains("is it `frictoin`?"), "{refusal}");
}

#[test]
fn columns_that_cannot_be_codes_are_refused_by_name_or_ignored() {
    for name in "surface roughness,Härte,硬度,../etc/passwd,a/b,repeat".split(',') {
        let table = TABLE.replace("hardness", name);
        let refusal = own(OWN, &table).refusal();
        assert!(refusal.starts_with("tactile.csv"), "{refusal}");
        assert!(refusal.contains(name), "{refusal}");
        let listed = OWN.replace("\"hardness\"", &format!("\"{name}\""));
        let refusal = own(&listed, TABLE).refusal();
        assert!(refusal.starts_with("dataset.toml, line 2"), "{refusal}");
        assert!(refusal.contains(name), "{refusal}");
    }
    // Named like keys of configs and tables of Rust, Python and JSON.
    for name in "properties mean std true null NaN __init__ 0 material".split(' ') {
        let manifest = OWN.replace("hardness", name);
        let made = own(&manifest, &TABLE.replace("hardness", name));
        let dataset = made.open().unwrap();
        let averages = dataset.tactile().averages(&TactileSettings::default(), 3);
        assert_eq!(averages.value(2, name), Some(80.0));
    }
}

#[test]
fn three_hundred_properties_with_half_of_their_cells_empty_are_read() {
    let codes: Vec<String> = (0..300).map(|i| format!("p-{i}")).collect();
    let manifest = format!("name = \"made\"\nproperties = {codes:?}\nview-angles-deg = [0.0]\n");
    let mut table = format!("surface,location,repeat,{}\n", codes.join(","));
    for (s, surface) in SURFACES.lines().skip(1).enumerate() {
        let id = surface.split(',').next().unwrap();
        let cells = (0..300).map(|i| match (i + s) % 2 {
            0 => (i * 10 + s).to_string(),
            _ => String::new(),
        });
        let cells: Vec<String> = cells.collect();
        writeln!(table, "{id},0,0,{}", cells.join(",")).unwrap();
    }
    let dataset = own(&manifest, &table).open().unwrap();
    let inspection = dataset.inspect(&TactileSettings::default());
    assert_eq!(inspection.properties.len(), 300);
    for (i, summary) in inspection.properties.iter().enumerate() {
        // Surfaces 0 and 2 for even columns, surface 1 for odd ones.
        assert_eq!(summary.measured, if i % 2 == 0 { 2 } else { 1 });
        let low = summary.quantiles.unwrap()[0];
        assert_eq!(low, (i * 10 + i % 2) as f64);
    }
}
