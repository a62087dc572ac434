//! Photographs and tables laid out as datasets.

#[path = "importing/hostile.rs"]
mod hostile;
mod support;
#[path = "importing/views.rs"]
mod views;

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use support::{expect, json, message, root, sps};
use tempfile::TempDir;

/// A folder of photographs, and a table beside it.
struct Photographs {
    folder: TempDir,
}

impl Photographs {
    /// Copies of files of the tiny dataset by new names.
    fn new(files: &[(&str, &str)], table: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (from, to) in files {
            let to = folder.path().join("photographs").join(to);
            fs::create_dir_all(to.parent().unwrap()).unwrap();
            let from = root().join("fixtures/tiny-dataset/frames").join(from);
            fs::copy(from, to).unwrap();
        }
        fs::write(folder.path().join("values.csv"), table).unwrap();
        Self { folder }
    }

    fn dataset(&self) -> PathBuf {
        self.folder.path().join("dataset")
    }

    fn import(&self) -> assert_cmd::assert::Assert {
        self.import_with(&[])
    }

    /// `import` with options beside those that it must have.
    fn import_with(&self, options: &[&str]) -> assert_cmd::assert::Assert {
        let mut command = sps();
        command
            .arg("import")
            .arg(self.folder.path().join("photographs"));
        command
            .arg("--values")
            .arg(self.folder.path().join("values.csv"));
        command.arg("--out").arg(self.dataset());
        command.args(options).assert()
    }

    /// A file of the dataset.
    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.dataset().join(name)).unwrap()
    }

    /// What `inspect` says of a dataset.
    fn inspected(&self, dataset: &Path) -> Value {
        let mut command = sps();
        command.arg("inspect").arg(dataset).arg("--json");
        command.arg("--out").arg(self.folder.path().join("figures"));
        json(command.assert())
    }

    /// Nothing but the name of their dataset is another than that of `dataset`.
    fn ensure_are(&self, dataset: &Path) {
        let [mut found, mut expected] =
            [&*self.dataset(), dataset].map(|dataset| self.inspected(dataset));
        for inspection in [&mut found, &mut expected] {
            inspection["name"].take();
        }
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
    photographs.import().success();
    assert_eq!(
        photographs.text("surfaces.csv"),
        "surface,material,group\ndenim-a,denim,denim\ndenim-b,denim,denim\noak-1,oak,oak\n"
    );
    assert_eq!(
        photographs.text("tactile.csv"),
        "surface,location,repeat,fRS,cDF\ndenim-a,0,0,41.5,\ndenim-b,0,0,41.5,\noak-1,0,0,20,3.25\n"
    );
    assert!(
        photographs
            .text("dataset.toml")
            .contains("# - photographs of one folder have one value")
    );
    let copied = fs::read(photographs.dataset().join("frames/oak-1/000.jpg")).unwrap();
    let own = root().join("fixtures/tiny-dataset/frames/oak-01/002.jpg");
    assert!(copied == fs::read(own).unwrap());
    let found = photographs.inspected(&photographs.dataset());
    assert_eq!(found["surfaces"], 3);
    assert_eq!(found["groups"], 2);

    let again = message(photographs.import());
    expect(&again, &["dataset", "is there already"]);
}

#[test]
fn photographs_of_a_table() {
    let table = "photograph,group,material,tCO\ndenim/b.png,bolt 7,denim,1e1\noak/1.JPG,,,\n";
    let photographs = Photographs::new(&FILES, table);
    let said = photographs.import_with(&["--json"]).success();
    let text = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
    expect(&text, &["2 surfaces in 2 groups", "Left out", "`inspect "]);
    let said = json(said);
    assert_eq!(said["dataset"], *photographs.dataset().to_string_lossy());
    assert_eq!(
        [&said["surfaces"], &said["groups"], &said["views"]],
        [2, 2, 1]
    );
    assert_eq!(said["properties"], serde_json::json!(["tCO"]));
    assert_eq!(said["left_out"], serde_json::json!(["denim/a.jpg"]));
    let assumed = said["assumed"].as_array().unwrap();
    assert!(
        assumed
            .iter()
            .any(|line| line == "a surface without a material is of `unknown`")
    );
    assert_eq!(
        photographs.text("surfaces.csv"),
        "surface,material,group\ndenim-b,denim,bolt 7\noak-1,unknown,oak-1\n"
    );
    let found = photographs.inspected(&photographs.dataset());
    assert_eq!(found["properties"][0]["quantiles"][2], 10.0);
    let manifest = photographs.text("dataset.toml");
    for assumed in ["without a material", "without a group", "straight down"] {
        assert!(manifest.contains(assumed), "{manifest}");
    }
}

