//! The loss of sets of views, and heads over relations between views.

use sps_kernels::simd::Level;
use sps_regress::FittedRegressor;

use super::*;

const VIEWS: usize = 7;
const SLOTS: usize = 3;

fn late_fusion(model: Model) -> HeadConfig {
    HeadConfig {
        input: Input::LateFusion { views: SLOTS },
        model,
        ..full()
    }
}

fn random_plan(set: &Set) -> Plan {
    set.plan(2).with_views(&Views::Random)
}

/// Some sets, several of them sharing their first views, with repeats.
fn sets() -> Vec<[usize; SLOTS]> {
    let draws = uniform("fusion.sets", 40 * SLOTS);
    let view = |x: &f64| ((x + 1.0) / 2.0 * VIEWS as f64) as usize % VIEWS;
    let (draws, _) = draws.as_chunks::<SLOTS>();
    let mut sets: Vec<_> = draws.iter().map(|set| set.each_ref().map(view)).collect();
    sets.extend((0..VIEWS).map(|last| [4, 1, last]));
    sets.push([2, 2, 2]);
    sets
}

/// Mean squared error of the heads' own predictions, in the variance of the training readings.
fn predicted_loss(set: &Set, heads: &TrainedHeads, trial: &Trial, views: &[usize]) -> f64 {
    let plan = set.plan(2);
    let training = &plan.rerun(trial.rerun).unwrap().training;
    let one = heads.filter(|other| other == trial);
    let views = set.embeddings.select(training, views).unwrap();
    let estimates = &one.predict(&views).unwrap()[0].values;
    let column = set.readings.column(&trial.property).unwrap();
    let read = |(&surface, &estimate): (&usize, &f64)| {
        Some((set.readings.get(surface, column)?, estimate))
    };
    let pairs: Vec<_> = training.iter().zip(estimates).filter_map(read).collect();
    let (_, variance) = moments(pairs.iter().map(|(truth, _)| *truth));
    let squares = pairs.iter().map(|(t, e)| (t - e).powi(2));
    squares.sum::<f64>() / pairs.len() as f64 / variance
}

fn losses(loss: &FusionLoss, sets: &[[usize; SLOTS]]) -> Vec<f64> {
    let mut losses = vec![0.0; sets.len()];
    loss.losses(sets.as_flattened(), &mut losses).unwrap();
    losses
}

fn set_with_gaps() -> Set {
    let mut set = Set::new(53, VIEWS, 21, 2);
    set.reread(|surface, row| vec![row[0], row[1].filter(|_| surface % 5 != 2)]);
    set
}

#[test]
fn the_loss_of_a_set_is_that_of_the_plain_prediction() {
    let set = set_with_gaps();
    let plan = random_plan(&set);
    for model in [full().model, Model::Regression {}] {
        let heads = set.train(&late_fusion(model), &plan);
        for trial in &plan.trials {
            let training = &plan.rerun(trial.rerun).unwrap().training;
            Level::on_each(|_| {
                let loss = heads.fusion_loss(trial, &set.data(), training).unwrap();
                assert_eq!((loss.slots(), loss.views()), (SLOTS, VIEWS));
                for (views, found) in sets().iter().zip(losses(&loss, &sets())) {
                    let expected = predicted_loss(&set, &heads, trial, views);
                    let near = (found - expected).abs() < 2e-6 * expected.max(1.0);
                    assert!(near, "{trial:?} {views:?}: {found} {expected}");
                }
            });
        }
    }
}

#[test]
fn a_loss_does_not_depend_on_the_sets_beside_it() {
    let set = set_with_gaps();
    let plan = random_plan(&set);
    let heads = set.train(&late_fusion(full().model), &plan);
    let training = &plan.reruns[0].training;
    let loss = |threads| {
        on_threads(threads, || {
            let (trial, data) = (&plan.trials[1], set.data());
            heads.fusion_loss(trial, &data, training).unwrap()
        })
    };
    let all = sets();
    let together = losses(&loss(1), &all);
    let alone = loss(3);
    for (set, expected) in all.iter().zip(together) {
        assert_eq!(losses(&alone, &[*set]), [expected], "{set:?}");
    }
}

#[test]
fn what_is_no_late_fusion_is_refused() {
    let set = set_with_gaps();
    let plan = random_plan(&set);
    let heads = set.train(&late_fusion(full().model), &plan);
    let (trial, training) = (&plan.trials[0], &plan.reruns[0].training);
    let refused = |heads: &TrainedHeads, trial: &Trial, surfaces: &[usize], part: &str| {
        golden::refused(heads.fusion_loss(trial, &set.data(), surfaces), part);
    };
    let mut other = trial.clone();
    other.rerun = 9;
    refused(&heads, &other, training, "no head");
    refused(&heads, trial, &[53], "53");
    refused(&heads, trial, &[], "no reading");
    let mut fixed = plan.clone();
    fixed.trials[0].views = Views::Fixed(vec![0, 1]);
    fixed.trials.truncate(1);
    let mut pooling = late_fusion(full().model);
    pooling.input = Input::ViewPooling {};
    let pooled = set.train(&pooling, &fixed);
    refused(&pooled, &fixed.trials[0], training, "late fusion");
    let loss = heads.fusion_loss(trial, &set.data(), training).unwrap();
    golden::refused(loss.losses(&[0, 1, VIEWS], &mut [0.0]), "below 7");
    golden::refused(loss.losses(&[0, 1], &mut [0.0]), "3 views per set");
}

