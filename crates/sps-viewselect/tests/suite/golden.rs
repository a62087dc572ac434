//! Against PyTorch (`reinforce` in `fixtures/golden/make_golden.py`).

use safetensors::{Dtype, SafeTensors};
use sps_viewselect::{Policy, Sets};

use crate::uniform::uniform;

const SLOTS: usize = 3;
const VIEWS: usize = 100;
const BATCH: usize = 16;

#[test]
fn reinforce_gradient_matches_autograd() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../fixtures/golden/reinforce.safetensors"
    );
    let bytes = std::fs::read(path).expect("the golden file");
    let tensors = SafeTensors::deserialize(&bytes).expect("a safetensors file");
    let expected = tensors.tensor("grad").expect("the gradient");
    assert_eq!(
        (expected.dtype(), expected.shape()),
        (Dtype::F64, &[SLOTS, VIEWS][..])
    );

    // Inputs go through f32, as the script's `image` has it; q does not.
    let rounded = |value: f64| f64::from(value as f32);
    let logits = uniform("golden/reinforce.z").map(|u| 3.0 * rounded(u));
    let policy = Policy::from_logits(logits.take(SLOTS * VIEWS).collect(), SLOTS, VIEWS, false)
        .expect("finite logits");
    let drawn = uniform("golden/reinforce.q").map(|u| (0.5 * (u + 1.0) * 100.0) as usize);
    let drawn: Vec<usize> = drawn.take(BATCH * SLOTS).collect();
    let stored = tensors.tensor("q").expect("the drawn views");
    let stored = stored.data().chunks_exact(8);
    assert!(
        stored
            .map(|bytes| i64::from_le_bytes(bytes.try_into().expect("eight bytes")))
            .eq(drawn.iter().map(|&view| view as i64))
    );
    let advantages = uniform("golden/reinforce.advantage").map(rounded);
    let advantages: Vec<f64> = advantages.take(BATCH).collect();

    let sets = Sets::new(&drawn, SLOTS).expect("whole sets");
    let gradient = policy
        .reinforce_gradient(sets, &advantages)
        .expect("views that exist");
    let expected = expected.data().chunks_exact(8);
    for (index, (found, bytes)) in gradient.iter().zip(expected).enumerate() {
        let expected = f64::from_le_bytes(bytes.try_into().expect("eight bytes"));
        assert!(
            (found - expected).abs() < 1e-15,
            "{index}: {found} {expected}"
        );
    }
}
