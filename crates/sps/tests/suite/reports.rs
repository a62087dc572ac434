//! Reports of finished runs, and what is left in their folders.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::process::Stdio;

use crate::support::{Ends, Mounted, Scratch, expect, rows};
use serde_json::Value;

fn report(scratch: &Scratch) -> assert_cmd::Command {
    scratch.sps("report @run")
}

#[test]
fn a_report_waits_for_the_run_in_its_folder() {
    let scratch = Scratch::after_a_run();
    let lock = File::options().append(true).open(scratch.path("run/lock"));
    let lock = lock.unwrap();
    lock.lock().unwrap();
    let mut waiting = scratch.process("report @run");
    let mut child = waiting.stderr(Stdio::piped()).spawn().unwrap();
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
    let frame = scratch.path("data/frames/denim-01/002.png");
    let whole = fs::read(&frame).unwrap();
    fs::write(&frame, &whole[..whole.len() / 2]).unwrap();
    scratch.experiment().set(&["report.level=0.5"]).message();
    report(&scratch).refused(&["run", "no run has finished", "`experiment`"]);
    let mut compare = scratch.sps("compare @run @run");
    compare.refused(&["no run has finished"]);
    fs::write(&frame, &whole).unwrap();
    scratch.experiment().assert().success();
    report(&scratch).assert().success();
}

#[test]
fn what_a_run_did_not_write_is_neither_sealed_nor_reported() {
    let scratch = Scratch::after_a_run();
    let old = [
        scratch.path("run/figures/of-another-config.svg"),
        scratch.path("run/tables/of-another-config.csv"),
    ];
    let leave_old = || old.iter().for_each(|old| fs::write(old, "old").unwrap());
    leave_old();
    fs::create_dir(scratch.path("run/target")).unwrap();
    scratch.write("run/target/large", "");
    #[cfg(unix)]
    std::os::unix::fs::symlink(scratch.path("data"), scratch.path("run/link")).unwrap();
    for mut command in [report(&scratch), scratch.experiment()] {
        command.assert().success();
        assert!(!old.iter().any(|old| old.exists()));
        let sealed = scratch.read("run/checksums");
        let mut names: Vec<&str> = sealed.lines().map(|line| &line[66..]).collect();
        let tables = names.iter().filter(|name| name.starts_with("tables/"));
        assert!(tables.count() >= 10);
        names.retain(|name| !name.starts_with("figures/") && !name.starts_with("tables/"));
        names.sort_unstable();
        let written = "config.toml predictions.csv report.html report.md results.json";
        assert_eq!(names.join(" "), written);
        leave_old();
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
        let label = "    Ridge\\_1 \\& 50 \\%, one & ";
        expect(&latex, &["\\toprule", label, "\\bottomrule"]);
    }
    let means = scratch.read("run/tables/means.csv");
    let r2 = scratch.results()["methods"][0]["r2_mean"].to_string();
    expect(&means, &["MAE,MAE / std,Spearman,% error,", &r2]);

    let written = scratch.read("run/tables/means.tex");
    fs::remove_dir_all(scratch.path("run/tables")).unwrap();
    report(&scratch).assert().success();
    assert_eq!(scratch.read("run/tables/means.tex"), written);
}

#[test]
fn photographs_that_are_gone_are_left_out_with_a_line() {
    let scratch = Scratch::after_a_run();
    let seen = scratch.read("run/report.html");
    let title = "The surfaces themselves";
    expect(&seen, &[title, "data:image/png;base64,"]);
    fs::remove_dir_all(scratch.path("data")).unwrap();
    report(&scratch).assert().success();
    let unseen = scratch.read("run/report.html");
    expect(&unseen, &[title, "There are no pictures: "]);
    assert!(!unseen.contains("data:image"));
    let cards = |page: &str| page.matches("<article>").count();
    assert_eq!(cards(&unseen), cards(&seen));
}

#[test]
fn json_is_the_content_of_the_results() {
    let scratch = Scratch::after_a_run();
    let [said, log] = report(&scratch).arg("--json").said_and_logged();
    expect(&log, &["report.html"]);
    let [said, written] = [&said, &scratch.read("run/results.json")]
        .map(|text| serde_json::from_str::<Value>(text).unwrap());
    assert_eq!(said, written);
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
    let [table, log] = report(&scratch).said_and_logged();
    expect(&table, &["ridge"]);
    let failed = "the report was not written";
    expect(&log, &[failed, "Read-only file system"]);
    scratch.sps("compare @run @run").assert().success();
}
