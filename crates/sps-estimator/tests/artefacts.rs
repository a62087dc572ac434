//! Files that were damaged, made up, or written by another version.

#[path = "../../../fixtures/fuzz/mod.rs"]
mod fuzz;
mod support;

use std::fs;
use std::path::Path;

use fuzz::{Damage, broken, damaged, fuzz, nested, said, with_header};
use proptest::prelude::any;
use serde_json::{Value, json};
use sps_estimator::{Estimator, Precomputed, Session, Sight};
use support::{Tables, block, npy, photograph, recipe, ridge};

fn kept() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let estimator = Tables::new(16, 1, 1).estimator(&recipe(ridge(), &[0]));
    estimator.save(folder.path()).unwrap();
    folder
}

fn refused(folder: &Path) -> String {
    let error = Estimator::load(folder).err();
    error.expect("a damaged model was read").to_string()
}

#[test]
fn every_changed_file_is_noticed_and_named() {
    let folder = kept();
    let names = names(folder.path());
    assert_eq!(names.len(), 6, "{names:?}");
    for name in names.iter().filter(|name| *name != "estimator.json") {
        let path = folder.path().join(name);
        let whole = fs::read(&path).unwrap();
        let mut other = whole.clone();
        *other.last_mut().unwrap() ^= 1;
        fs::write(&path, &other).unwrap();
        assert!(refused(folder.path()).contains(name));
        fs::remove_file(&path).unwrap();
        assert!(refused(folder.path()).contains(name));
        fs::write(&path, &whole).unwrap();
    }
    Estimator::load(folder.path()).unwrap();
    fs::remove_file(folder.path().join("estimator.json")).unwrap();
    assert!(refused(folder.path()).contains("estimator.json"));
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

#[test]
fn a_model_is_replaced_in_one_step() {
    let folder = kept();
    let path = folder.path();
    let asked = [photograph(40, 0)];
    let answer = || Estimator::load(path).unwrap().predict(&asked).unwrap();
    let first = answer();
    let card = fs::read(path.join("estimator.json")).unwrap();
    let notes = path.join("notes.txt");
    fs::write(&notes, "kept").unwrap();

    let second = Tables::new(24, 1, 1).estimator(&recipe(ridge(), &[0]));
    // A folder in the card's place stops it where a kill just before the card would.
    fs::remove_file(path.join("estimator.json")).unwrap();
    fs::create_dir(path.join("estimator.json")).unwrap();
    second.save(path).unwrap_err();
    fs::remove_dir(path.join("estimator.json")).unwrap();
    fs::write(path.join("estimator.json"), card).unwrap();
    assert_eq!(answer(), first);

    for _ in 0..3 {
        second.save(path).unwrap();
        assert_eq!(answer(), second.predict(&asked).unwrap());
        assert_ne!(answer(), first);
        assert_eq!(names(path).len(), 7, "{:?}", names(path));
    }
    assert!(notes.exists());
}

fn edited(folder: &Path, edit: impl Fn(&mut Value)) -> String {
    let path = folder.join("estimator.json");
    let whole = fs::read(&path).unwrap();
    let mut card: Value = serde_json::from_slice(&whole).unwrap();
    edit(&mut card);
    fs::write(&path, serde_json::to_vec(&card).unwrap()).unwrap();
    let message = refused(folder);
    fs::write(&path, whole).unwrap();
    message
}

#[test]
fn texts_that_no_fit_writes_are_refused() {
    let folder = kept();
    let folder = folder.path();
    for format in [1, 3] {
        let other = edited(folder, |card| card["format"] = json!(format));
        let expected = format!("format {format}, expected 2: another version wrote it");
        assert!(other.contains(&expected), "{other}");
    }
    let outside = edited(folder, |card| {
        card["stages"][0]["groups"][0]["models"]["file"] = json!("../models");
    });
    assert!(outside.contains("file of the folder itself"), "{outside}");
    let kind = edited(folder, |card| {
        card["stages"][0]["groups"][0]["models"]["kind"] = json!("trees");
    });
    assert!(kind.contains("trees"), "{kind}");
    for edit in [
        |card: &mut Value| card["measures"] = json!([]),
        |card: &mut Value| card["measures"][0]["interval"] = json!({"errors": -1.0}),
        |card: &mut Value| card["measures"][0]["several"] = json!([1.0, -1.0]),
        |card: &mut Value| {
            card["measures"][0]["lowest"] = json!(3.0);
            card["measures"][0]["highest"] = json!(2.0);
        },
        |card: &mut Value| card["level"] = json!(1.5),
        |card: &mut Value| card["stages"][0]["views"] = json!(0),
        |card: &mut Value| card["stages"][0]["groups"][0]["slots"] = json!([1]),
        |card: &mut Value| card["stages"][0]["groups"][0]["properties"] = json!([0, 0]),
        |card: &mut Value| card["stages"][0]["groups"][0]["least-errors"] = json!([1.0]),
        |card: &mut Value| card["encoder"]["name"] = json!("resnet"),
        |card: &mut Value| card["encoder"]["resize"] = json!(0),
        |card: &mut Value| card["about"]["frame-size"] = json!([0, 5]),
        |card: &mut Value| card["about"]["angles"] = json!([]),
        |card: &mut Value| card["more"] = json!(1),
    ] {
        edited(folder, edit);
    }
}

/// A model whose files are damaged with their checksums made anew, as whoever means harm would.
#[test]
fn any_damage_is_refused_or_harmless() {
    let folder = kept();
    let folder = folder.path();
    let names = names(folder);
    let whole = |name: &String| fs::read(folder.join(name)).unwrap();
    let wholes: Vec<Vec<u8>> = names.iter().map(whole).collect();
    let card = names.iter().position(|name| name == "estimator.json");
    let card = card.unwrap();
    let asked = [photograph(40, 0)];
    let input = (0..names.len(), Damage::some(), any::<bool>());
    fuzz("artefacts", &input, |(file, damages, in_header)| {
        let whole = &wholes[file];
        let tensors = names[file].ends_with("safetensors");
        let bytes = if tensors && in_header {
            with_header(whole, |header| damaged(header, &damages))
        } else {
            damaged(whole.clone(), &damages)
        };
        fs::write(folder.join(&names[file]), &bytes).unwrap();
        if file != card {
            let mut text: Value = serde_json::from_slice(&wholes[card]).unwrap();
            let sum = blake3::hash(&bytes).to_hex().to_string();
            text["checksums"][&names[file]] = sum.into();
            fs::write(folder.join("estimator.json"), text.to_string()).unwrap();
        }
        if let Ok(model) = Estimator::load(folder) {
            drop(model.predict(&asked));
            drop(model.map(&asked[0], model.stride(), Sight::Within));
            drop(Session::new(&model, 1.0));
        }
        fs::write(folder.join(&names[file]), whole).unwrap();
        fs::write(folder.join("estimator.json"), &wholes[card]).unwrap();
    });
    nested("artefacts", |text| {
        fs::write(folder.join("estimator.json"), text).unwrap();
        assert!(Estimator::load(folder).is_err());
    });
}

#[test]
fn files_of_embeddings() {
    let files = ["oak/1.jpg", "denim/1.jpg", "3.png"];
    let files = files.map(str::to_owned).to_vec();
    let values: Vec<f32> = (0..9).map(|at| at as f32).collect();
    let blocks = vec![block("early", 2), block("late", 1)];
    let several = Precomputed::new(blocks, files.clone(), values.clone()).unwrap();
    let one = Precomputed::new(vec![block("a", 3)], Vec::new(), values.clone()).unwrap();
    let safetensors = vec![several.to_bytes().unwrap(), one.to_bytes().unwrap()];
    let read = |bytes: &[u8]| {
        if let Some(rows) = said(Precomputed::from_bytes(bytes)) {
            said(rows.rows_of(&files));
            assert_eq!(rows.values().len(), rows.rows() * rows.width());
            let again = Precomputed::from_bytes(&rows.to_bytes().unwrap());
            assert_eq!(again.unwrap(), rows);
        }
    };
    fuzz("embeddings", &broken(safetensors), |bytes| read(&bytes));
    let npy = npy(&values, 3);
    fuzz("embeddings as npy", &Damage::some(), |damages| {
        read(&damaged(npy.clone(), &damages));
    });
}
