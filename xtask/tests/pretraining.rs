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
surfaces = 20
seed = 99
size = 32
[training]
epochs = 4
batch-size = 8
validation = 0.2
";

/// `pretrain` in a folder of its own, with tables added to the config.
fn pretrain(folder: &Path, tables: &str) -> Command {
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join("small.toml"), format!("{PRETRAIN}{tables}")).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command
        .args(["pretrain", "small.toml", "--out", "weights.safetensors"])
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command
}

/// What a call says that must fail.
fn refusal(mut command: Command) -> String {
    let output = command.stderr(Stdio::piped()).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    said
}

/// The one folder of a training.
fn record(folder: &Path) -> Option<PathBuf> {
    let mut entries = fs::read_dir(folder.join("runs/small")).ok()?;
    Some(entries.next()?.ok()?.path())
}

#[test]
fn pretraining_that_was_killed_ends_with_the_same_weights() {
    let scratch = tempfile::tempdir().unwrap();
    let (through, killed) = (scratch.path().join("a"), scratch.path().join("b"));
    assert!(pretrain(&through, "").status().unwrap().success());
    let expected = fs::read(through.join("weights.safetensors")).unwrap();

    let mut child = pretrain(&killed, "").spawn().unwrap();
    let begun = || record(&killed).is_some_and(|folder| folder.join("state.safetensors").exists());
    while !begun() && child.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    let _ = child.kill();
    child.wait().unwrap();
    assert!(pretrain(&killed, "").status().unwrap().success());
    assert!(fs::read(killed.join("weights.safetensors")).unwrap() == expected);

    let (_, header) = safetensors::SafeTensors::read_metadata(&expected).unwrap();
    let note = &header.metadata().as_ref().unwrap()["sps-pretraining"];
    assert!(
        note.contains("seed = 99") && note.contains("classes right"),
        "{note}"
    );
    let events = fs::read_dir(record(&through).unwrap()).unwrap();
    let names = events.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert!(
        names
            .into_iter()
            .any(|name| name.starts_with("events.out.tfevents."))
    );
}

