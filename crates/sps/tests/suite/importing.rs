//! Photographs and tables laid out as datasets.

mod hostile;
mod views;

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use crate::support::{Ends, Scratch, cases, expect, root, tree};
use assert_cmd::Command;
use serde_json::{Value, json};

/// The folder `photographs`, and a table beside it.
struct Photographs(Scratch);

impl Photographs {
    /// Copies of files of the tiny dataset by new names.
    fn new(files: &[(&str, &str)], table: &str) -> Self {
        let photographs = Self(Scratch::empty());
        photographs.0.write("values.csv", table);
        for (from, to) in files {
            photographs.add(&Path::new("fixtures/tiny-dataset/frames").join(from), to);
        }
        photographs
    }

    /// Copies a file of the repository there.
    fn add(&self, from: &Path, to: &str) {
        let to = self.0.path(&format!("photographs/{to}"));
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(root().join(from), to).unwrap();
    }

    fn dataset(&self) -> PathBuf {
        self.0.path("dataset")
    }

    /// `import` with options beside those that it must have.
    fn import(&self, options: &str) -> Command {
        let line = "import @photographs --values @values.csv --out @dataset";
        self.0.sps(&format!("{line} {options}"))
    }

    /// Refused with every part, and nothing is written.
    fn is_refused(&self, options: &str, parts: &str) {
        let before = tree(&self.0.path("."));
        self.import(options).refused(parts);
        assert!(tree(&self.0.path(".")) == before, "{parts}");
    }

    /// `surfaces.csv` and `tactile.csv` of the dataset have these lines, with `; ` between them.
    fn ensure_tables(&self, surfaces: &str, tactile: &str) {
        for (name, lines) in [("surfaces.csv", surfaces), ("tactile.csv", tactile)] {
            let lines = lines.replace("; ", "\n");
            assert_eq!(self.text(name), format!("{lines}\n"), "{name}");
        }
    }

    /// A file of the dataset.
    fn text(&self, name: &str) -> String {
        self.0.read(&format!("dataset/{name}"))
    }

    /// Whether a frame of the dataset has the same bytes as one of the tiny dataset.
    fn has(&self, frame: &str, of: &str) -> bool {
        let of = root().join("fixtures/tiny-dataset/frames").join(of);
        self.0.bytes(&format!("dataset/frames/{frame}")) == fs::read(of).unwrap()
    }

    /// What `inspect` says of a dataset.
    fn inspected(&self, dataset: &Path) -> Value {
        let mut command = self.0.sps("inspect --json --out @figures");
        command.arg(dataset).json()
    }

    /// Nothing but the name of their dataset is another than that of `dataset`.
    fn ensure_are(&self, dataset: &Path) {
        let [found, expected] = [&*self.dataset(), dataset].map(|dataset| {
            let mut inspected = self.inspected(dataset);
            inspected["name"].take();
            inspected
        });
        assert_eq!(found, expected);
    }
}

/// What is hidden, or no photograph, is not looked at where a folder is a class.
const FILES: [(&str, &str); 5] = [
    ("denim-01/002.png", "denim/._b.png"),
    ("denim-01/002.png", "denim/b.png.part"),
    ("denim-01/002.png", "denim/b.png"),
    ("oak-01/002.jpg", "oak/1.JPG"),
    ("denim-02/002.jpg", "denim/a.jpg"),
];

#[test]
fn folders_by_class() {
    let photographs = Photographs::new(&FILES, "class, fRS, cDF\ndenim, 41.5,\noak, 20, 3.25\n");
    photographs.import("").assert().success();
    photographs.ensure_tables(
        "surface,material,group; denim-a,denim,denim; denim-b,denim,denim; oak-1,oak,oak",
        "surface,location,repeat,fRS,cDF; denim-a,0,0,41.5,; denim-b,0,0,41.5,; oak-1,0,0,20,3.25",
    );
    let manifest = photographs.text("dataset.toml");
    expect(&manifest, "# - photographs of one folder have one value");
    assert!(photographs.has("oak-1/000.jpg", "oak-01/002.jpg"));
    let found = photographs.inspected(&photographs.dataset());
    assert_eq!(found["surfaces"], 3);
    assert_eq!(found["groups"], 2);

    photographs.import("").refused("dataset; is there already");
}