/// A folder of a class, too, may be without a row.
#[test]
fn photographs_without_a_row_are_counted_and_named() {
    let files = [
        "a.png",
        "b.png",
        "c.png",
        "oak/d.png",
        "oak/.e.png",
        "denim/f.png",
    ];
    let files = files.map(|name| ("denim-01/002.png", name));
    let photographs = Photographs::new(&files, "class,fRS\ndenim,1\n");
    let done = photographs.import().success();
    let said = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    expect(
        &said,
        &["no row is of them: 4 photographs (a.png, b.png, c.png, ...)"],
    );
    assert!(!photographs.dataset().join("frames/oak-d").exists());
}

#[test]
fn what_cannot_be_meant_is_refused_and_leaves_nothing() {
    for (files, table, parts) in [
        (
            &FILES[..],
            "name,fRS\n",
            &["values.csv", "`name`", "`class` or `photograph`"][..],
        ),
        (&FILES, "class,fRS\n", &["values.csv", "no row"]),
        (
            &FILES,
            "class\ndenim\n",
            &["values.csv", "no column is a property", "fRS"],
        ),
        (
            &FILES,
            "class,friction (N)\ndenim,1\n",
            &["values.csv", "`friction (N)`", "`friction-N`"],
        ),
        (&FILES, "class,fRS,fRS\ndenim,1,1\n", &["two columns `fRS`"]),
        (
            &FILES,
            "class,fRS\ndenim,1\noak,soft\n",
            &["line 3", "`soft`", "a number"],
        ),
        (
            &FILES,
            "class,fRS\ndenim,inf\noak,1\n",
            &["line 2", "`inf`"],
        ),
        (
            &FILES,
            "class,fRS\ndenim,1\noak,1\nslate,2\n",
            &["line 4", "`slate`"],
        ),
        (
            &FILES,
            "class,fRS\ndenim,1\noak,1\ndenim,2\n",
            &["would both be surface `denim-a`"],
        ),
        (
            &FILES,
            "photograph,fRS\ndenim/c.png,1\n",
            &["line 2", "denim/c.png"],
        ),
        (
            &FILES,
            "photograph,fRS\n../values.csv,1\n",
            &["line 2", "ends in png"],
        ),
        (
            &[("oak-01/002.jpg", ".a.jpg")],
            "photograph,fRS\n.a.jpg,1\n",
            &["line 2", "`.a`", "begin with a dot"],
        ),
    ] {
        let photographs = Photographs::new(files, table);
        let refused = message(photographs.import().failure());
        expect(&refused, parts);
        assert!(!photographs.dataset().exists(), "{table}");
    }
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
    let folder = tempfile::tempdir().unwrap();
    let mut table = "photograph,material,group,fRS\n".to_owned();
    for line in tactile.lines().skip(1) {
        let (surface, value) = (
            line.split(',').next().unwrap(),
            line.rsplit(',').next().unwrap(),
        );
        let (material, number) = surface.rsplit_once('-').unwrap();
        let to = folder.path().join("photographs").join(material);
        fs::create_dir_all(&to).unwrap();
        let from = dataset.join("frames").join(surface).join("000.jpg");
        fs::copy(from, to.join(format!("{number}.jpg"))).unwrap();
        writeln!(
            table,
            "{material}/{number}.jpg,{material},{material},{value}"
        )
        .unwrap();
    }
    fs::write(folder.path().join("values.csv"), table).unwrap();
    let photographs = Photographs { folder };
    photographs.import().success();
    photographs.ensure_are(&dataset);
}
