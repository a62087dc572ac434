//! Reports of finished runs, what is left in their folders, and how a browser lays pages out.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};

use crate::devtools::Tab;
use crate::support::{Ends, Mounted, Scratch, expect, rows};
use serde_json::Value;

fn report(scratch: &Scratch) -> assert_cmd::Command {
    scratch.sps("report @run")
}

#[test]
fn a_report_waits_for_the_run_in_its_folder() {
    let scratch = Scratch::after_a_run();
    let lock = File::open(scratch.path("run/lock")).unwrap();
    lock.lock().unwrap();
    let mut child = scratch.start("report @run");
    let mut log = BufReader::new(child.stderr.take().unwrap()).lines();
    let waits = log.any(|line| line.unwrap().contains("waiting"));
    lock.unlock().unwrap();
    assert!(child.wait().unwrap().success());
    assert!(waits);
}

/// The old results would stand beside a config that they were not computed by.
#[test]
fn results_that_are_older_than_the_last_run_are_refused() {
    let scratch = Scratch::after_a_run();
    let frame = "data/frames/denim-01/002.png";
    let whole = scratch.bytes(frame);
    scratch.write(frame, &whole[..whole.len() / 2]);
    scratch.experiment().set(&["report.level=0.5"]).message();
    report(&scratch).refused("run; no run has finished; `experiment`");
    let mut compare = scratch.sps("compare @run @run");
    compare.refused("no run has finished");
    scratch.write(frame, &whole);
    scratch.experiment().assert().success();
    report(&scratch).assert().success();
}

#[test]
fn what_a_run_did_not_write_is_neither_sealed_nor_reported() {
    let scratch = Scratch::after_a_run();
    let old = ["run/figures/other.svg", "run/tables/other.csv"];
    fs::create_dir(scratch.path("run/target")).unwrap();
    scratch.write("run/target/large", "");
    #[cfg(unix)]
    std::os::unix::fs::symlink(scratch.path("data"), scratch.path("run/link")).unwrap();
    for mut command in [report(&scratch), scratch.experiment()] {
        for old in old {
            scratch.write(old, "old");
        }
        command.assert().success();
        assert!(!old.iter().any(|old| scratch.path(old).exists()));
        let sealed = scratch.read("run/checksums");
        let mut names: Vec<&str> = sealed.lines().map(|line| &line[66..]).collect();
        let tables = names.iter().filter(|name| name.starts_with("tables/"));
        assert!(tables.count() >= 10);
        names.retain(|name| !name.starts_with("figures/") && !name.starts_with("tables/"));
        names.sort_unstable();
        let written = "config.toml predictions.csv report.html report.md results.json";
        assert_eq!(names.join(" "), written);
    }
}

/// What breaks CSV and LaTeX stands in the label of a method.
#[test]
fn every_table_is_there_for_programs_and_for_papers() {
    let scratch = Scratch::new();
    scratch.edit("tiny.toml", "\"Ridge\"", "\"Ridge_1 & 50 %, one\"");
    scratch.experiment().assert().success();
    let page = scratch.read("run/report.md");
    for name in "means r2 percent-error mae mae-over-std spearman costs".split(' ') {
        let table: Vec<Vec<String>> = rows(&scratch.read(&format!("run/tables/{name}.csv")));
        assert_eq!(table[0][0], "Ridge_1 & 50 %, one");
        assert!(table.iter().all(|row| page.contains(&row[0])));
        let latex = scratch.read(&format!("run/tables/{name}.tex"));
        expect(&latex, r"    Ridge\_1 \& 50 \%, one & ");
        expect(&latex, r"\toprule; \bottomrule");
    }
    let means = scratch.read("run/tables/means.csv");
    let r2 = scratch.results()["methods"][0]["r2_mean"].to_string();
    expect(&means, &format!("MAE,MAE / std,Spearman,% error,; {r2}"));

    let written = scratch.read("run/tables/means.tex");
    fs::remove_dir_all(scratch.path("run/tables")).unwrap();
    report(&scratch).assert().success();
    assert_eq!(scratch.read("run/tables/means.tex"), written);
}

#[test]
fn photographs_that_are_gone_are_left_out_with_a_line() {
    let scratch = Scratch::after_a_run();
    let seen = scratch.read("run/report.html");
    expect(&seen, "The surfaces themselves; data:image/png;base64,");
    fs::remove_dir_all(scratch.path("data")).unwrap();
    report(&scratch).assert().success();
    let unseen = scratch.read("run/report.html");
    expect(&unseen, "The surfaces themselves; There are no pictures: ");
    assert!(!unseen.contains("data:image"));
    let cards = |page: &str| page.matches("<article>").count();
    assert_eq!(cards(&unseen), cards(&seen));
}

#[test]
fn json_is_the_content_of_the_results() {
    let scratch = Scratch::after_a_run();
    let [said, log] = report(&scratch).arg("--json").ended(0);
    expect(&log, "report.html");
    let said: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(said, scratch.json("run/results.json"));
}

#[test]
fn runs_that_cannot_be_written_to_are_shown_and_compared() {
    let scratch = Scratch::new();
    let run = scratch.path("run");
    let Some(mounted) = Mounted::new(&run, "size=50m") else {
        return;
    };
    scratch.experiment().assert().success();
    mounted.remount("ro");
    let [table, log] = report(&scratch).ended(0);
    expect(&table, "ridge");
    expect(&log, "the report was not written; Read-only file system");
    scratch.sps("compare @run @run").assert().success();
}

/// What a page shows, and what is wrong with it.
const PROBE: &str = include_str!("reports/probe.js");

#[test]
fn nothing_is_cut_or_missing_at_any_width_light_or_dark() {
    let Some(mut tab) = Tab::open() else { return };
    let scratch = Scratch::after_a_run();
    let page = format!("file://{}", scratch.path("run/report.html").display());
    let files = |folder: &str, ending: &str| {
        let entries = fs::read_dir(scratch.path(folder)).unwrap();
        let paths = entries.map(|entry| entry.unwrap().path());
        let found = paths.filter(|path| path.extension() == Some(ending.as_ref()));
        found.count()
    };
    for scheme in ["light", "dark"] {
        for width in [800, 1300, 1600] {
            tab.show(&page, width, scheme);
            let seen = tab.value(PROBE);
            assert_eq!(tab.problems(), [""; 0], "at {width} pixels, {scheme}");
            assert_eq!(seen["problems"], "", "at {width} pixels, {scheme}");
            assert_eq!(seen["tables"], files("run/tables", "csv"));
            assert_eq!(seen["figures"], files("run/figures", "svg"));
            // Of three surfaces, or two where no more are held out, one view each.
            assert!([2, 3].contains(&seen["pictures"].as_u64().unwrap()));
            assert_eq!(seen["dark"], scheme == "dark");
        }
    }
}
