//! A trial that diverges is told, and takes nothing from the others.

use super::*;

/// Trains the plan in one stack, expects the trial `lost` alone to diverge for a reason with
/// `expected` in it, and each other to be what it is when trained alone.
fn others_go_on(set: &Set, config: &HeadConfig, plan: &Plan, lost: &Trial, expected: &str) {
    let head = Head::new(config.clone()).unwrap();
    let record = Record::default();
    let trained = on_threads(1, || head.train(&set.data(), plan, &record).unwrap());
    let [diverged] = trained.diverged() else {
        panic!("{:?}", trained.diverged())
    };
    assert_eq!(&diverged.trial, lost);
    assert!(diverged.reason.contains(expected), "{}", diverged.reason);
    assert_eq!(record.diverged.into_inner().unwrap(), trained.diverged());
    let others: Vec<_> = plan.trials.iter().filter(|trial| *trial != lost).collect();
    assert_eq!(trained.heads().len(), others.len());
    for (head, &trial) in trained.heads().iter().zip(&others) {
        assert_eq!(head.trial(), trial);
        assert_eq!(bits(head), bits(&set.alone(config, plan, trial)));
    }
    let back = TrainedHeads::from_bytes("f", &trained.to_bytes().unwrap()).unwrap();
    assert_eq!(back.diverged(), trained.diverged());
    let models: &dyn sps_regress::FittedRegressor = &back;
    assert_eq!(models.diverged(), trained.diverged());
    assert!(trained.filter(|trial| trial != lost).diverged().is_empty());
}

/// Pixels gone wrong in one view, whose trial stands in one stack with those of another view.
#[test]
fn an_absurd_view_takes_nothing_from_another() {
    let mut set = Set::new(40, 2, 9, 2);
    let views = (0..40).flat_map(|s| [(s, 0, 1.0), (s, 1, 1e25)]);
    let values = views.flat_map(|(s, view, factor)| {
        let row = set.embeddings.get(s, view).unwrap();
        row.iter().map(move |x| x * factor)
    });
    set.embeddings = Embeddings::new(values.collect(), [40, 2, 9]).unwrap();
    let mut plan = set.plan(1);
    plan.trials[1].property = "p0".into();
    plan.trials[1].views = Views::Fixed(vec![1]);
    plan.trials.push(Trial {
        property: "p1".into(),
        ..plan.trials[0].clone()
    });
    for clip_norm in [None, Some(0.5)] {
        let config = HeadConfig {
            scale: Scale::None,
            clip_norm,
            ..full()
        };
        let lost = &plan.trials[1];
        others_go_on(&set, &config, &plan, lost, "the loss is");
    }
}

/// Readings whose squares leave f64: nothing can be estimated in their units.
#[test]
fn absurd_readings_take_nothing_from_another_property() {
    let mut set = Set::new(40, 1, 9, 3);
    set.reread(|_, row| vec![row[0], row[1].map(|t| 1e200 * t), row[2]]);
    let plan = set.plan(1);
    others_go_on(&set, &full(), &plan, &plan.trials[1], "spread leaves f64");
}

#[test]
fn a_stack_in_which_all_have_diverged_ends() {
    let set = Set::new(30, 1, 4, 2);
    let mut config = full();
    config.adam.learning_rate = 1e30;
    let (head, record) = (Head::new(config).unwrap(), Record::default());
    let trained = on_threads(1, || {
        head.train(&set.data(), &set.plan(1), &record).unwrap()
    });
    assert!(trained.heads().is_empty());
    assert_eq!(trained.diverged().len(), 2);
    for diverged in trained.diverged() {
        let reason = &diverged.reason;
        assert!(reason.starts_with("the loss is "), "{reason}");
        assert!(reason.ends_with(" in epoch 1"), "{reason}");
    }
    assert_eq!(record.asked.into_inner(), 1);
    // Who takes any estimator has a model for every trial, or an error that names the one without.
    let fitted = sps_regress::Regressor::fit(&head, &set.data(), &set.plan(1));
    golden::refused(fitted, "p0, rerun 0: the loss is ");
}

/// One step, too long for f32: no loss is taken after it, but the weights are looked at.
#[test]
fn weights_that_the_last_step_ruins_are_found() {
    let set = Set::new(30, 1, 4, 1);
    let mut config = full();
    (config.epochs, config.batch_size) = (1, 30);
    config.adam.learning_rate = 1e300;
    let trained = set.train(&config, &set.plan(1));
    assert!(trained.heads().is_empty());
    let reason = &trained.diverged()[0].reason;
    assert!(reason.ends_with("after the last epoch"), "{reason}");
}
