//! Whatever bytes a reader of weights is given, it answers within its limits; `fixtures/fuzz` says which.

#[path = "../../../fixtures/fuzz/mod.rs"]
mod fuzz;

use std::path::Path;

use fuzz::{Damage, broken, damaged, fuzz, nested, said};
use proptest::sample::select;
use sps_weights::{RawTensor, Storage, read};

fn read_weights(bytes: &[u8]) {
    let Some(tensors) = said(read(bytes)) else {
        return;
    };
    for (name, tensor) in &tensors {
        assert!(tensor.values.iter().all(|v| v.is_finite()), "{name}");
    }
    let named = tensors.iter();
    let named = named.map(|(name, tensor)| (&name[..], tensor.clone()));
    let again = sps_weights::write(named, Storage::F32, None).unwrap();
    assert_eq!(read(&again).unwrap().len(), tensors.len());
}

#[test]
fn safetensors() {
    let shapes: [&[usize]; 4] = [&[], &[3], &[2, 0, 5], &[4, 3, 2, 1]];
    let names = ["a", "b.weight", "c", "d.bias"];
    let tensor = |shape: &[usize]| RawTensor {
        shape: shape.to_vec(),
        values: vec![0.5; shape.iter().product()],
    };
    let write = |storage, note| {
        let tensors = names.into_iter().zip(shapes.map(tensor));
        sps_weights::write(tensors, storage, note).unwrap()
    };
    let files = vec![
        write(Storage::F32, None),
        write(Storage::F16, Some(("note", "a text of 12 words"))),
    ];
    fuzz("safetensors", &broken(files), |bytes| {
        read_weights(&bytes);
        said(sps_weights::note(&bytes, "note"));
    });
}

#[test]
fn pytorch() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/pytorch");
    let files = ["zip", "stream", "mapping"]
        .map(|name| std::fs::read(folder.join(format!("{name}.pth"))).unwrap());
    let input = (select(files.to_vec()), Damage::some());
    fuzz("pth", &input, |(file, damages)| {
        read_weights(&damaged(file, &damages));
    });
}

/// The file with its pickle damaged, and the archive's sizes told anew: past what an archive's own
/// directory would catch.
#[test]
fn pytorch_pickles() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/pytorch");
    let bytes = std::fs::read(folder.join("zip.pth")).unwrap();
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(bytes)).unwrap();
    let count = archive.len();
    let file = |index| {
        let mut file = archive.by_index(index).unwrap();
        let name = file.name().unwrap().into_owned();
        let mut content = Vec::new();
        std::io::Read::read_to_end(&mut file, &mut content).unwrap();
        (name, content)
    };
    let files: Vec<(String, Vec<u8>)> = (0..count).map(file).collect();
    fuzz("pickle of a pth", &Damage::some(), |damages| {
        let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        let stored = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored);
        for (name, content) in &files {
            writer.start_file(name.as_str(), stored).unwrap();
            let content = if name.ends_with("data.pkl") {
                damaged(content.clone(), &damages)
            } else {
                content.clone()
            };
            std::io::Write::write_all(&mut writer, &content).unwrap();
        }
        read_weights(&writer.finish().unwrap().into_inner());
    });
}

/// Headers that nest.
#[test]
fn headers_that_nest() {
    nested("headers", |text| {
        let length = (text.len() as u64).to_le_bytes();
        read_weights(&[&length[..], text.as_bytes()].concat());
    });
}
