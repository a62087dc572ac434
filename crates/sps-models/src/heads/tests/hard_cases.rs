//! The losses' hard cases; those of single operators are beside the operators.

use candle_core::{DType, Var};

use super::super::losses::{discriminator_loss, embedding_distance, generator_loss};
use super::*;
use crate::golden::{error, values};
use crate::optim::{Adam, AdamConfig};

fn tensor(value: &[f64], shape: &[usize]) -> Tensor {
    Tensor::from_slice(value, shape, &Device::Cpu).unwrap()
}

/// Both sides of the game on one pair at each logit: values and slopes by hand. By way of the
/// probability, `log(1 - D)` at 1e4 is `log(0)`.
#[test]
fn adversarial_losses_at_logits_of_ten_thousand() {
    let weight = tensor(&[1.0], &[1, 1]);
    let zero = tensor(&[0.0], &[1, 1, 1]);
    for (z, generator, real, fake) in [
        (1e4, (-1e4, -1.0), (0.0, 0.0), (1e4, 1.0)),
        (-1e4, (0.0, 0.0), (1e4, -1.0), (0.0, 0.0)),
    ] {
        let at = |loss: &dyn Fn(&Tensor) -> Tensor| {
            let z = Var::from_tensor(&tensor(&[z], &[1, 1])).unwrap();
            let loss = loss(z.as_tensor());
            let gradients = loss.sum_all().unwrap().backward().unwrap();
            (values(&loss)[0], values(gradients.get(&z).unwrap())[0])
        };
        let middle = tensor(&[0.0], &[1, 1]);
        let ln2 = std::f64::consts::LN_2;
        let found = at(&|z| generator_loss(z, &zero, &weight).unwrap());
        assert_eq!(found, generator);
        let (value, slope) = at(&|z| discriminator_loss(z, &middle, &weight).unwrap());
        assert_eq!((value, slope), (real.0 + ln2, real.1));
        let (value, slope) = at(&|z| discriminator_loss(&middle, z, &weight).unwrap());
        assert_eq!((value, slope), (fake.0 + ln2, fake.1));
    }
    let naive = (1.0 - 1.0 / (1.0 + (-1e4_f64).exp())).ln();
    assert!(naive.is_infinite(), "the naive form");
}

/// A generator that faces a discriminator stuck at a logit of -+1e4 for a hundred steps of Adam.
/// With the discriminator sure that all is real, the slope is -1 in every step, so the logit's input
/// moves by the learning rate each time; sure that all is false, the loss has saturated, and the
/// generator stays with the norm alone.
#[test]
fn a_discriminator_saturated_either_way_for_a_hundred_steps() {
    let weight = tensor(&[1.0], &[1, 1]);
    let rate = AdamConfig::default().learning_rate;
    let trained = |loss: &dyn Fn(&Tensor) -> Tensor| {
        let x = Var::from_tensor(&tensor(&[0.5], &[1, 1, 1])).unwrap();
        let mut adam = Adam::new(AdamConfig::default(), [x.clone()]).unwrap();
        for _ in 0..100 {
            let loss = loss(x.as_tensor()).sum_all().unwrap();
            let gradient = loss.backward().unwrap().get(&x).unwrap().clone();
            adam.step(&[gradient], &[]).unwrap();
        }
        values(&x)[0]
    };
    for (bias, moves) in [(-1e4, 0.0), (1e4, 1.0)] {
        let faced = |x: &Tensor| (x.squeeze(2).unwrap() + bias).unwrap();
        let found = trained(&|x| {
            // The estimate is exact: the norm's gradient is zero, not 0 / 0.
            let error = (x - &x.detach()).unwrap();
            generator_loss(&faced(x), &error, &weight).unwrap()
        });
        let naive = trained(&|x| {
            let real = candle_nn::ops::sigmoid(&faced(x)).unwrap();
            (1.0 - real).unwrap().log().unwrap()
        });
        let expected = 0.5 + 100.0 * rate * moves;
        let off = (found - expected).abs();
        println!("logit {bias:e}: error {off:.1e}, bound 1e-9, naive form {naive}");
        assert!(off < 1e-9);
        // By way of the probability: no number where there is most to learn.
        assert_eq!(naive.is_nan(), moves > 0.0, "the naive form");
    }
}

