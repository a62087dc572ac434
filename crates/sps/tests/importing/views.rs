//! Several photographs of one surface.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use super::Photographs;
use super::support::{expect, message, root};

/// Two surfaces, each in a folder of its own, and a photograph that is of neither.
const FOLDERS: [(&str, &str); 5] = [
    ("oak-02/000.png", "first/0.png"),
    ("oak-02/001.png", "first/1.png"),
    ("denim-01/000.png", "second/0.png"),
    ("denim-01/001.png", "second/1.png"),
    ("denim-01/002.png", "spare.png"),
];

/// The same bytes as a frame of the tiny dataset.
fn same(photographs: &Photographs, frame: &str, of: &str) -> bool {
    let bytes = |path: &Path| fs::read(path).unwrap();
    bytes(&photographs.dataset().join("frames").join(frame))
        == bytes(&root().join("fixtures/tiny-dataset/frames").join(of))
}

#[test]
fn rows_for_each_photograph() {
    let table = "surface,view,photograph,material,fRS,cDF\n\
        s1,10,first/1.png,,20,\n\
        s2,10,second/1.png,denim,,3\n\
        s2,9,second/0.png,denim,4,3\n\
        s1,9,first/0.png,oak,20,\n";
    let photographs = Photographs::new(&FOLDERS, table);
    let done = photographs.import().success();
    let said = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    expect(
        &said,
        &["2 surfaces", "1 photographs (spare.png)", "fRS, cDF"],
    );
    assert_eq!(
        photographs.text("surfaces.csv"),
        "surface,material,group\ns1,oak,s1\ns2,denim,s2\n"
    );
    assert_eq!(
        photographs.text("tactile.csv"),
        "surface,location,repeat,fRS,cDF\ns1,0,0,20,\ns2,0,0,4,3\n"
    );
    // As numbers, 9 is before 10.
    assert!(same(&photographs, "s1/000.png", "oak-02/000.png"));
    assert!(same(&photographs, "s1/001.png", "oak-02/001.png"));
    assert!(same(&photographs, "s2/000.png", "denim-01/000.png"));
    let manifest = photographs.text("dataset.toml");
    expect(
        &manifest,
        &["# - views are in the order 9, 10", "nominal", "[0.0, 45.0]"],
    );
}

#[test]
fn rows_that_are_no_surfaces() {
    for (table, parts) in [
        (
            "surface,view,photograph,fRS\ns1,0,first/0.png,1\ns1,1,first/1.png,2\n",
            &["line 2", "line 3", "`fRS`", "`1`", "`2`"][..],
        ),
        (
            "surface,view,photograph,fRS\ns1,0,first/0.png,1\ns1,1,first/1.png,\ns2,1,second/1.png,2\n",
            &["line 4", "surface `s2` has no photograph of view `0`"],
        ),
        (
            "surface,view,photograph,fRS\ns1,0,first/0.png,1\ns1,0,first/1.png,1\n",
            &["line 3", "surface `s1`", "line 2 already"],
        ),
        (
            "surface,photograph,fRS\ns1,first/0.png,1\ns1,first/1.png,1\n",
            &["line 3", "a column `view`"],
        ),
        (
            "surface,view,photograph,fRS\ns1,0,first/0.png,1\ns1,,first/1.png,1\n",
            &["line 3", "`view` is empty"],
        ),
        (
            "surface,photograph,fRS\ns1,first/0.png,1\ns2,second/../first/0.png,1\n",
            &["line 3", "a photograph of surface `s1` already"],
        ),
        ("surface,fRS\nthird,1\n", &["line 2", "`third`"]),
        (
            "surface,fRS\nfirst,1\nfirst,2\n",
            &["would both be surface `first`"],
        ),
    ] {
        let photographs = Photographs::new(&FOLDERS, table);
        expect(&message(photographs.import().failure()), parts);
        assert!(!photographs.dataset().exists(), "{table}");
    }
}

#[test]
fn a_folder_for_each_surface() {
    let table = "surface,group,fRS\nsecond,roll 7,4\nfirst,,20\n";
    let photographs = Photographs::new(&FOLDERS, table);
    let refused = message(photographs.import_with(&["--angles", "0,30,60"]).failure());
    expect(&refused, &["found 3 angles", "each of 2 photographs"]);
    photographs.import_with(&["--angles", "-30,12.5"]).success();
    assert_eq!(
        photographs.text("surfaces.csv"),
        "surface,material,group\nsecond,unknown,roll 7\nfirst,unknown,first\n"
    );
    let manifest = photographs.text("dataset.toml");
    expect(&manifest, &["[-30.0, 12.5]", "in the order of their names"]);
    assert!(!manifest.contains("nominal"));
    assert!(same(&photographs, "second/001.png", "denim-01/001.png"));

    let uneven = Photographs::new(&FOLDERS[..3], table);
    expect(
        &message(uneven.import().failure()),
        &["surface `first` is 2", "`second` is 1"],
    );
    let unclear = [
        ("oak-02/000.png", "first/10.png"),
        ("oak-02/001.png", "first/9.png"),
    ];
    let unclear = Photographs::new(&unclear, "surface,fRS\nfirst,1\n");
    expect(
        &message(unclear.import().failure()),
        &["line 2", "`10.png`", "`9.png`", "equally many digits"],
    );
}

