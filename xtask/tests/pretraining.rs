//! Pretraining an encoder from the command line.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use candle_core::Tensor;
use sps_models::weights::Weights;

/// The root of the repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

const PRETRAIN: &str = "
views-per-surface = 2
[simulated]
surfaces = 10
seed = 99
size = 32
[training]
epochs = 2
batch-size = 8
validation = 0.2
";

/// `pretrain` in a folder of its own, with settings before those of the config, and tables after them.
fn pretrain(folder: &Path, settings: &str, tables: &str) -> Command {
    fs::create_dir_all(folder).unwrap();
    let config = format!("{settings}{PRETRAIN}{tables}");
    fs::write(folder.join("small.toml"), config).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command
        .args(["pretrain", "small.toml", "--out", "weights.safetensors"])
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command
}

/// What a call says that ends with this status.
fn ended(mut command: Command, status: i32) -> String {
    let output = command.stderr(Stdio::piped()).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(status), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    said
}

/// What is in the folder of the runs: a folder of each training.
fn runs(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder.join("runs/small"));
    let paths = entries.into_iter().flatten();
    paths.map(|entry| entry.unwrap().path()).collect()
}

#[test]
fn pretraining_that_was_killed_ends_with_the_same_weights() {
    let scratch = tempfile::tempdir().unwrap();
    let (through, killed) = (scratch.path().join("a"), scratch.path().join("b"));
    assert!(pretrain(&through, "", "").status().unwrap().success());
    let expected = fs::read(through.join("weights.safetensors")).unwrap();

    let mut child = pretrain(&killed, "", "").spawn().unwrap();
    let has_state = |run: &PathBuf| run.join("state.safetensors").exists();
    let begun = || runs(&killed).iter().any(has_state);
    while !begun() && child.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    let _ = child.kill();
    child.wait().unwrap();
    assert!(pretrain(&killed, "", "").status().unwrap().success());
    assert!(fs::read(killed.join("weights.safetensors")).unwrap() == expected);

    let (_, header) = safetensors::SafeTensors::read_metadata(&expected).unwrap();
    let note = &header.metadata().as_ref().unwrap()["sps-pretraining"];
    for part in ["seed = 99", "classes right"] {
        assert!(note.contains(part), "{note}");
    }
    let files = fs::read_dir(&runs(&through)[0]).unwrap();
    let mut names = files.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert!(names.any(|name| name.starts_with("events.out.tfevents.")));
}

#[test]
fn an_encoder_starts_from_weights_that_fit_it() {
    let scratch = tempfile::tempdir().unwrap();
    let fixture = |name: &str| root().join("crates/sps-models/weights").join(name);
    let start = |name: &str| format!("start = {:?}\n", fixture(name).display().to_string());
    let tables = "[training.augmentation]\nflip = false\n";
    let command = |folder: &Path, settings: &str| pretrain(folder, settings, tables);
    let body = "encoder = \"efficientnet-lite-body\"\n";
    let weights = |settings: &str, folder: &str| {
        let folder = scratch.path().join(folder);
        let said = ended(command(&folder, settings), 0);
        (fs::read(folder.join("weights.safetensors")).unwrap(), said)
    };
    let (from_seed, _) = weights(body, "seeded");
    let started = format!("{body}{}", start("efficientnet-lite-body.safetensors"));
    let (from_file, said) = weights(&started, "started");
    assert!(from_seed != from_file);
    assert!(said.contains("240 of 240 tensors"), "{said}");
    let (mixed, _) = weights(&format!("{started}trained-share = 0.5\n"), "mixed");
    let read = |bytes: &[u8]| Weights::from_bytes("weights", bytes).unwrap();
    let first = fs::read(fixture("efficientnet-lite-body.safetensors")).unwrap();
    let [first, trained, mixed] = [&first, &from_file, &mixed].map(|bytes| read(bytes));
    for (name, found) in mixed.iter() {
        let values = |tensor: &Tensor| tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let ends = [&first, &trained].map(|weights| values(weights.get(name).unwrap()));
        for ((a, b), found) in ends[0].iter().zip(&ends[1]).zip(values(found)) {
            let expected = 0.5 * (a + b);
            let rounding = 2e-3 * (a.abs() + b.abs()) + 1e-7;
            let is_near = (found - expected).abs() <= rounding;
            assert!(is_near, "{name}: {found}, expected {expected}");
        }
    }

    let refused = |settings: String, part: &str| {
        let said = ended(command(&scratch.path().join("refused"), &settings), 1);
        assert!(said.contains(part), "{part}: {said}");
    };
    refused(started + "trained-share = 0.0\n", "trained-share");
    refused(format!("{body}trained-share = 0.5\n"), "it needs `start`");
    let other = start("../../../fixtures/golden/squeezenet1_0.safetensors");
    let none = "no tensor of which efficientnet-lite-body has";
    refused(body.to_owned() + &other, none);
    let gone = start("none.safetensors");
    refused(body.to_owned() + &gone, "none.safetensors");
}

/// Begun with the built-in encoder, of which some images' features are kept.
fn keeping(kept: &str) -> (String, String) {
    let weights = root().join("crates/sps-models/weights/efficientnet-lite-body.safetensors");
    let start = format!(
        "start = {:?}\ndepths = \"all\"\n",
        weights.display().to_string()
    );
    (start, format!("[kept]\n{kept}\n"))
}

#[test]
fn an_encoder_keeps_what_it_sees_in_patterns() {
    let scratch = tempfile::tempdir().unwrap();
    let weights = |folder: &str, kept: &str, threads: &str| {
        let folder = scratch.path().join(folder);
        let (start, tables) = keeping(kept);
        let mut command = pretrain(&folder, &start, &tables);
        command.env("RAYON_NUM_THREADS", threads);
        let said = ended(command, 0);
        assert!(said.contains("240 of 240 tensors"), "{said}");
        fs::read(folder.join("weights.safetensors")).unwrap()
    };
    let first = weights("a", "patterns = 12", "1");
    assert!(first == weights("b", "patterns = 12", "3"));
    // In a folder that holds the finished training of another weight.
    assert!(first != weights("a", "patterns = 12\nweight = 9.0", "3"));
    assert!(first != weights("a", "patterns = 0", "3"));
}

#[test]
fn what_cannot_be_kept_is_refused_by_key() {
    let scratch = tempfile::tempdir().unwrap();
    let refused = |settings: &str, kept: &str, key: &str| {
        let (_, tables) = keeping(kept);
        let said = ended(pretrain(scratch.path(), settings, &tables), 1);
        assert!(said.contains(key), "{key}: {said}");
    };
    refused("", "patterns = 3", "`kept.patterns`");
    refused("", "weight = 0.0", "`kept.weight`");
    refused("", "pattern = 3", "pattern");
}
