use super::*;
use crate::embeddings_of;

type Change = fn(&mut Plan);

#[test]
fn a_plan_that_does_not_fit_the_data_is_refused_by_name() {
    let set = Set::new(20, 2, 4, 2);
    let cases: [(Change, &str); 9] = [
        (
            |p| p.trials[1].property = "p9".into(),
            "trial p9 of rerun 0: found unknown property, expected one of p0, p1",
        ),
        (
            |p| p.trials[1].rerun = 7,
            "trial p1 of rerun 7: found no such rerun",
        ),
        (|p| p.trials[1] = p.trials[0].clone(), "p0 of rerun 0 twice"),
        (|p| p.reruns.push(p.reruns[0].clone()), "number 0 twice"),
        (
            |p| p.reruns[0].training.clear(),
            "training surfaces of rerun 0: found none",
        ),
        (
            |p| p.reruns[0].training.push(20),
            "index 20, expected below 20",
        ),
        (|p| p.reruns[0].training.push(3), "index 3 twice"),
        (
            |p| p.trials[0].views = Views::Fixed(vec![0, 1]),
            "found 2 views, expected 1",
        ),
        (
            |p| p.trials[0].views = Views::Fixed(vec![2]),
            "found view 2, expected below 2",
        ),
    ];
    for (change, expected) in cases {
        let mut plan = set.plan(1);
        change(&mut plan);
        let message = set.refusal(full(), &plan);
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn views_must_fit_the_input() {
    let set = Set::new(20, 2, 4, 1);
    let mut plan = set.plan(1);
    plan.trials[0].views = Views::Random;
    let refused = |input, plan: &Plan, expected: &str| {
        let message = set.refusal(HeadConfig { input, ..full() }, plan);
        assert!(message.contains(expected), "{message}");
    };
    let three = Input::LateFusion { views: 3 };
    refused(three, &plan, "3 random views, expected at most the 2");
    let pooling = || Input::ViewPooling {};
    refused(pooling(), &plan, "random views for view pooling");
    plan.trials[0].views = Views::Fixed(Vec::new());
    refused(pooling(), &plan, "0 views, expected at least one");
}

#[test]
fn a_property_that_was_never_measured_in_training_is_named() {
    let mut set = Set::new(20, 1, 4, 1);
    set.reread(|s, _| vec![(s == 0).then_some(1.0)]);
    // Surface 0 is kept out of rerun 0.
    let message = set.refusal(full(), &set.plan(1));
    let expected = "no training surface of rerun 0 has a reading of p0";
    assert_eq!(message, expected);
}

#[test]
fn tables_of_different_length_are_refused() {
    let mut set = Set::new(20, 1, 4, 1);
    set.materials.pop();
    let message = set.refusal(full(), &set.plan(1));
    assert!(
        message.contains("materials: found 19 surfaces, expected 20"),
        "{message}"
    );
}

#[test]
fn tensors_of_embeddings_are_checked() {
    let tensor =
        |values: &[f32], shape: &[usize]| Tensor::from_slice(values, shape, &Device::Cpu).unwrap();
    assert!(embeddings_of(&tensor(&[1.0], &[1])).is_err());
    assert!(embeddings_of(&tensor(&[], &[1, 0])).is_err());
    assert!(embeddings_of(&tensor(&[], &[1, 0, 3])).is_err());
    let message = embeddings_of(&tensor(&[1.0, 2.0, f32::NAN, 4.0], &[2, 2])).unwrap_err();
    assert!(
        message.to_string().contains("NaN in surface 1"),
        "{message}"
    );
    let whole = Tensor::zeros((1, 2), candle_core::DType::U8, &Device::Cpu).unwrap();
    assert!(embeddings_of(&whole).is_err());
    let half = Tensor::ones((1, 2), candle_core::DType::F16, &Device::Cpu).unwrap();
    assert_eq!(
        embeddings_of(&half).unwrap().get(0, 0),
        Some(&[1.0, 1.0][..])
    );
}
