//! A trial has the same bits in any stack, on any number of threads, in any part of a plan.

use super::*;

fn assert_same(one: &TrainedHeads, other: &TrainedHeads) {
    assert_eq!(one.heads().len(), other.heads().len());
    for (one, other) in one.heads().iter().zip(other.heads()) {
        assert_eq!(one.trial(), other.trial());
        assert_eq!(bits(one), bits(other), "{:?}", one.trial());
    }
}

/// All configurations whose operators differ.
fn configs() -> Vec<HeadConfig> {
    let mut regression = full();
    regression.model = Model::Regression {};
    let mut clipped = full();
    clipped.clip_norm = Some(0.5);
    // Widths that fill several registers of the product's kernels and leave a rest.
    let mut wide = full();
    cross_modal(&mut wide).latent = 50;
    cross_modal(&mut wide).hidden = 33;
    vec![full(), regression, clipped, wide]
}

#[test]
fn neither_the_stack_nor_the_number_of_threads_changes_a_bit() {
    let set = Set::new(43, 1, 130, 5);
    for config in configs() {
        let plan = set.plan(3);
        // One thread puts all fifteen into as few stacks as possible.
        let together = on_threads(1, || set.train(&config, &plan));
        let alone = plan.trials.iter();
        let alone = TrainedHeads {
            heads: alone.map(|one| set.alone(&config, &plan, one)).collect(),
            ..together.clone()
        };
        assert_same(&together, &alone);
        for threads in [2, 3, 8] {
            let trained = on_threads(threads, || set.train(&config, &plan));
            assert_same(&together, &trained);
        }
    }
}

#[test]
fn what_is_missing_of_a_plan_can_be_trained_later() {
    let set = Set::new(41, 1, 20, 4);
    // 41 surfaces: the first rerun trains on 36, the others on 37.
    let plan = set.plan(3);
    let sizes = plan.reruns.iter().map(|rerun| rerun.training.len());
    assert!(sizes.eq([36, 37, 37]));
    let whole = set.train(&full(), &plan);
    let mut rest = plan.clone();
    rest.trials = rest.trials.into_iter().rev().step_by(3).collect();
    rest.reruns.reverse();
    for rerun in &mut rest.reruns {
        rerun.training.reverse();
    }
    let rest = set.train(&full(), &rest);
    assert_eq!(rest.heads().len(), 4);
    for head in rest.heads() {
        let same = whole.filter(|trial| trial == head.trial());
        assert_eq!(bits(head), bits(&same.heads()[0]));
    }
}

#[test]
fn seed_property_rerun_and_views_each_change_the_result() {
    let mut set = Set::new(30, 2, 10, 2);
    // The two properties and the two reruns are equal in their data.
    set.reread(|_, row| vec![row[0]; 2]);
    let mut plan = set.plan(2);
    plan.reruns[1].training = plan.reruns[0].training.clone();
    let first = set.train(&full(), &plan);
    let mut all: Vec<_> = first.heads().iter().map(bits).collect();
    plan.seed += 1;
    for views in [Views::Fixed(vec![0]), Views::Fixed(vec![1]), Views::Random] {
        plan = plan.with_views(&views);
        all.extend(set.train(&full(), &plan).heads().iter().map(bits));
    }
    let distinct: std::collections::HashSet<_> = all.iter().collect();
    assert_eq!((all.len(), distinct.len()), (16, 16));
}

#[test]
fn a_surface_is_estimated_alike_whichever_surfaces_stand_beside_it() {
    let set = Set::new(71, 1, 130, 2);
    let trained = set.train(&full(), &set.plan(1));
    let all = trained.predict(&set.embeddings).unwrap();
    for surface in [0, 1, 31, 32, 70] {
        let alone = set.embeddings.select(&[surface], &[0]).unwrap();
        for (alone, all) in trained.predict(&alone).unwrap().iter().zip(&all) {
            assert_eq!(alone.values[0].to_bits(), all.values[surface].to_bits());
        }
    }
}

#[test]
fn a_training_ends_where_its_observer_stops_it() {
    let set = Set::new(20, 1, 5, 1);
    let record = Record {
        stops_after: Some(1),
        ..Record::default()
    };
    let head = Head::new(full()).unwrap();
    // Without a stop it would be asked before each of three.
    assert_eq!(full().epochs, 3);
    golden::refused(head.train(&set.data(), &set.plan(1), &record), "stopped");
    assert_eq!(record.asked.into_inner(), 2);
}

#[test]
fn finished_trials_are_reported_once_each() {
    let set = Set::new(20, 1, 5, 5);
    let plan = set.plan(4);
    let record = Record::default();
    let head = Head::new(full()).unwrap();
    let trained = head.train(&set.data(), &plan, &record).unwrap();
    let epochs = trained.heads().iter().map(|head| head.history().len());
    assert_eq!(epochs.sum::<usize>(), plan.trials.len() * full().epochs);
    let mut finished = record.finished.into_inner().unwrap();
    let mut planned = plan.trials.clone();
    let key = |trial: &Trial| (trial.rerun, trial.property.clone());
    finished.sort_by_key(key);
    planned.sort_by_key(key);
    assert_eq!(finished, planned);
}
