//! Early stopping: which epoch is kept, what falls back to the mean, and what a plan must hold.

use super::*;

/// Every sixth training surface held out for validation.
fn with_validation(mut plan: Plan) -> Plan {
    for rerun in &mut plan.reruns {
        let (validation, training) = rerun.training.iter().partition(|&&s| s % 6 == 1);
        (rerun.training, rerun.validation) = (training, validation);
    }
    plan
}

/// Steps so long that some trials are best after a few epochs.
fn stopping(patience: usize) -> HeadConfig {
    let mut config = full();
    config.epochs = 8;
    config.adam.learning_rate = 2e-2;
    config.early_stopping = Some(EarlyStopping {
        patience,
        ..EarlyStopping::default()
    });
    config
}

fn kept(head: &TrainedHead) -> &KeptEpoch {
    head.kept_epoch().unwrap()
}

/// The epoch kept is the one of least error, found by training for one epoch, for two, and so on
/// without early stopping, and estimating the validation part from outside.
#[test]
fn the_weights_are_those_of_the_epoch_that_is_best_on_the_validation_part() {
    let set = Set::new(60, 1, 9, 4);
    let plan = with_validation(set.plan(2));
    let stopped = set.train(&stopping(0), &plan);
    let mut errors: Vec<Vec<f64>> = vec![Vec::new(); plan.trials.len()];
    let mut by_epochs = Vec::new();
    for epochs in 1..=8 {
        let config = HeadConfig {
            early_stopping: None,
            epochs,
            ..stopping(0)
        };
        let trained = set.train(&config, &plan);
        let estimates = trained.predict(&set.embeddings).unwrap();
        for ((trial, estimates), errors) in plan.trials.iter().zip(estimates).zip(&mut errors) {
            let rerun = plan.rerun(trial.rerun).unwrap();
            let (mean, variance) = moments(rerun.training.iter().map(|&s| reading(&set, trial, s)));
            let error = |estimate: &dyn Fn(usize) -> f64| {
                let square = |&s: &usize| (estimate(s) - reading(&set, trial, s)).powi(2);
                let squares: f64 = rerun.validation.iter().map(square).sum();
                squares / rerun.validation.len() as f64 / variance
            };
            if errors.is_empty() {
                errors.push(error(&|_| mean));
            }
            errors.push(error(&|s| estimates.values[s]));
        }
        by_epochs.push(trained);
    }
    let mut epochs = Vec::new();
    for ((head, errors), at) in stopped.heads().iter().zip(errors).zip(0..) {
        let found = kept(head);
        let off = found.errors.iter().zip(&errors);
        let near = off.clone().all(|(f, e)| (f / e - 1.0).abs() < 1e-5);
        assert!(near, "{off:?}");
        let best = (0..errors.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b]));
        assert_eq!(Some(found.epoch), best);
        assert_eq!(head.history().len(), 8);
        if found.epoch > 0 {
            let there = &by_epochs[found.epoch - 1].heads()[at];
            let bits = |head| -> Vec<u64> { weights(head).into_iter().map(f64::to_bits).collect() };
            assert_eq!(bits(head), bits(there));
        }
        epochs.push(found.epoch);
    }
    epochs.sort_unstable();
    epochs.dedup();
    assert!(epochs.len() > 1, "trials differ: {epochs:?}");
}

fn reading(set: &Set, trial: &Trial, surface: usize) -> f64 {
    let column = set.readings.column(&trial.property).unwrap();
    set.readings.get(surface, column).unwrap()
}

/// Readings that have nothing to do with the images, learnt by heart: the estimate is the training
/// mean, to rounding, and the same for every surface.
#[test]
fn what_cannot_be_seen_falls_back_to_the_training_mean() {
    let mut set = Set::new(60, 1, 30, 1);
    let noise = uniform("heads.unseen", 60);
    set.reread(|s, _| vec![Some(50.0 + 10.0 * noise[s])]);
    let plan = with_validation(set.plan(1));
    let mut config = stopping(0);
    config.batch_size = 8;
    config.adam.learning_rate = 0.2;
    config.adam.weight_decay = 0.0;
    let trained = set.train(&config, &plan);
    let found = kept(&trained.heads()[0]);
    let mut later = found.errors[1..].iter();
    assert!(later.all(|error| *error > found.errors[0]));
    assert_eq!(found.epoch, 0);
    let training = plan.reruns[0].training.iter();
    let (mean, _) = moments(training.map(|&s| reading(&set, &plan.trials[0], s)));
    for value in &trained.predict(&set.embeddings).unwrap()[0].values {
        assert!((value - mean).abs() < 1e-12, "{value} {mean}");
    }
}

