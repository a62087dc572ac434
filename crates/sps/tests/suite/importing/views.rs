//! Several photographs of one surface.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use super::Photographs;
use crate::support::{Ends, cases, expect, root};

/// Two surfaces, each in a folder of its own, and a photograph that is of neither.
const FOLDERS: [(&str, &str); 5] = [
    ("oak-02/000.png", "first/0.png"),
    ("oak-02/001.png", "first/1.png"),
    ("denim-01/000.png", "second/0.png"),
    ("denim-01/001.png", "second/1.png"),
    ("denim-01/002.png", "spare.png"),
];

#[test]
fn rows_for_each_photograph() {
    let table = "surface,view,photograph,material,fRS,cDF\n\
        s1,10,first/1.png,,20,\n\
        s2,10,second/1.png,denim,,3\n\
        s2,9,second/0.png,denim,4,3\n\
        s1,9,first/0.png,oak,20,\n";
    let photographs = Photographs::new(&FOLDERS, table);
    let said = "2 surfaces; 1 photographs (spare.png); fRS, cDF";
    expect(&photographs.import("").said(), said);
    let tactile = "surface,location,repeat,fRS,cDF; s1,0,0,20,; s2,0,0,4,3";
    photographs.ensure_tables("surface,material,group; s1,oak,s1; s2,denim,s2", tactile);
    // As numbers, 9 is before 10.
    assert!(photographs.has("s1/000.png", "oak-02/000.png"));
    assert!(photographs.has("s1/001.png", "oak-02/001.png"));
    assert!(photographs.has("s2/000.png", "denim-01/000.png"));
    let manifest = photographs.text("dataset.toml");
    let order = "# - views are in the order 9, 10; nominal; [0.0, 45.0]";
    expect(&manifest, order);
}

/// As [`super::REFUSED`].
const NO_SURFACES: &str = r"
surface,view,photograph,fRS\ns1,0,first/0.png,1\ns1,1,first/1.png,2\n | line 2; line 3; `fRS`; `1`; `2`
surface,view,photograph,fRS\ns1,0,first/0.png,1\ns1,1,first/1.png,\ns2,1,second/1.png,2\n | line 4; surface `s2` has no photograph of view `0`
surface,view,photograph,fRS\ns1,0,first/0.png,1\ns1,0,first/1.png,1\n | line 3; surface `s1`; line 2 already
surface,photograph,fRS\ns1,first/0.png,1\ns1,first/1.png,1\n | line 3; a column `view`
surface,view,photograph,fRS\ns1,0,first/0.png,1\ns1,,first/1.png,1\n | line 3; `view` is empty
surface,photograph,fRS\ns1,first/0.png,1\ns2,second/../first/0.png,1\n | line 3; a photograph of surface `s1` already
surface,view,photograph,fRS\ns1,v9,first/0.png,1\ns1,v10,first/1.png,1\n | views; `v10`; `v9`; equally many digits
surface,fRS\nthird,1\n | line 2; `third`
surface,fRS\nfirst,1\nfirst,2\n | would both be surface `first`
";

#[test]
fn rows_that_are_no_surfaces() {
    for (table, parts) in cases(NO_SURFACES) {
        Photographs::new(&FOLDERS, &table).is_refused("", parts);
    }
}

#[test]
fn a_folder_for_each_surface() {
    let table = "surface,group,fRS\nsecond,roll 7,4\nfirst,,20\n";
    let photographs = Photographs::new(&FOLDERS, table);
    photographs.is_refused("--angles 0,30,60", "found 3 angles; each of 2 photographs");
    let mut two = photographs.import("--angles -30,12.5");
    two.assert().success();
    let surfaces = "surface,material,group\nsecond,unknown,roll 7\nfirst,unknown,first\n";
    assert_eq!(photographs.text("surfaces.csv"), surfaces);
    let manifest = photographs.text("dataset.toml");
    expect(&manifest, "[-30.0, 12.5]; in the order of their names");
    assert!(!manifest.contains("nominal"));
    assert!(photographs.has("second/001.png", "denim-01/001.png"));

    let uneven = Photographs::new(&FOLDERS[..3], table);
    uneven.is_refused("", "surface `first` is 2; `second` is 1");
    let unclear = ["first/10.png", "first/9.png"].map(|name| ("oak-02/000.png", name));
    let unclear = Photographs::new(&unclear, "surface,fRS\nfirst,1\n");
    unclear.is_refused("", "line 2; `10.png`; `9.png`; equally many digits");
}

