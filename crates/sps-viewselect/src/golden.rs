//! Numbers that PyTorch computed, of `fixtures/golden/make_golden.py`, and the rule that fills its inputs.

use safetensors::{Dtype, SafeTensors};

#[path = "../../../fixtures/golden/rule.rs"]
#[allow(dead_code, reason = "how far results are off is told otherwise here")]
mod rule;

pub(crate) use rule::uniform;

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
