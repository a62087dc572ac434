use super::*;
use crate::embeddings_of;

#[test]
fn a_plan_that_does_not_fit_the_data_is_refused_by_name() {
    let set = Set::new(20, 2, 4, 2);
    let refused = |change: fn(&mut Plan), expected: &str| {
        let mut plan = set.plan(1);
        change(&mut plan);
        set.refuses(full(), &plan, expected);
    };
    let unknown = "trial p9 of rerun 0: found unknown property, expected one of p0, p1";
    refused(|p| p.trials[1].property = "p9".into(), unknown);
    let unknown = "trial p1 of rerun 7: found no such rerun";
    refused(|p| p.trials[1].rerun = 7, unknown);
    let twice = "p0 of rerun 0 twice";
    refused(|p| p.trials[1] = p.trials[0].clone(), twice);
    let twice = "number 0 twice";
    refused(|p| p.reruns.push(p.reruns[0].clone()), twice);
    let none = "training surfaces of rerun 0: found none";
    refused(|p| p.reruns[0].training.clear(), none);
    let beyond = "index 20, expected below 20";
    refused(|p| p.reruns[0].training.push(20), beyond);
    refused(|p| p.reruns[0].training.push(3), "index 3 twice");
    let two = "found 2 views, expected 1";
    refused(|p| p.trials[0].views = Views::Fixed(vec![0, 1]), two);
    let beyond = "found view 2, expected below 2";
    refused(|p| p.trials[0].views = Views::Fixed(vec![2]), beyond);
}

#[test]
fn views_must_fit_the_input() {
    let set = Set::new(20, 2, 4, 1);
    let mut plan = set.plan(1);
    plan.trials[0].views = Views::Random;
    let refused = |input, plan: &Plan, expected: &str| {
        set.refuses(HeadConfig { input, ..full() }, plan, expected);
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
    let head = Head::new(full()).unwrap();
    let refused = head.train(&set.data(), &set.plan(1), &()).unwrap_err();
    let expected = "no training surface of rerun 0 has a reading of p0";
    assert_eq!(refused.to_string(), expected);
}

#[test]
fn tables_of_different_length_are_refused() {
    let mut set = Set::new(20, 1, 4, 1);
    set.materials.pop();
    let expected = "materials: found 19 surfaces, expected 20";
    set.refuses(full(), &set.plan(1), expected);
}

#[test]
fn tensors_of_embeddings_are_checked() {
    let tensor =
        |values: &[f32], shape: &[usize]| Tensor::from_slice(values, shape, &Device::Cpu).unwrap();
    assert!(embeddings_of(&tensor(&[1.0], &[1])).is_err());
    assert!(embeddings_of(&tensor(&[], &[1, 0])).is_err());
    assert!(embeddings_of(&tensor(&[], &[1, 0, 3])).is_err());
    let nan = tensor(&[1.0, 2.0, f32::NAN, 4.0], &[2, 2]);
    golden::refused(embeddings_of(&nan), "NaN in surface 1");
    let whole = Tensor::zeros((1, 2), candle_core::DType::U8, &Device::Cpu).unwrap();
    assert!(embeddings_of(&whole).is_err());
    let half = Tensor::ones((1, 2), candle_core::DType::F16, &Device::Cpu).unwrap();
    let half = embeddings_of(&half).unwrap();
    assert_eq!(half.get(0, 0), Some(&[1.0, 1.0][..]));
}