/// The layout in which the material ratings are published: a folder for each view, ratings in the order
/// of names, and the names of columns in a file of their own.
struct Published(Photographs);

impl Published {
    fn new(names: &[&str], ratings: &str, order: &str) -> Self {
        let photographs = Photographs::new(&[], ratings);
        fs::write(photographs.folder.path().join("order.txt"), order).unwrap();
        for (view, of) in [("non-specular", "000.jpg"), ("specular", "001.jpg")] {
            let to = photographs.folder.path().join("photographs").join(view);
            fs::create_dir_all(&to).unwrap();
            for (name, surface) in names.iter().zip(["oak-01", "denim-02", "oak-01"]) {
                let from = root()
                    .join("fixtures/tiny-dataset/frames")
                    .join(surface)
                    .join(of);
                fs::copy(from, to.join(name)).unwrap();
            }
        }
        Self(photographs)
    }

    fn import(&self) -> assert_cmd::assert::Assert {
        let order = self.0.folder.path().join("order.txt");
        let order = order.display().to_string();
        let options = ["--views", "non-specular,specular", "--columns", &order];
        self.0
            .import_with(&[&options[..], &["--materials-from-names"]].concat())
    }
}

#[test]
fn a_folder_for_each_view() {
    let names = ["001_baked_clay01.jpg", "002_beads.jpg", "003_fabric012.jpg"];
    let ratings = "-0.32 0.5 \n-0.5 1 \n1e-1 2 \n";
    let published = Published::new(&names, ratings, "fRS\ncDF\n");
    published.import().success();
    let photographs = &published.0;
    assert_eq!(
        photographs.text("surfaces.csv"),
        "surface,material,group\n001-baked-clay,baked-clay,001-baked-clay\n002-beads,beads,002-beads\n\
         003-fabric,fabric,003-fabric\n"
    );
    assert_eq!(
        photographs.text("tactile.csv"),
        "surface,location,repeat,fRS,cDF\n001-baked-clay,0,0,-0.32,0.5\n002-beads,0,0,-0.5,1\n\
         003-fabric,0,0,1e-1,2\n"
    );
    assert!(same(photographs, "002-beads/000.jpg", "denim-02/000.jpg"));
    assert!(same(photographs, "002-beads/001.jpg", "denim-02/001.jpg"));

    for (names, ratings, parts) in [
        (&names[..], "1 2\n3 4\n", &["2 rows for 3 photographs"][..]),
        (
            &names,
            "1 2\n3 4\n5\n",
            &["line 3", "found 1 cells, expected 2"],
        ),
        (
            &["1.jpg", "2.jpg", "3.jpg"],
            ratings,
            &["line 1", "`1` names no material"],
        ),
        (
            &["1_a.jpg", "2_a.jpg", "10_a.jpg"],
            ratings,
            &["`10_a.jpg`", "`1_a.jpg`"],
        ),
    ] {
        let published = Published::new(names, ratings, "fRS\ncDF\n");
        expect(&message(published.import().failure()), parts);
        assert!(!published.0.dataset().exists());
    }
    let published = Published::new(&names, ratings, "fRS\ncDF\n");
    let lacking = published
        .0
        .folder
        .path()
        .join("photographs/specular")
        .join(names[1]);
    fs::remove_file(lacking).unwrap();
    expect(
        &message(published.import().failure()),
        &["line 2", "specular/002_beads.jpg"],
    );
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
    let order = header
        .map(|code| code.replace('-', " ") + "\n")
        .collect::<String>();
    let mut ratings = String::new();
    let published = Published::new(&[], "", &order);
    let folder = published.0.folder.path().join("photographs");
    for line in lines {
        let mut cells = line.split(',');
        let surface = cells.next().unwrap();
        for (view, of) in [("non-specular", "000.jpg"), ("specular", "001.jpg")] {
            let name = surface.replace('-', "_") + "01.jpg";
            let from = dataset.join("frames").join(surface).join(of);
            fs::copy(from, folder.join(view).join(name)).unwrap();
        }
        for cell in cells.skip(2) {
            write!(ratings, "{cell} ").unwrap();
        }
        ratings.push('\n');
    }
    fs::write(published.0.folder.path().join("values.csv"), ratings).unwrap();
    published.import().success();
    for name in ["surfaces.csv", "tactile.csv"] {
        let expected = fs::read_to_string(dataset.join(name)).unwrap();
        assert!(published.0.text(name) == expected, "{name}");
    }
    // Read in full, and with the same frames.
    published.0.ensure_are(&dataset);
}