/// Coinciding embeddings: no distance and no gradient, in f32, at any magnitude.
#[test]
fn embedding_pairs_that_coincide() {
    let weight = tensor(&[0.5, 0.5], &[1, 2]).to_dtype(DType::F32).unwrap();
    for scale in [1.0, 1e-30, 1e15, 1e25] {
        let pair = tensor(&[scale, -scale, 0.0, 2.0 * scale], &[1, 2, 2]);
        let pair = Var::from_tensor(&pair.to_dtype(DType::F32).unwrap()).unwrap();
        let loss = embedding_distance(&pair, &pair.as_detached_tensor(), &weight).unwrap();
        let gradients = loss.sum_all().unwrap().backward().unwrap();
        assert_eq!(values(&loss), [0.0]);
        assert_eq!(values(gradients.get(&pair).unwrap()), [0.0; 4]);
    }
    // As a root of squares, and multiplied out where the squares leave f32.
    let pair = Var::from_tensor(&tensor(&[1.0, 2.0], &[1, 1, 2])).unwrap();
    let squares = (pair.as_tensor() - &pair.as_detached_tensor()).unwrap();
    let root = squares.sqr().unwrap().sum_all().unwrap().sqrt().unwrap();
    let gradients = root.backward().unwrap();
    let naive = values(gradients.get(&pair).unwrap())[0];
    assert!(naive.is_nan(), "the naive form");
    let square = 1e25_f32 * 1e25;
    assert!((square + square - 2.0 * square).is_nan(), "the naive form");
}

/// Readings that are all equal: every estimate is that reading, to the bit. Divided by their
/// spread they would be rounding over rounding.
#[test]
fn targets_that_are_all_equal() {
    let mut set = Set::new(30, 1, 5, 1);
    set.reread(|_, _| vec![Some(0.1)]);
    let trained = set.train(&full(), &set.plan(1));
    let mean = (0..27).map(|_| 0.1).sum::<f64>() / 27.0;
    for value in &trained.predict(&set.embeddings).unwrap()[0].values {
        assert_eq!(*value, mean);
    }
    assert!((mean - 0.1).abs() < 1e-15);
    // Over a spread that is rounding, the target would be a standard deviation and not zero.
    let spread = ((0..27).map(|_| (0.1 - mean).powi(2)).sum::<f64>() / 27.0).sqrt();
    let naive = (0.1 - mean) / spread;
    println!("targets all equal: error 0, bound 0, naive form {naive:.1e}");
    assert!(naive.abs() > 0.9, "the naive form");
}

/// Embeddings that are all equal in training carry nothing, whatever comes later.
#[test]
fn embeddings_that_are_all_equal() {
    let mut set = Set::new(30, 1, 5, 1);
    let same = Embeddings::new(vec![0.1; 150], [30, 1, 5]).unwrap();
    let trained_on = std::mem::replace(&mut set.embeddings, same);
    for scale in [Scale::Common, Scale::PerFeature] {
        let mut config = full();
        config.scale = scale;
        let trained = set.train(&config, &set.plan(1));
        let estimates = trained.predict(&trained_on).unwrap();
        let first = estimates[0].values[0];
        assert!(first.is_finite());
        assert!(estimates[0].values.iter().all(|&value| value == first));
    }
}

