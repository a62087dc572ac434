//! Numbers that PyTorch computed, of `fixtures/golden/make_golden.py`.

use safetensors::{Dtype, SafeTensors};

/// The numbers of a tensor of a file, of a type of eight bytes each, and of this shape.
pub(crate) fn golden(file: &str, tensor: &str, dtype: Dtype, shape: &[usize]) -> Vec<[u8; 8]> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/golden");
    let bytes = std::fs::read(format!("{folder}/{file}.safetensors")).expect("the golden file");
    let tensors = SafeTensors::deserialize(&bytes).expect("a safetensors file");
    let tensor = tensors.tensor(tensor).expect("a tensor");
    assert_eq!((tensor.dtype(), tensor.shape()), (dtype, shape));
    let (numbers, _) = tensor.data().as_chunks::<8>();
    numbers.to_vec()
}
