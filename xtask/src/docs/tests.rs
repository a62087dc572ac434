use std::fs;

use serde_json::{Value, json};

use super::fixture::file;
use super::*;

/// A value with some of its keys set.
fn with(mut value: Value, keys: Value) -> Value {
    let Value::Object(keys) = keys else {
        panic!("{keys} has no keys");
    };
    value.as_object_mut().unwrap().extend(keys);
    value
}

/// A method with what tables need.
fn method(id: &str, label: &str, r2: f64) -> Value {
    let keys = json!({
        "id": id, "label": label, "held_out_surfaces": 2000,
        "r2": {"fRS": r2 + 0.1, "mTX": r2 - 0.1}, "r2_std": {"fRS": 0.01, "mTX": 0.01},
        "mae": {"fRS": 4.0, "mTX": 5.0}, "median_percent_error": {"fRS": 20.0, "mTX": null},
        "r2_interval": {}, "zero_truths": {"fRS": 0, "mTX": 3}, "r2_mean": r2,
        "r2_mean_interval": [r2 - 0.012_345_678_912, r2 + 0.01], "mae_mean": 4.5,
        "median_percent_error_mean": 20.0, "predict_seconds_per_surface": 0.003_25,
    });
    with(file()["methods"][0].clone(), keys)
}

fn results() -> Value {
    let gains = json!({"ridge": {"value": 0.05, "interval": [0.0401, 0.0604], "p": 0.001}});
    let network = method("full", "Whole | network", 0.622);
    let network = with(network, json!({"r2_mean_gains": gains}));
    let dataset = json!({
        "name": "simulated", "surfaces": 2360, "views": 1, "encoder": "small",
        "ceiling_one_view": {"fRS": 0.9, "mTX": 0.8},
    });
    let keys = json!({
        "experiment": "ablation", "dataset": with(file()["dataset"].clone(), dataset),
        "properties": ["fRS", "mTX"], "against": ["ridge"],
        "methods": [method("ridge", "Ridge", 0.575), network],
    });
    with(file(), keys)
}

/// A repository with a finished run and a page.
struct Repository(tempfile::TempDir);

impl Repository {
    fn with(page: &str) -> Self {
        let repository = Self(tempfile::tempdir().unwrap());
        for folder in ["docs/deep", "docs/images", "runs/ablation/figures"] {
            fs::create_dir_all(repository.path(folder)).unwrap();
        }
        fs::write(repository.path("README.md"), "Nothing measured.\n").unwrap();
        repository.edit(page);
        let run = repository.path("runs/ablation");
        fs::write(run.join("results.json"), results().to_string()).unwrap();
        sps_experiment::checksums::seal(&run, &["results.json".to_owned()]).unwrap();
        repository
    }

    fn path(&self, path: &str) -> PathBuf {
        self.0.path().join(path)
    }

    fn edit(&self, page: &str) {
        fs::write(self.path("docs/deep/page.md"), page).unwrap();
    }

    fn page(&self) -> String {
        fs::read_to_string(self.path("docs/deep/page.md")).unwrap()
    }

    /// Keeps the run and writes the page.
    fn written(page: &str) -> Self {
        let repository = Self::with(page);
        let kept = keep(repository.0.path(), &repository.path("runs/ablation")).unwrap();
        assert_eq!(kept, [repository.path("docs/measured/ablation.json")]);
        write(repository.0.path()).unwrap();
        repository
    }

    fn problems(&self) -> String {
        check(self.0.path()).unwrap_err().to_string()
    }
}

const GAINS: &str = "\
# Page
<!-- measured: ablation gains -->
<!-- /measured -->
In all <!-- value: ablation full r2_mean decimals=2 --><!-- /value -->.
";

const WRITTEN: &str = "\
# Page
<!-- measured: ablation gains -->
| Method | R² | over Ridge |
|---|---:|---:|
| Ridge | 0.575 |  |
| Whole \\| network | 0.622 | +0.050 [0.040, 0.060] ▲ |
<!-- /measured -->
In all <!-- value: ablation full r2_mean decimals=2 -->0.62<!-- /value -->.
";

#[test]
fn pages_are_written_once_and_stay() {
    let repository = Repository::written(GAINS);
    assert_eq!(repository.page(), WRITTEN);
    check(repository.0.path()).unwrap();
    assert_eq!(write(repository.0.path()).unwrap(), [] as [PathBuf; 0]);
    assert_eq!(repository.page(), WRITTEN);
    // What is kept serves without the run.
    fs::remove_dir_all(repository.path("runs")).unwrap();
    repository.edit(GAINS);
    assert_eq!(write(repository.0.path()).unwrap().len(), 1);
    assert_eq!(repository.page(), WRITTEN);
}