/// A class that no training surface belongs to: its logit is pushed down by its own probability,
/// `sum_i p_i / n`, and nothing is divided by its count.
#[test]
fn a_class_without_a_member() {
    let logits = Var::from_tensor(&tensor(&[0.0, 0.0, 9.0, 1.0, -1.0, 0.0], &[1, 2, 3])).unwrap();
    let labels = vec![Some(0), Some(1)];
    let loss = crate::stacked::cross_entropy(&logits, labels).unwrap();
    let gradients = loss.mean_all().unwrap().backward().unwrap();
    let found = values(gradients.get(&logits).unwrap());
    let probability = |row: [f64; 3]| row[2].exp() / row.iter().map(|z| z.exp()).sum::<f64>();
    let expected = [[0.0, 0.0, 9.0], [1.0, -1.0, 0.0]].map(|row| probability(row) / 2.0);
    let off = error(&[found[2], found[5]], &expected);
    // The mean of the class's own rows, of which there are none.
    let own: [f64; 0] = [];
    let naive = own.iter().sum::<f64>() / own.len() as f64;
    println!("class without a member: error {off:.1e}, bound 1e-15, naive form {naive}");
    assert!(off < 1e-15);
    assert!(naive.is_nan(), "the naive form");

    // In training: the material of the surfaces kept out.
    let mut set = Set::new(20, 1, 4, 1);
    let material = |s| if s % 10 == 0 { "out" } else { "in" }.to_owned();
    set.materials = (0..20).map(material).collect();
    let mut config = full();
    cross_modal(&mut config).classification = Some(Classification::new(LabelSource::Material {}));
    let trained = set.train(&config, &set.plan(1));
    assert_eq!(trained.heads()[0].dims.classes, 2);
    let last = trained.heads()[0].history().last().unwrap();
    assert!(last.classification.is_finite() && last.classification > 0.0);
}

/// A batch in which a property was never measured changes nothing but by Adam's momentum: with
/// none, the parameters keep every bit. A mean over no rows would be 0 / 0.
#[test]
fn a_batch_without_a_reading() {
    let mut set = Set::new(30, 1, 4, 1);
    set.reread(|s, row| vec![row[0].filter(|_| s == 5)]);
    let mut config = full();
    config.batch_size = 1;
    cross_modal(&mut config).classification = None;
    let trained = set.train(&config, &set.plan(1));
    let estimates = trained.predict(&set.embeddings).unwrap();
    assert!(estimates[0].values.iter().all(|v| v.is_finite()));
    assert_eq!(Some(estimates[0].values[5]), set.readings.get(5, 0));
}

/// A loss weight of 1e30 makes gradients of norm 1e30. Clipped, the network takes the steps that
/// it takes for 1e10, where no square overflows. Unclipped, Adam's mean square is infinite in f32,
/// and the parameter never moves again.
#[test]
fn a_network_under_a_gradient_norm_of_1e30() {
    let set = Set::new(30, 1, 4, 2);
    let train = |weight, clip_norm, epochs| {
        let mut config = full();
        config.epochs = epochs;
        config.clip_norm = clip_norm;
        config.adam.weight_decay = 0.0;
        cross_modal(&mut config).embedding_weight = weight;
        cross_modal(&mut config).adversarial = None;
        let trained = set.train(&config, &set.plan(1));
        values(trained.heads()[1].parameters.get("visual.weight").unwrap())
    };
    let huge = train(1e30, Some(1.0), 3);
    assert!(error(&huge, &train(1e10, Some(1.0), 3)) < 1e-5);
    assert_ne!(huge, train(1e30, Some(1.0), 2));
    assert_eq!(train(1e30, None, 3), train(1e30, None, 2), "the naive form");
}

#[test]
fn clipping_changes_long_gradients_alone() {
    let set = Set::new(30, 1, 4, 2);
    let train = |clip_norm| {
        let config = HeadConfig {
            clip_norm,
            ..full()
        };
        let heads = set.train(&config, &set.plan(1)).heads;
        heads.iter().map(bits).collect::<Vec<_>>()
    };
    assert_eq!(train(None), train(Some(1e6)));
    assert_ne!(train(None), train(Some(1e-3)));
}

#[test]
fn no_surfaces_have_no_estimates() {
    let set = Set::new(10, 1, 4, 1);
    let trained = set.train(&full(), &set.plan(1));
    let none = set.embeddings.select(&[], &[0]).unwrap();
    assert!(trained.predict(&none).unwrap()[0].values.is_empty());
}
