//! Simulated datasets on disk: written, interrupted, read and looked at.

mod support;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use assert_cmd::assert::Assert;
use serde_json::Value;
use sps_dataset::{DecodeSettings, read_image};
use support::{
    Mounted, Scratch, expect, json, kill, message, process, results_without_timings, sps,
};

/// Eight surfaces of four small views.
const SMALL: &str = "simulate --surfaces 8 --views 4 --size 48 --seed 5";

fn small(out: &Path) -> Assert {
    let mut simulate = sps();
    simulate.args(SMALL.split(' ')).arg("--out").arg(out);
    simulate.assert()
}

/// Every file below a folder with its content.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_owned();
                found.insert(name, fs::read(&path).unwrap());
            }
        }
    }
    found
}

/// The finished surfaces of an unfinished dataset.
fn finished(folder: &Path) -> Vec<PathBuf> {
    let surfaces = fs::read_dir(folder.join("frames")).into_iter().flatten();
    let paths = surfaces.map(|entry| entry.unwrap().path());
    paths
        .filter(|path| !path.file_name().unwrap().to_string_lossy().starts_with('.'))
        .collect()
}

#[test]
fn a_killed_run_goes_on_and_gives_the_files_of_one_that_was_not() {
    let scratch = Scratch::new();
    let (whole, cut) = (scratch.path("whole"), scratch.path("cut"));
    small(&whole).success();
    let mut child = process();
    child.args(SMALL.split(' ')).arg("--out").arg(&cut);
    let child = child.args(["--threads", "1"]).spawn().unwrap();
    // Once the first surface is whole.
    kill(child, || !finished(&cut).is_empty());
    let begun = finished(&cut);
    for surface in &begun {
        assert_eq!(fs::read_dir(surface).unwrap().count(), 4);
    }
    let again = small(&cut).success();
    let log = String::from_utf8_lossy(&again.get_output().stderr).into_owned();
    if begun.len() < 8 {
        assert!(!log.contains(" 0 were there"), "{log}");
    }
    assert_eq!(files(&whole), files(&cut));
}

#[test]
fn a_full_disk_ends_with_one_message_and_whole_surfaces_only() {
    let scratch = Scratch::new();
    let data = scratch.path("disk");
    let Some(mounted) = Mounted::new(&data, "size=160k") else {
        return;
    };
    let out = data.join("set");
    let text = message(small(&out));
    expect(&text, &["disk/set", "no space is left"]);
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(!out.join("dataset.toml").exists());
    for surface in finished(&out) {
        let frames = files(&surface);
        assert_eq!(frames.len(), 4);
        for name in frames.keys() {
            read_image(&surface.join(name), &DecodeSettings::default()).unwrap();
        }
    }
    mounted.remount("size=10m");
    small(&out).success();
    let straight = scratch.path("straight");
    small(&straight).success();
    assert_eq!(files(&out), files(&straight));
}

#[test]
fn inspect_prints_and_draws_the_statistics() {
    let scratch = Scratch::new();
    let (data, figures) = (scratch.path("data"), scratch.path("figures"));
    let friction = || {
        let mut inspect = sps();
        inspect.arg("inspect").arg(&data).arg("--out").arg(&figures);
        let inspected = inspect.assert().success();
        let text = String::from_utf8_lossy(&inspected.get_output().stdout).into_owned();
        let line = text
            .lines()
            .find(|line| line.trim_start().starts_with("fRS "));
        let cells = line.unwrap().split_whitespace();
        cells.map(str::to_owned).collect::<Vec<_>>()
    };
    // What the paper prints stands beside its own surfaces and those simulated after them alone.
    let own = friction();
    scratch.edit("data/dataset.toml", "name =", "origin = \"paper\"\nname =");
    let printed = friction();
    assert_eq!(printed[..own.len()], own);
    let published: Vec<f64> = printed[own.len()..]
        .iter()
        .map(|q| q.parse().unwrap())
        .collect();
    assert_eq!(published, [13.3, 30.0, 34.5, 46.6, 100.0]);
    for name in ["boxes.svg", "materials.svg"] {
        let svg = fs::read_to_string(figures.join(name)).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
    }
    let labels = fs::read_to_string(figures.join("materials.svg")).unwrap();
    assert!(labels.contains("other 100.0 %"));

    let elsewhere = scratch.path("elsewhere");
    fs::create_dir(&elsewhere).unwrap();
    let mut inspect = sps();
    inspect.current_dir(&elsewhere).arg("inspect").arg(&data);
    inspect.assert().success();
    assert_eq!(fs::read_dir(elsewhere).unwrap().count(), 0);
}

#[test]
fn inspect_reads_a_dataset_by_the_settings_of_a_config() {
    let scratch = Scratch::new();
    let config = scratch.path("tiny.toml");
    let inspect = |from: &[&OsStr]| {
        let mut command = sps();
        command.arg("inspect").args(from).arg("--json");
        command.arg("--out").arg(scratch.path("figures"));
        command
    };
    let by_config = |setting: &str| {
        inspect(&[
            "--config".as_ref(),
            config.as_ref(),
            "--set".as_ref(),
            setting.as_ref(),
        ])
    };
    let read = |mut command: Command| {
        let output = command.assert().success();
        let read: Value = serde_json::from_slice(&output.get_output().stdout).unwrap();
        read
    };
    let by_folder = read(inspect(&[scratch.path("data").as_ref()]));
    assert_eq!(read(by_config("reruns=1")), by_folder);
    let medians = read(by_config("data.folder.read.tactile.repeats=median"));
    assert_eq!(medians["surfaces"], by_folder["surfaces"]);
    assert_ne!(medians["properties"], by_folder["properties"]);

    let split = "[split.leave-one-out]\nby = \"group\"";
    scratch.edit("tiny.toml", "[split.random]", split);
    scratch.edit("tiny.toml", "validation = 0.34\nby = \"surface\"\n", "");
    scratch.edit(
        "tiny.toml",
        "[data]\n",
        "[data]\nsimulated.test-surfaces = 0\n",
    );
    let refused = by_config("data.from=simulator").assert();
    expect(&message(refused), &["tiny.toml", "data.from", "simulate"]);
}

#[test]
fn a_simulated_dataset_reads_back_as_it_was_simulated() {
    let scratch = Scratch::new();
    let data = scratch.path("simulated");
    let simulate = || {
        let line = "simulate --surfaces 6 --views 3 --size 32 --seed 5 --format png --json --out";
        let mut simulate = sps();
        simulate.args(line.split(' ')).arg(&data);
        json(simulate.assert())
    };
    for (written, there) in [(6, 0), (0, 6)] {
        let expected = serde_json::json!({
            "dataset": data, "written": written, "already_there": there,
        });
        assert_eq!(simulate(), expected);
    }
    sps()
        .arg("inspect")
        .arg(&data)
        .arg("--out")
        .arg(scratch.path("figures"))
        .assert()
        .success();
    let run = |settings: &[String]| {
        let mut command = scratch.experiment();
        command.arg("--fresh");
        for setting in settings {
            command.args(["--set", setting]);
        }
        command.assert().success();
        results_without_timings(&scratch.path("run"))["methods"].clone()
    };
    let from_disk = run(&[format!("data.folder.path={}", data.display())]);
    let in_memory = run(&[
        "data.from=simulator".to_owned(),
        "data.simulated.surfaces=6".to_owned(),
        "data.simulated.test-surfaces=0".to_owned(),
        "data.simulated.views=3".to_owned(),
        "data.simulated.size=32".to_owned(),
        "data.simulated.seed=5".to_owned(),
    ]);
    assert_eq!(from_disk, in_memory);
}
