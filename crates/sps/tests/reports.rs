//! Reports of finished runs, and what is left in their folders.

mod support;

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::process::Stdio;

use serde_json::Value;
use support::{Mounted, Scratch, expect, json, message, process, sps};

fn report(scratch: &Scratch) -> assert_cmd::Command {
    let mut command = sps();
    command.arg("report").arg(scratch.path("run"));
    command
}

#[test]
fn a_report_waits_for_the_run_in_its_folder() {
    let scratch = Scratch::new();
    scratch.experiment().assert().success();
    let lock = File::options().append(true).open(scratch.path("run/lock"));
    let lock = lock.unwrap();
    lock.lock().unwrap();
    let mut child = process()
        .arg("report")
        .arg(scratch.path("run"))
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut log = BufReader::new(child.stderr.take().unwrap()).lines();
    let waits = log.any(|line| line.unwrap().contains("waiting"));
    lock.unlock().unwrap();
    assert!(child.wait().unwrap().success());
    assert!(waits);
}

/// The old results would stand beside a config that they were not computed by.
#[test]
fn results_that_are_older_than_the_last_run_are_refused() {
    let scratch = Scratch::new();
    scratch.experiment().assert().success();
    let frame = scratch.path("data/frames/denim-01/002.png");
    let whole = fs::read(&frame).unwrap();
    fs::write(&frame, &whole[..whole.len() / 2]).unwrap();
    let mut again = scratch.experiment();
    message(again.args(["--set", "report.level=0.5"]).assert());
    let text = message(report(&scratch).assert());
    expect(&text, &["run", "no run has finished", "`experiment`"]);
    let mut compare = sps();
    let both = [scratch.path("run"), scratch.path("run")];
    let text = message(compare.arg("compare").args(both).assert());
    expect(&text, &["no run has finished"]);
    fs::write(&frame, &whole).unwrap();
    scratch.experiment().assert().success();
    report(&scratch).assert().success();
}

#[test]
fn what_a_run_did_not_write_is_neither_sealed_nor_reported() {
    let scratch = Scratch::new();
    scratch.experiment().assert().success();
    let old = [
        scratch.path("run/figures/of-another-config.svg"),
        scratch.path("run/tables/of-another-config.csv"),
    ];
    let leave_old = || old.iter().for_each(|old| fs::write(old, "old").unwrap());
    leave_old();
    fs::create_dir(scratch.path("run/target")).unwrap();
    fs::write(scratch.path("run/target/large"), "").unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink(scratch.path("data"), scratch.path("run/link")).unwrap();
    for mut command in [report(&scratch), scratch.experiment()] {
        command.assert().success();
        assert!(!old.iter().any(|old| old.exists()));
        let sealed = fs::read_to_string(scratch.path("run/checksums")).unwrap();
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
    let read = |name: &str| fs::read_to_string(scratch.path("run").join(name)).unwrap();
    let page = read("report.md");
    for name in "means r2 percent-error mae mae-over-std spearman costs".split(' ') {
        let mut csv = csv::Reader::from_path(scratch.path(&format!("run/tables/{name}.csv")));
        let csv = csv.as_mut().unwrap();
        let records = csv.records().map(Result::unwrap);
        let labels: Vec<String> = records.map(|record| record[0].to_owned()).collect();
        assert_eq!(labels[0], "Ridge_1 & 50 %, one");
        assert!(labels.iter().all(|label| page.contains(label.as_str())));
        let latex = read(&format!("tables/{name}.tex"));
        expect(
            &latex,
            &[
                "\\toprule",
                "    Ridge\\_1 \\& 50 \\%, one & ",
                "\\bottomrule",
            ],
        );
    }
    let means = read("tables/means.csv");
    let r2 = scratch.results()["methods"][0]["r2_mean"].to_string();
    expect(&means, &["MAE,MAE / std,Spearman,% error,", &r2]);

    let written = fs::read(scratch.path("run/tables/means.tex")).unwrap();
    fs::remove_dir_all(scratch.path("run/tables")).unwrap();
    report(&scratch).assert().success();
    assert_eq!(
        fs::read(scratch.path("run/tables/means.tex")).unwrap(),
        written
    );
}

#[test]
fn photographs_that_are_gone_are_left_out_with_a_line() {
    let scratch = Scratch::new();
    scratch.experiment().assert().success();
    let page = || fs::read_to_string(scratch.path("run/report.html")).unwrap();
    let seen = page();
    expect(
        &seen,
        &["The surfaces themselves", "data:image/png;base64,"],
    );
    fs::remove_dir_all(scratch.path("data")).unwrap();
    report(&scratch).assert().success();
    let unseen = page();
    expect(
        &unseen,
        &["The surfaces themselves", "There are no pictures: "],
    );
    assert!(!unseen.contains("data:image"));
    let cards = |page: &str| page.matches("<article>").count();
    assert_eq!(cards(&unseen), cards(&seen));
}

#[test]
fn json_is_the_content_of_the_results() {
    let scratch = Scratch::new();
    scratch.experiment().assert().success();
    let said = report(&scratch).arg("--json").assert().success();
    let text = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
    expect(&text, &["report.html"]);
    let written = fs::read_to_string(scratch.path("run/results.json")).unwrap();
    assert_eq!(json(said), serde_json::from_str::<Value>(&written).unwrap());
}

#[test]
fn a_folder_without_a_run_is_left_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let text = message(sps().arg("report").arg(folder.path()).assert());
    expect(&text, &["is not the folder of a run"]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
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
    let shown = report(&scratch).assert().success().get_output().clone();
    let [table, log] = [shown.stdout, shown.stderr].map(|text| String::from_utf8(text).unwrap());
    expect(&table, &["ridge"]);
    expect(
        &log,
        &["the report was not written", "Read-only file system"],
    );
    let mut compare = sps();
    compare.arg("compare").args([&run, &run]).assert().success();
}
