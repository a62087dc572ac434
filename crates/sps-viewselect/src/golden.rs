//! Numbers that PyTorch computed, of `fixtures/golden/make_golden.py`.

use safetensors::SafeTensors;

/// The numbers of a tensor of a file, eight bytes each.
pub(crate) fn golden(file: &str, tensor: &str) -> impl Iterator<Item = [u8; 8]> + use<> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/golden");
    let bytes = std::fs::read(format!("{folder}/{file}.safetensors")).expect("the golden file");
    let tensors = SafeTensors::deserialize(&bytes).expect("a safetensors file");
    let numbers = tensors.tensor(tensor).expect("a tensor").data().to_vec();
    assert!(numbers.len().is_multiple_of(8));
    (0..numbers.len() / 8).map(move |i| std::array::from_fn(|byte| numbers[8 * i + byte]))
}