fn relations() -> HeadConfig {
    let scales = [(2, 3), (3, 2)].map(|(views, relations)| RelationScale { views, relations });
    HeadConfig {
        input: Input::Relations {
            scales: scales.to_vec(),
        },
        ..full()
    }
}

/// Twelve slots in each of four steps.
fn relation_steps() -> Views {
    let step = |at: usize| (0..12).map(|slot| (at * 5 + slot * 3) % VIEWS).collect();
    Views::Steps((0..4).map(step).collect())
}

#[test]
fn relations_are_a_sum_over_scales_of_means_over_relations() {
    let set = set_with_gaps();
    let plan = set.plan(1).with_views(&relation_steps());
    let heads = set.train(&relations(), &plan);
    // Slots and widths, hidden layers and outputs, each layer as often as it is gone through.
    let width = set.embeddings.width();
    let of_head = 3 * (2 * width * 6 + 6 * 6) + 2 * (3 * width * 6 + 6 * 6) + 6 * 5 + 5;
    let count = heads.heads().len() * of_head;
    assert_eq!(heads.multiply_adds(), count as u64);
    let head = &heads.heads()[0];
    let views = [0, 3, 6, 1, 2, 5, 0, 1, 2, 3, 4, 5];
    let embeddings = set.embeddings.select(&[8], &views).unwrap();
    let found = heads.predict(&embeddings).unwrap()[0].values[0];
    // The formula, written out in f64.
    let parameter = |name: &str| golden::values(head.parameters.get(name).unwrap());
    let layer = |x: &[f64], name: &str| -> Vec<f64> {
        let [w, b] = ["weight", "bias"].map(|part| parameter(&format!("{name}.{part}")));
        let column = |j: usize| {
            let products = x.iter().enumerate().map(|(i, x)| x * w[i * b.len() + j]);
            b[j] + products.sum::<f64>()
        };
        (0..b.len()).map(column).collect()
    };
    let two = |x: &[f64], name: &str| {
        let hidden = layer(x, &format!("{name}.hidden"));
        let hidden: Vec<f64> = hidden.iter().map(|x| x.max(0.0)).collect();
        layer(&hidden, &format!("{name}.output"))
    };
    let scaled = |view: usize| -> Vec<f64> {
        let mut out = Vec::new();
        let features = set.embeddings.get(8, view).unwrap();
        head.statistics.push(features, &mut out);
        out.iter().map(|&x| f64::from(x)).collect()
    };
    let mut latent = vec![0.0; 6];
    for (name, from, size, count) in [("relations.0", 0, 2, 3), ("relations.1", 6, 3, 2)] {
        for group in views[from..from + size * count].chunks(size) {
            let x: Vec<f64> = group.iter().flat_map(|&view| scaled(view)).collect();
            for (sum, term) in latent.iter_mut().zip(two(&x, name)) {
                *sum += term / count as f64;
            }
        }
    }
    let expected = head.target.mean + head.target.std * two(&latent, "generator")[0];
    assert!((found - expected).abs() < 1e-4, "{found} {expected}");
}

#[test]
fn relations_learn_from_the_views_of_their_steps() {
    let set = set_with_gaps();
    let mut plan = set.plan(1);
    plan.trials.truncate(1);
    let mut train = |views: Views| {
        plan.trials[0].views = views;
        bits(&set.train(&relations(), &plan).heads()[0])
    };
    let Views::Steps(steps) = relation_steps() else {
        panic!("not steps")
    };
    let all = train(Views::Steps(steps.clone()));
    let twice = [steps.clone(), steps.clone()].concat();
    assert_eq!(all, train(Views::Steps(twice)));
    let mut other = steps.clone();
    other[3][11] = (other[3][11] + 1) % VIEWS;
    assert_ne!(all, train(Views::Steps(other)));
}

#[test]
fn relations_refuse_what_they_cannot_relate() {
    let set = set_with_gaps();
    for (views, expected) in [
        (Views::Random, "random ones"),
        (Views::Steps(vec![]), "no step"),
        (Views::Steps(vec![vec![0; 12], vec![0; 11]]), "11 views"),
        (Views::Steps(vec![vec![VIEWS; 12]]), "below 7"),
    ] {
        let mut plan = set.plan(1);
        plan.trials[0].views = views;
        plan.trials.truncate(1);
        set.refuses(relations(), &plan, expected);
    }
    let mut regression = relations();
    regression.model = Model::Regression {};
    golden::refused(Head::new(regression), "cross-modal");
}