#[test]
fn photographs_of_a_table() {
    let table = "photograph,group,material,tCO\ndenim/b.png,bolt 7,denim,1e1\noak/1.JPG,,,\n";
    let photographs = Photographs::new(&FILES, table);
    let [said, log] = photographs.import("--json").ended(0);
    expect(&log, "2 surfaces in 2 groups; Left out; `inspect ");
    let said: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(said["dataset"], *photographs.dataset().to_string_lossy());
    let counts = ["surfaces", "groups", "views"].map(|key| &said[key]);
    assert_eq!(counts, [2, 2, 1]);
    assert_eq!(said["properties"], json!(["tCO"]));
    assert_eq!(said["left_out"], json!(["denim/a.jpg"]));
    let assumed = said["assumed"].as_array().unwrap();
    assert!(assumed.contains(&json!("a surface without a material is of `unknown`")));
    let surfaces = "surface,material,group\ndenim-b,denim,bolt 7\noak-1,unknown,oak-1\n";
    assert_eq!(photographs.text("surfaces.csv"), surfaces);
    let found = photographs.inspected(&photographs.dataset());
    assert_eq!(found["properties"][0]["quantiles"][2], 10.0);
    let manifest = photographs.text("dataset.toml");
    let assumed = "without a material; without a group; straight down";
    expect(&manifest, assumed);
}

/// A folder of a class, too, may be without a row.
#[test]
fn photographs_without_a_row_are_counted_and_named() {
    let names = "a.png b.png c.png oak/d.png oak/.e.png denim/f.png".split(' ');
    let files: Vec<_> = names.map(|name| ("denim-01/002.png", name)).collect();
    let photographs = Photographs::new(&files, "class,fRS\ndenim,1\n");
    let left_out = "no row is of them: 4 photographs (a.png, b.png, c.png, ...)";
    expect(&photographs.import("").said(), left_out);
    assert!(!photographs.dataset().join("frames/oak-d").exists());
}

/// A line for each: a table, and what the message has.
const REFUSED: &str = r"
name,fRS\n | values.csv; `name`; `class` or `photograph`
class,fRS\n | values.csv; no row
class\ndenim\n | values.csv; no column is a property; fRS
class,friction (N)\ndenim,1\n | values.csv; `friction (N)`; `friction-N`
class,fRS,fRS\ndenim,1,1\n | two columns `fRS`
class,fRS\ndenim,1\noak,soft\n | line 3; `soft`; a number
class,fRS\ndenim,inf\noak,1\n | line 2; `inf`
class,fRS\ndenim,1\noak,1\nslate,2\n | line 4; `slate`
class,fRS\ndenim,1\noak,1\ndenim,2\n | would both be surface `denim-a`
photograph,fRS\ndenim/c.png,1\n | line 2; denim/c.png
photograph,fRS\n../values.csv,1\n | line 2; ends in png
photograph,location\ndenim/b.png,1\n | `location`; a meaning of its own
photograph,Repeat\ndenim/b.png,1\n | `Repeat`; rename it
photograph,Surface\ndenim/b.png,1\n | `Surface`; `surface`
photograph,Group\ndenim/b.png,1\n | `Group`; `group`
photograph,view\ndenim/b.png,1\n | `photograph`, `view`; these two with `view`
class,photograph\ndenim/b.png,1\n | `class`, `photograph`
surface,view\ndenim/b.png,1\n | `surface`, `view`
photograph,a/b\ndenim/b.png,1\n | `a/b`; `a-b`
photograph,color vibrancy\ndenim/b.png,1\n | `color vibrancy`; `color-vibrancy`
photograph,../x\ndenim/b.png,1\n | `../x`
photograph,Härte\ndenim/b.png,1\n | `Härte`
photograph,硬度\ndenim/b.png,1\n | `硬度`
photograph,\ndenim/b.png,1\n | values.csv
";

#[test]
fn what_cannot_be_meant_is_refused_and_leaves_nothing() {
    for (table, parts) in cases(REFUSED) {
        Photographs::new(&FILES, &table).is_refused("", parts);
    }
    let hidden = [("oak-01/002.jpg", ".a.jpg")];
    let photographs = Photographs::new(&hidden, "photograph,fRS\n.a.jpg,1\n");
    photographs.is_refused("", "line 2; `.a`; begin with a dot");
}

/// The friction photographs, taken apart into a folder for each material, are the same dataset again.
#[test]
fn friction_photographs_taken_apart() {
    let dataset = root().join("../shared/data/friction-photos");
    if !dataset.exists() {
        println!("left out: there is no {}", dataset.display());
        return;
    }
    let tactile = fs::read_to_string(dataset.join("tactile.csv")).unwrap();
    let mut table = "photograph,material,group,fRS\n".to_owned();
    let photographs = Photographs::new(&[], "");
    for line in tactile.lines().skip(1) {
        let (surface, rest) = line.split_once(',').unwrap();
        let (_, value) = rest.rsplit_once(',').unwrap();
        let (material, number) = surface.rsplit_once('-').unwrap();
        let photograph = format!("{material}/{number}.jpg");
        let from = dataset.join("frames").join(surface).join("000.jpg");
        photographs.add(&from, &photograph);
        writeln!(table, "{photograph},{material},{material},{value}").unwrap();
    }
    photographs.0.write("values.csv", table);
    photographs.import("").assert().success();
    photographs.ensure_are(&dataset);
}