#[test]
fn what_was_edited_is_found_with_its_line() {
    for (from, to, line) in [("0.575", "0.675", 2), ("0.62<", "0.63<", 8)] {
        let repository = Repository::written(GAINS);
        repository.edit(&WRITTEN.replace(from, to));
        let problems = repository.problems();
        let line = format!("page.md:{line}: ");
        assert!(problems.contains(&line), "{problems}");
        assert_eq!(problems.lines().count(), 1, "{problems}");
        write(repository.0.path()).unwrap();
        assert_eq!(repository.page(), WRITTEN);
    }
}

#[test]
fn what_cannot_be_written_is_named_and_left() {
    let refused = |page: &str, expected: &str| {
        let repository = Repository::with(page);
        keep(repository.0.path(), &repository.path("runs/ablation")).unwrap();
        let problems = repository.problems();
        assert!(problems.contains(expected), "{expected}: {problems}");
        assert!(write(repository.0.path()).is_err(), "{page}");
    };
    let table = |words: &str, expected: &str| {
        let marker = format!("\n<!-- measured: {words} -->\n<!-- /measured -->\n");
        refused(&marker, expected);
    };
    table("other means", "2: docs/measured/other.json");
    table("ablation meens", "2: no table");
    table("ablation error", "2: more than one table");
    table("ablation means rows=fool", "no method `fool`");
    table("ablation means columns=x", "no column `x`");
    table("ablation means row=full", "`row`");
    let value = |key: &str| format!("<!-- value: ablation full {key} -->1<!-- /value -->\n");
    refused(&value("r3"), "1: `r3` of `full`");
    refused(&value("best8"), "`best8`");
    let open = "<!-- measured: ablation means -->\n";
    refused(&format!("a\n\n{open}"), "3: `ablation means` has no");
    refused("a\n<!-- /value -->\n", "2: `/value` closes nothing");
    let unclosed = open.to_owned() + &value("r2_mean");
    refused(&unclosed, "1: `ablation means` has no");
}

#[test]
fn figures_that_a_page_shows_are_kept() {
    let repository = Repository::with("![R²](../images/ablation-r2.svg)\n");
    for figure in ["r2", "search"] {
        let path = repository.path(&format!("runs/ablation/figures/{figure}.svg"));
        fs::write(path, format!("<svg>{figure}</svg>")).unwrap();
    }
    let kept = keep(repository.0.path(), &repository.path("runs/ablation")).unwrap();
    let image = repository.path("docs/images/ablation-r2.svg");
    assert_eq!((kept.len(), kept.last()), (2, Some(&image)));
    assert_eq!(fs::read_to_string(image).unwrap(), "<svg>r2</svg>");
}

#[test]
fn tables_of_the_report_can_be_cut_to_rows_and_columns() {
    let page = "<!-- measured: ablation r2 rows=full columns=mean,frs -->\n<!-- /measured -->\n";
    let page = Repository::written(page).page();
    let table = "-->
| Method | mean | fRS |
|---|---:|---:|
| Whole \\| network | 0.62 | 0.72 |
<!--";
    assert!(page.contains(table), "{page}");
}

#[test]
fn values_are_shown_as_what_they_are() {
    for (asked, expected) in [
        ("full r2_mean", "0.622"),
        ("full r2_mean_interval decimals=2", "[0.61, 0.63]"),
        ("full r2_mean_gains/ridge decimals=2", "+0.05 [0.04, 0.06]"),
        ("full r2/fRS decimals=1", "0.7"),
        (
            "ridge predict_seconds_per_surface times=1000 decimals=2",
            "3.25",
        ),
        ("ridge held_out_surfaces", "2000"),
        ("- dataset/encoder", "small"),
        ("- interval_level times=100 decimals=0", "95"),
    ] {
        let page = format!("<!-- value: ablation {asked} --><!-- /value -->");
        let written = Repository::written(&page).page();
        assert!(written.contains(&format!("-->{expected}<!--")), "{written}");
    }
}

#[test]
fn code_that_shows_markers_is_left_alone() {
    let page = "```\n<!-- measured: other means -->\n```\nand `<!-- value: x y z -->`\n";
    let repository = Repository::written(page);
    check(repository.0.path()).unwrap();
    assert_eq!(repository.page(), page);
}

#[test]
fn what_is_kept_is_rounded_and_has_a_line_for_each_method() {
    let repository = Repository::written("");
    let kept = fs::read_to_string(repository.path("docs/measured/ablation.json")).unwrap();
    let mut lines = kept.lines();
    let line = lines.find(|line| line.contains("\"ridge\",")).unwrap();
    let kept: Value = serde_json::from_str(line.trim_end_matches(',')).unwrap();
    // 0.575 - 0.012345678912 to eight digits.
    assert_eq!(kept["r2_mean_interval"][0], json!(0.562_654_32));
    assert_eq!(kept["selected_views"], json!({}));
}
