use std::collections::HashMap;

use proptest::prelude::*;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};

use super::*;

fn trained() -> (Set, TrainedHeads) {
    let set = Set::new(25, 2, 5, 2);
    let plan = set.plan(2).with_views(&Views::Random);
    let trained = set.train(&full(), &plan);
    (set, trained)
}

/// A tensor in a file.
type Stored = (String, Dtype, Vec<usize>, Vec<u8>);

/// Why the file is refused with one tensor or the metadata changed.
fn with(bytes: &[u8], change: impl FnOnce(&mut Vec<Stored>, &mut String)) -> String {
    let (_, header) = SafeTensors::read_metadata(bytes).unwrap();
    let mut metadata = header.metadata().as_ref().unwrap()["sps-heads"].clone();
    let file = SafeTensors::deserialize(bytes).unwrap();
    let parts = |(name, t): (&str, TensorView<'_>)| {
        let (shape, data) = (t.shape().to_vec(), t.data().to_vec());
        (name.to_owned(), t.dtype(), shape, data)
    };
    let mut tensors: Vec<_> = file.iter().map(parts).collect();
    change(&mut tensors, &mut metadata);
    let views = tensors.iter().map(|(name, dtype, shape, data)| {
        (name, TensorView::new(*dtype, shape.clone(), data).unwrap())
    });
    let metadata = HashMap::from([("sps-heads".to_owned(), metadata)]);
    let changed = safetensors::serialize(views, Some(metadata)).unwrap();
    let refused = TrainedHeads::from_bytes("model.safetensors", &changed);
    refused.unwrap_err().to_string()
}

#[test]
fn a_file_gives_back_the_same_heads() {
    let (set, trained) = trained();
    let bytes = trained.to_bytes().unwrap();
    let back = TrainedHeads::from_bytes("heads.safetensors", &bytes).unwrap();
    assert_eq!(back.config(), trained.config());
    let one = set.embeddings.select(&[3, 4], &[1]).unwrap();
    assert_eq!(back.predict(&one).unwrap(), trained.predict(&one).unwrap());
    for (one, other) in back.heads().iter().zip(trained.heads()) {
        assert_eq!(one.trial(), other.trial());
        assert_eq!(bits(one), bits(other));
    }
    assert_eq!(bytes, back.to_bytes().unwrap());
}

#[test]
fn a_changed_tensor_is_named_with_what_was_found_and_expected() {
    let bytes = trained().1.to_bytes().unwrap();
    let key = "2/generator.output.weight";
    let missing = with(&bytes, |tensors, _| {
        tensors.retain(|(name, ..)| name != key);
    });
    let expected = format!("model.safetensors: tensor {key:?} of shape [5, 1] is missing");
    assert_eq!(missing, expected);
    let changed = |change: fn(&mut Stored), parts: &[&str]| {
        let message = with(&bytes, |tensors, _| {
            change(tensors.iter_mut().find(|(name, ..)| name == key).unwrap());
        });
        let all = parts.iter().all(|part| message.contains(part));
        assert!(all && message.contains(key), "{message}");
    };
    changed(|tensor| tensor.2 = vec![1, 5], &["[1, 5]", "[5, 1]"]);
    changed(|tensor| tensor.1 = Dtype::I32, &["I32"]);
    let nan = |tensor: &mut Stored| tensor.3[4..8].copy_from_slice(&f32::NAN.to_le_bytes());
    changed(nan, &["NaN"]);
    let other = with(&bytes, |tensors, _| {
        tensors.push(("9/visual.weight".into(), Dtype::F32, vec![0], vec![]));
    });
    assert!(other.contains("9/visual.weight"), "{other}");
}

#[test]
fn changed_metadata_are_refused() {
    let bytes = trained().1.to_bytes().unwrap();
    let replace = |from: &str, to: &str| {
        with(&bytes, |_, metadata| {
            assert!(metadata.contains(from), "{from} in {metadata}");
            *metadata = metadata.replace(from, to);
        })
    };
    assert!(replace("\"format\":1", "\"format\":2").contains("format: found 2, expected 1"));
    assert!(replace("\"batch-size\":7", "\"batch-sizes\":7").contains("batch-sizes"));
    assert!(replace("\"batch-size\":7", "\"batch-size\":0").contains("batch-size: found 0"));
    assert!(replace("\"latent\":6", "\"latent\":60").contains("visual.weight"));
    assert!(replace("\"width\":5", "\"width\":18446744073709551615").contains("input.mean"));
    let empty = safetensors::serialize(Vec::<(String, TensorView<'_>)>::new(), None).unwrap();
    golden::refused(TrainedHeads::from_bytes("f", &empty), "no \"sps-heads\"");
}

proptest! {
    #[test]
    fn no_bytes_make_the_reader_panic(mut bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(TrainedHeads::from_bytes("f", &bytes).is_err());
        // Behind a plausible length of the header.
        let length = (bytes.len() as u64).to_le_bytes();
        bytes.splice(..0, length);
        prop_assert!(TrainedHeads::from_bytes("f", &bytes).is_err());
    }
}
