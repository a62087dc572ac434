//! The ranges in `docs/simulator/ranges.csv` are those of the code.

use std::fmt::Write as _;

use sps_simulate::{Material, Profile, Range};

const HEADER: &str = "material,kind,weight,pitch mm,relief mm,order,micro um,micro length mm,alpha,sheen,f0,coated,printed,modulus kPa,loss,relaxation,creep,thickness mm,effusivity,adhesion,tack\n";

fn shown(range: Range) -> String {
    let number = |v: f64| {
        if v >= 1e4 {
            format!("{v:.1e}")
        } else {
            format!("{v}")
        }
    };
    format!("{}-{}", number(range.lo), number(range.hi))
}

fn row(material: Material, weight: f64, p: &Profile) -> String {
    let ranges = |list: &[Range]| list.iter().map(|&r| shown(r)).collect::<Vec<_>>().join(",");
    let kind = serde_json::to_value(p.structure).unwrap();
    let kind = match &kind {
        serde_json::Value::String(name) => name.clone(),
        other => other["woven"]
            .as_str()
            .map(|weave| format!("woven {weave}"))
            .unwrap(),
    };
    format!(
        "{},{kind},{weight},{},{},{},{},{}\n",
        material.label(),
        ranges(&[
            p.period_mm,
            p.relief_mm,
            p.regularity,
            p.micro_um,
            p.micro_length_mm,
            p.alpha,
            p.sheen
        ]),
        p.f0,
        p.coated,
        p.printed,
        ranges(&[
            p.modulus_kpa,
            p.loss,
            p.relaxation,
            p.creep,
            p.thickness_mm,
            p.effusivity,
            p.adhesion,
            p.tack
        ]),
    )
}

#[test]
fn the_printed_ranges_are_those_of_the_code() {
    let mut table = HEADER.to_owned();
    for &material in Material::ALL {
        for (weight, profile) in material.variants() {
            write!(table, "{}", row(material, *weight, profile)).unwrap();
        }
    }
    let printed = include_str!("../../../docs/simulator/ranges.csv");
    if printed != table {
        println!("{table}");
        panic!("the ranges changed: put the lines above into docs/simulator/ranges.csv");
    }
}
