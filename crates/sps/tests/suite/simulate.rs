//! Simulated datasets on disk: written, interrupted, read and looked at.

use std::fs;
use std::path::{Path, PathBuf};

use crate::support::{Ends, Mounted, Scratch, expect, kill, line, tree};
use serde_json::json;
use sps_dataset::{DecodeSettings, read_image};

/// Eight surfaces of four small views.
const SMALL: &str = "simulate --surfaces 8 --views 4 --size 48 --seed 5";

/// The folders of the finished surfaces of an unfinished dataset.
fn finished(folder: &Path) -> Vec<PathBuf> {
    let surfaces = fs::read_dir(folder.join("frames")).into_iter().flatten();
    let surfaces = surfaces.map(Result::unwrap);
    let surfaces = surfaces.filter(|of| !of.file_name().to_string_lossy().starts_with('.'));
    surfaces.map(|surface| surface.path()).collect()
}

#[test]
fn a_killed_run_goes_on_and_gives_the_files_of_one_that_was_not() {
    let scratch = Scratch::new();
    let (whole, cut) = (scratch.path("whole"), scratch.path("cut"));
    let small = |out: &str| scratch.sps(&format!("{SMALL} --out @{out}"));
    small("whole").assert().success();
    let line = format!("{SMALL} --out @cut --threads 1");
    let child = scratch.process(&line).spawn().unwrap();
    // Once the first surface is whole.
    kill(child, || !finished(&cut).is_empty());
    let begun = finished(&cut);
    for surface in &begun {
        assert_eq!(fs::read_dir(surface).unwrap().count(), 4);
    }
    let log = small("cut").logged();
    if begun.len() < 8 {
        assert!(!log.contains(" 0 were there"), "{log}");
    }
    assert_eq!(tree(&whole), tree(&cut));
}

#[test]
fn a_full_disk_ends_with_one_message_and_whole_surfaces_only() {
    let scratch = Scratch::new();
    let data = scratch.path("disk");
    let Some(mounted) = Mounted::new(&data, "size=160k") else {
        return;
    };
    let out = data.join("set");
    let small = |out: &str| scratch.sps(&format!("{SMALL} --out @{out}"));
    let text = small("disk/set").message();
    expect(&text, "disk/set; no space is left");
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(!out.join("dataset.toml").exists());
    for surface in finished(&out) {
        let frames = tree(&surface);
        assert_eq!(frames.len(), 4);
        for name in frames.keys() {
            read_image(&surface.join(name), &DecodeSettings::default()).unwrap();
        }
    }
    mounted.remount("size=10m");
    small("disk/set").assert().success();
    small("straight").assert().success();
    assert_eq!(tree(&out), tree(&scratch.path("straight")));
}

#[test]
fn inspect_prints_and_draws_the_statistics() {
    let scratch = Scratch::new();
    let friction = || line(&scratch.sps("inspect @data --out @figures").said(), "fRS");
    // What the paper prints stands beside its own surfaces and those simulated after them alone.
    let own = friction();
    scratch.edit("data/dataset.toml", "name =", "origin = \"paper\"\nname =");
    let printed = friction();
    assert_eq!(printed, own + " 13.3 30.0 34.5 46.6 100.0");
    for name in ["boxes.svg", "materials.svg"] {
        let svg = scratch.read(&format!("figures/{name}"));
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
    }
    expect(&scratch.read("figures/materials.svg"), "other 100.0 %");

    let elsewhere = Scratch::empty();
    let mut inspect = scratch.sps("inspect @data");
    inspect.current_dir(elsewhere.path(".")).assert().success();
    assert!(tree(&elsewhere.path(".")).is_empty());
}

#[test]
fn inspect_reads_a_dataset_by_the_settings_of_a_config() {
    let scratch = Scratch::new();
    let by_config = |setting: &str| {
        let line = "inspect --config @tiny.toml --json --out @figures --set";
        scratch.sps(&format!("{line} {setting}"))
    };
    let by_folder = scratch.sps("inspect @data --json --out @figures").json();
    assert_eq!(by_config("reruns=1").json(), by_folder);
    let medians = by_config("data.folder.read.tactile.repeats=median").json();
    assert_eq!(medians["surfaces"], by_folder["surfaces"]);
    assert_ne!(medians["properties"], by_folder["properties"]);

    let none = "[data]\nsimulated.test-surfaces = 0\n";
    scratch.edit("tiny.toml", "[data]\n", none);
    let mut simulated = by_config("data.from=simulator");
    simulated.refused("tiny.toml; data.from; simulate");
}

#[test]
fn a_simulated_dataset_reads_back_as_it_was_simulated() {
    let scratch = Scratch::new();
    let data = scratch.path("simulated");
    let small = "simulate --surfaces 6 --views 3 --size 32 --seed 5 --format png --out @simulated";
    for (written, there) in [(6, 0), (0, 6)] {
        let expected = json!({ "dataset": data, "written": written, "already_there": there });
        assert_eq!(scratch.sps(small).arg("--json").json(), expected);
    }
    scratch.sps("inspect @simulated --out @figures").said();
    let run = |settings: &str| {
        let settings: Vec<&str> = settings.split_whitespace().collect();
        let mut command = scratch.experiment();
        command.arg("--fresh").set(&settings).assert().success();
        scratch.results()["methods"].take()
    };
    let from_disk = run(&format!("data.folder.path={}", data.display()));
    let in_memory = run(
        "data.from=simulator data.simulated.surfaces=6 data.simulated.test-surfaces=0 \
         data.simulated.views=3 data.simulated.size=32 data.simulated.seed=5",
    );
    assert_eq!(from_disk, in_memory);
}