#[test]
fn an_encoder_starts_from_weights_that_fit_it() {
    let scratch = tempfile::tempdir().unwrap();
    let fixture = |name: &str| root().join("crates/sps-models/weights").join(name);
    let start = |name: &str| format!("start = {:?}\n", fixture(name).display().to_string());
    let command = |folder: &Path, settings: &str| {
        let command = pretrain(folder, "[training.augmentation]\nflip = false\n");
        let config = fs::read_to_string(folder.join("small.toml")).unwrap();
        fs::write(folder.join("small.toml"), format!("{settings}{config}")).unwrap();
        command
    };
    let body = "encoder = \"efficientnet-lite-body\"\n";
    let weights = |settings: &str, folder: &str| {
        let folder = scratch.path().join(folder);
        let mut command = command(&folder, settings);
        let output = command.stderr(Stdio::piped()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{said}");
        (fs::read(folder.join("weights.safetensors")).unwrap(), said)
    };
    let (from_seed, _) = weights(body, "seeded");
    let started = format!("{body}{}", start("efficientnet-lite-body.safetensors"));
    let (from_file, said) = weights(&started, "started");
    assert!(from_seed != from_file);
    assert!(said.contains("240 of 240 tensors"), "{said}");
    let (mixed, _) = weights(&format!("{started}trained-share = 0.5\n"), "mixed");
    let read = |bytes: &[u8]| Weights::from_bytes("weights", bytes).unwrap();
    let [first, trained, mixed] = [
        &fs::read(fixture("efficientnet-lite-body.safetensors")).unwrap(),
        &from_file,
        &mixed,
    ]
    .map(|bytes| read(bytes));
    for (name, found) in mixed.iter() {
        let values = |tensor: &Tensor| tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let ends = [&first, &trained].map(|weights| values(weights.get(name).unwrap()));
        for ((a, b), found) in ends[0].iter().zip(&ends[1]).zip(values(found)) {
            let expected = 0.5 * (a + b);
            let rounding = 2e-3 * (a.abs() + b.abs()) + 1e-7;
            assert!(
                (found - expected).abs() <= rounding,
                "{name}: {found}, expected {expected}"
            );
        }
    }

    for (settings, part) in [
        (format!("{started}trained-share = 0.0\n"), "trained-share"),
        (format!("{body}trained-share = 0.5\n"), "it needs `start`"),
        (
            format!(
                "{body}{}",
                start("../../../fixtures/golden/squeezenet1_0.safetensors")
            ),
            "no tensor of which efficientnet-lite-body has",
        ),
        (
            format!("{body}{}", start("none.safetensors")),
            "none.safetensors",
        ),
    ] {
        let said = refusal(command(&scratch.path().join("refused"), &settings));
        assert!(said.contains(part), "{said}");
    }
}

/// The built-in encoder as a teacher, of patterns too.
fn taught(weight: f64, size: usize, images: usize) -> String {
    let weights = root().join("crates/sps-models/weights/efficientnet-lite-body.safetensors");
    format!(
        "[patterns]\nclasses = 5\nimages = {images}\n[teacher]\nencoder = \"efficientnet-lite-body\"\n\
         weights = {:?}\nsize = {size}\nweight = {weight:?}\n",
        weights.display().to_string()
    )
}

#[test]
fn an_encoder_learns_patterns_and_what_a_teacher_sees() {
    let scratch = tempfile::tempdir().unwrap();
    let weights = |folder: &str, tables: &str, threads: &str| {
        let folder = scratch.path().join(folder);
        let mut command = pretrain(&folder, tables);
        command.env("RAYON_NUM_THREADS", threads);
        assert!(command.status().unwrap().success());
        let runs = fs::read_dir(folder.join("runs/small")).unwrap();
        let kept = runs.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let kept = kept.filter(|name| name.starts_with("teacher-")).count();
        (fs::read(folder.join("weights.safetensors")).unwrap(), kept)
    };
    let (first, kept) = weights("a", &taught(1.0, 48, 6), "1");
    assert_eq!(kept, 1);
    assert!(first == weights("b", &taught(1.0, 48, 6), "3").0);
    // Its embeddings are found again by a training that weighs them otherwise.
    let (other, kept) = weights("a", &taught(3.0, 48, 6), "3");
    assert_eq!(kept, 1);
    assert!(first != other);
    // Damaged, they are made again.
    let entries = fs::read_dir(scratch.path().join("a/runs/small")).unwrap();
    let mut paths = entries.map(|entry| entry.unwrap().path());
    let kept = paths.find(|path| path.extension().is_some_and(|e| e == "safetensors"));
    let kept = kept.unwrap();
    let mut bytes = fs::read(&kept).unwrap();
    *bytes.last_mut().unwrap() ^= 0x80;
    fs::write(&kept, bytes).unwrap();
    let [again, whole] = ["a", "b"].map(|folder| weights(folder, &taught(2.0, 48, 6), "3"));
    assert!(again == whole);
    let (alone, kept) = weights("a", "[patterns]\nclasses = 5\nimages = 6\n", "3");
    assert_eq!(kept, 1);
    assert!(first != alone);
}

#[test]
fn a_teacher_and_patterns_that_cannot_be_meant_are_refused_by_key() {
    let scratch = tempfile::tempdir().unwrap();
    for (tables, key) in [
        (taught(0.0, 48, 6), "teacher.weight"),
        (taught(1.0, 0, 6), "teacher.size"),
        (taught(1.0, 48, 0), "patterns.images"),
        (
            taught(1.0, 48, 6).replace("efficientnet-lite-body\"", "vgg\""),
            "teacher.encoder",
        ),
        (
            taught(1.0, 48, 6).replace("body.safe", "gone.safe"),
            "efficientnet-lite-gone",
        ),
    ] {
        let said = refusal(pretrain(scratch.path(), &tables));
        assert!(said.contains(key), "{key}: {said}");
    }
}