/// A file tells which epoch was kept.
#[test]
fn patience_ends_a_trial_after_so_many_epochs_without_a_better_one() {
    let set = Set::new(60, 1, 9, 5);
    let plan = with_validation(set.plan(2));
    let all = set.train(&stopping(0), &plan);
    for patience in [1, 2] {
        let mut early = 0;
        let stopped = set.train(&stopping(patience), &plan).to_bytes();
        let stopped = TrainedHeads::from_bytes("f", &stopped.unwrap()).unwrap();
        for (head, all) in stopped.heads().iter().zip(all.heads()) {
            let (found, whole) = (kept(head), kept(all));
            let run = found.errors.len() - 1;
            assert_eq!(found.errors[..], whole.errors[..=run]);
            assert_eq!(head.history(), &all.history()[..run]);
            assert!(run == 8 || run == found.epoch + patience);
            early += usize::from(run < 8);
        }
        assert!(early > 0, "no trial ends early");
    }
}

/// Trials that end at different epochs, in one stack, each in a stack of its own, on one thread
/// and on several; the views fixed and drawn.
#[test]
fn a_trial_stops_alike_in_any_company() {
    let set = Set::new(60, 3, 9, 5);
    for random in [false, true] {
        let mut plan = with_validation(set.plan(2));
        if random {
            plan = plan.with_views(&Views::Random);
        }
        let mut config = stopping(2);
        config.adam.weight_decay = 0.5;
        let together = on_threads(1, || set.train(&config, &plan));
        let threads = on_threads(3, || set.train(&config, &plan));
        let heads = together.heads().iter().zip(threads.heads());
        for (trial, (head, other)) in plan.trials.iter().zip(heads) {
            let alone = set.alone(&config, &plan, trial);
            for other in [&alone, other] {
                assert_eq!(bits(head), bits(other), "{trial:?}");
                assert_eq!(head.kept_epoch(), other.kept_epoch());
            }
        }
    }
}

#[test]
fn validation_surfaces_are_not_trained_on_and_ignored_without_early_stopping() {
    let set = Set::new(40, 1, 9, 2);
    let plan = with_validation(set.plan(1));
    let mut without = plan.clone();
    without.reruns[0].validation.clear();
    let (one, other) = (set.train(&full(), &plan), set.train(&full(), &without));
    for (one, other) in one.heads().iter().zip(other.heads()) {
        assert_eq!(bits(one), bits(other));
        assert_eq!(one.kept_epoch(), None);
    }
}

#[test]
fn a_plan_without_a_validation_part_that_fits_is_refused_by_name() {
    let mut set = Set::new(40, 1, 9, 2);
    let refused = |set: &Set, change: fn(&mut Rerun), expected: &str| {
        let mut plan = with_validation(set.plan(1));
        change(&mut plan.reruns[0]);
        set.refuses(stopping(0), &plan, expected);
    };
    let none = "validation surfaces of rerun 0: found none with a reading of p0";
    refused(&set, |rerun| rerun.validation.clear(), none);
    let outside = "validation surfaces of rerun 0: found index 40, expected below 40";
    refused(&set, |rerun| rerun.validation.push(40), outside);
    let twice = "validation surfaces of rerun 0: found index 2 twice";
    refused(&set, |rerun| rerun.validation.push(2), twice);
    set.reread(|s, row| vec![row[0], row[1].filter(|_| s % 6 != 1)]);
    refused(&set, |_| (), "none with a reading of p1");
}

/// A validation surface whose estimate is no number: no epoch is better than the mean, and the file
/// can be read.
#[test]
fn an_error_that_is_not_finite_is_worse_than_any() {
    let mut set = Set::new(40, 1, 9, 1);
    let mut seen = set.embeddings.values().to_vec();
    seen[9..18].fill(f32::MAX);
    set.embeddings = Embeddings::new(seen, [40, 1, 9]).unwrap();
    let mut config = stopping(0);
    config.model = Model::Regression {};
    let trained = set.train(&config, &with_validation(set.plan(1)));
    let back = TrainedHeads::from_bytes("f", &trained.to_bytes().unwrap()).unwrap();
    let found = kept(&back.heads()[0]);
    assert_eq!(found, kept(&trained.heads()[0]));
    assert_eq!(found.epoch, 0);
    assert_eq!(found.errors[1..], [f64::MAX; 8]);
}