/// The folders of the views, and what a dataset calls their frames.
const VIEWS: [(&str, &str); 2] = [("non-specular", "000.jpg"), ("specular", "001.jpg")];

/// How it is imported.
const OPTIONS: &str = "--views non-specular,specular --columns @order.txt --materials-from-names";

/// The layout in which the material ratings are published: a folder for each view, ratings in the order
/// of names, and the names of columns in a file of their own.
fn published(names: &[&str], ratings: &str, order: &str) -> Photographs {
    let photographs = Photographs::new(&[], ratings);
    photographs.0.write("order.txt", order);
    let frames = Path::new("fixtures/tiny-dataset/frames");
    for (name, surface) in names.iter().zip(["oak-01", "denim-02", "oak-01"]) {
        for (view, of) in VIEWS {
            let from = frames.join(surface).join(of);
            photographs.add(&from, &format!("{view}/{name}"));
        }
    }
    photographs
}

#[test]
fn a_folder_for_each_view() {
    let names = ["001_baked_clay01.jpg", "002_beads.jpg", "003_fabric012.jpg"];
    let ratings = "-0.32 0.5 \n-0.5 1 \n1e-1 2 \n";
    let photographs = published(&names, ratings, "fRS\ncDF\n");
    photographs.import(OPTIONS).assert().success();
    photographs.ensure_tables(
        "surface,material,group; 001-baked-clay,baked-clay,001-baked-clay; 002-beads,beads,002-beads; \
         003-fabric,fabric,003-fabric",
        "surface,location,repeat,fRS,cDF; 001-baked-clay,0,0,-0.32,0.5; 002-beads,0,0,-0.5,1; \
         003-fabric,0,0,1e-1,2",
    );
    assert!(photographs.has("002-beads/000.jpg", "denim-02/000.jpg"));
    assert!(photographs.has("002-beads/001.jpg", "denim-02/001.jpg"));

    let refused = |names: &[&str], ratings: &str, parts: &str| {
        published(names, ratings, "fRS\ncDF\n").is_refused(OPTIONS, parts);
    };
    refused(&names, "1 2\n3 4\n", "2 rows for 3 photographs");
    refused(&names, "1 2\n3 4\n5\n", "line 3; found 1 cells, expected 2");
    let numbers = ["1.jpg", "2.jpg", "3.jpg"];
    refused(&numbers, ratings, "line 1; `1` names no material");
    let uneven = ["1_a.jpg", "2_a.jpg", "10_a.jpg"];
    refused(&uneven, ratings, "`10_a.jpg`; `1_a.jpg`");

    let photographs = published(&names, ratings, "fRS\ncDF\n");
    fs::remove_file(photographs.0.path("photographs/specular/002_beads.jpg")).unwrap();
    photographs.is_refused(OPTIONS, "line 2; specular/002_beads.jpg");
}

/// The 260 materials at hand, laid out as they are published, are the same dataset again.
#[test]
fn material_ratings_taken_apart() {
    let dataset = root().join("../shared/data/material-ratings");
    if !dataset.exists() {
        println!("left out: there is no {}", dataset.display());
        return;
    }
    let tactile = fs::read_to_string(dataset.join("tactile.csv")).unwrap();
    let mut lines = tactile.lines();
    let header = lines.next().unwrap().split(',').skip(3);
    let order: String = header.map(|code| code.replace('-', " ") + "\n").collect();
    let mut ratings = String::new();
    let photographs = published(&[], "", &order);
    for line in lines {
        let mut cells = line.split(',');
        let surface = cells.next().unwrap();
        for (view, of) in VIEWS {
            let name = format!("{view}/{}01.jpg", surface.replace('-', "_"));
            let from = dataset.join("frames").join(surface).join(of);
            photographs.add(&from, &name);
        }
        let row: Vec<&str> = cells.skip(2).collect();
        writeln!(ratings, "{} ", row.join(" ")).unwrap();
    }
    photographs.0.write("values.csv", ratings);
    photographs.import(OPTIONS).assert().success();
    for name in ["surfaces.csv", "tactile.csv"] {
        let expected = fs::read_to_string(dataset.join(name)).unwrap();
        assert!(photographs.text(name) == expected, "{name}");
    }
    // Read in full, and with the same frames.
    photographs.ensure_are(&dataset);
}
