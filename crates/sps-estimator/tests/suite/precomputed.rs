//! Embeddings that were computed elsewhere: their files, and models that are fitted on them.

use std::sync::Arc;

use crate::support::{
    Tables, block, embedder, npy, photograph, read_again, recipe, refused, ridge,
};
use sps_estimator::{Embedder, Estimator, Network, Precomputed};

/// `safetensors.numpy.save({"late": [[5], [6]], "early": [[1, 2], [3, 4]]}, {"files": '["a/1.jpg", "a/2.jpg"]'})`
/// of numpy's f32, but for blanks at the header's end.
fn safetensors() -> Vec<u8> {
    let header = r#"{"__metadata__":{"files":"[\"a/1.jpg\", \"a/2.jpg\"]"},"early":{"dtype":"F32","shape":[2,2],"data_offsets":[0,16]},"late":{"dtype":"F32","shape":[2,1],"data_offsets":[16,24]}}"#;
    let values = [1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0];
    let values = values.iter().flat_map(|value| value.to_le_bytes());
    let length = (header.len() as u64).to_le_bytes().into_iter();
    length.chain(header.bytes()).chain(values).collect()
}

fn texts(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

#[test]
fn files_of_python_are_read() {
    let read = |bytes: &[u8]| {
        let rows = Precomputed::from_bytes(bytes).unwrap();
        let again = Precomputed::from_bytes(&rows.to_bytes().unwrap()).unwrap();
        assert_eq!(again, rows);
        rows
    };
    let rows = read(&safetensors());
    assert_eq!(rows.blocks(), [block("early", 2), block("late", 1)]);
    assert_eq!(rows.values(), [1.0, 2.0, 5.0, 3.0, 4.0, 6.0]);
    assert_eq!(rows.files(), ["a/1.jpg", "a/2.jpg"]);

    let values = [1.0, -2.5, 0.5, 4.0];
    let rows = read(&npy(&values, 2));
    assert_eq!(rows.blocks(), [block("embeddings", 2)]);
    assert_eq!(rows.values(), values);
}

#[test]
fn rows_are_found_by_the_ends_of_paths() {
    let files = texts(&["/data/oak/1.jpg", "/data/1.jpg", "/data/denim/1.png"]);
    let rows = Precomputed::new(vec![block("a", 1)], files, vec![1.0, 2.0, 3.0]).unwrap();
    let found = |names: &[&str]| rows.rows_of(&texts(names));
    let turned = found(&["denim/1.png", "1.jpg", "oak/1.jpg"]);
    assert_eq!(turned.unwrap(), [3.0, 2.0, 1.0]);
    assert_eq!(found(&["denim/1", "oak/1"]).unwrap(), [3.0, 1.0]);
    let missing = found(&["oak/1.jpg", "oak/2.jpg"]);
    refused(missing, "a row of oak/2.jpg: found none");
    let two = "rows of 1.jpg: found two, the second as /data/1.jpg";
    refused(found(&["1.jpg"]), two);

    let unnamed = Precomputed::new(vec![block("a", 1)], Vec::new(), vec![1.0, 2.0]).unwrap();
    assert_eq!(unnamed.rows_of(&texts(&["b", "a"])).unwrap(), [1.0, 2.0]);
    let fewer = unnamed.rows_of(&texts(&["b"]));
    refused(fewer, "found 2, expected 1, one for each photograph");
}

#[test]
fn what_makes_no_rows_is_refused() {
    let said = |bytes: &[u8], part| refused(Precomputed::from_bytes(bytes), part);
    said(b"", "not a safetensors file");
    let changed = |from: &str, to: &str| {
        let bytes = safetensors();
        let mut parts = bytes.windows(from.len());
        let at = parts.position(|part| part == from.as_bytes()).unwrap();
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    let late = "the tensor late: found [2, 1], expected (4, width)";
    said(&changed("[2,2]", "[4,1]"), late);
    let fewer = changed(r#"[\"a/1.jpg\", "#, r"[             ");
    said(&fewer, "files: found 1, expected 2");
    let no_list = changed(r#"[\"a/1.jpg\""#, r#"{\"a/1.jpg\""#);
    said(&no_list, "a JSON list of texts");
    let mut one = npy(&[0.0; 4], 2);
    let shape = one.windows(6).position(|part| part == b"(2, 2)").unwrap();
    one[shape..shape + 6].copy_from_slice(b"(4,)  ");
    said(&one, "found shape [4], expected (rows, width)");
    let nan = Precomputed::new(vec![block("a", 1)], Vec::new(), vec![f32::NAN]);
    refused(nan, "finite");
}

/// A model that takes embeddings answers them as one with the encoder answers the photographs.
#[test]
fn a_model_asks_for_embeddings() {
    let tables = Tables::new(40, 1, 1);
    let seeing = tables.estimator(&recipe(ridge(), &[0]));
    let blocks = embedder().network().blocks();
    let rows = Precomputed::new(blocks, Vec::new(), Vec::new()).unwrap();
    let blind = Embedder::new(Network::Precomputed(Arc::new(rows)), None).unwrap();
    let fitted = tables.fit(&recipe(ridge(), &[0])).unwrap();
    let about = seeing.about().clone();
    let blind = read_again(&Estimator::new(blind, fitted, about).unwrap());
    let asked = [photograph(97, 0)];
    let values = embedder().embed(&asked).unwrap();
    let answer = blind.predict_embedded(&values, 1).unwrap();
    assert_eq!(answer, seeing.predict(&asked).unwrap());
    let images = "photographs: found images, expected their embeddings";
    refused(blind.predict(&asked), images);
}
