//! What the heads learn, against problems whose answer is known.

use super::*;

/// 1 - residual / variance about the training mean, over the surfaces kept out.
fn r2(set: &Set, trained: &TrainedHeads, plan: &Plan) -> f64 {
    let mut scores = Vec::new();
    for rerun in &plan.reruns {
        let out = (0..set.embeddings.surfaces()).filter(|s| !rerun.training.contains(s));
        let out: Vec<usize> = out.collect();
        let embeddings = set.embeddings.select(&out, &[0]).unwrap();
        let own = trained.filter(|trial| trial.rerun == rerun.number);
        for estimates in own.predict(&embeddings).unwrap() {
            let column = set.readings.column(&estimates.property).unwrap();
            let truth = |s: usize| set.readings.get(s, column).unwrap();
            let (mean, _) = moments(rerun.training.iter().map(|&s| truth(s)));
            let pairs = out.iter().zip(&estimates.values);
            let residual: f64 = pairs.map(|(&s, e)| (truth(s) - e).powi(2)).sum();
            let variance: f64 = out.iter().map(|&s| (truth(s) - mean).powi(2)).sum();
            scores.push(1.0 - residual / variance);
        }
    }
    scores.iter().sum::<f64>() / scores.len() as f64
}

/// Values that bend: a linear layer can follow half of them.
fn bent() -> Set {
    let mut set = Set::new(400, 1, 32, 3);
    let seen = set.embeddings.clone();
    set.reread(|s, _| {
        let x = seen.get(s, 0).unwrap();
        let of = |p: usize| f64::from(x[p] + 2.0 * (x[p + 3] * 0.8).abs() - x[p + 6]);
        (0..3).map(|p| Some(30.0 + 20.0 * of(p))).collect()
    });
    set
}

#[test]
fn the_cross_modal_network_follows_a_bend_that_regression_cannot() {
    let set = bent();
    let plan = set.plan(2);
    // A larger step stands in for the epochs that a small test has no time for.
    let mut config = HeadConfig {
        batch_size: 8,
        ..HeadConfig::default()
    };
    config.adam.learning_rate = 3e-3;
    config.adam.weight_decay = 0.0;
    let cross_modal = r2(&set, &set.train(&config, &plan), &plan);
    config.model = Model::Regression {};
    let regression = r2(&set, &set.train(&config, &plan), &plan);
    assert!(cross_modal > 0.75, "cross-modal {cross_modal}");
    let both = format!("{cross_modal} against {regression}");
    assert!(cross_modal > regression + 0.1, "{both}");
}

#[test]
fn estimates_are_in_measured_units() {
    let set = Set::new(60, 1, 6, 1);
    let plan = set.plan(1);
    let mut config = HeadConfig::default();
    config.adam.learning_rate = 1e-2;
    let one = set.train(&config, &plan);
    let mut other = Set::new(60, 1, 6, 1);
    other.reread(|_, row| vec![row[0].map(|t| 1000.0 * t - 7.0)]);
    let scaled = other.train(&config, &plan);
    let one = one.predict(&set.embeddings).unwrap();
    let scaled = scaled.predict(&set.embeddings).unwrap();
    for (one, scaled) in one[0].values.iter().zip(&scaled[0].values) {
        assert!((1000.0 * one - 7.0 - scaled).abs() < 1.0, "{one} {scaled}");
    }
}

/// With all surfaces in one batch, leaving readings out is training on the others.
#[test]
fn a_missing_reading_is_a_surface_that_is_not_there() {
    let mut set = Set::new(50, 1, 6, 2);
    let missing = |s: usize| s % 3 == 1;
    set.reread(|s, row| vec![row[0].filter(|_| !missing(s)), row[1]]);
    let mut config = full();
    config.batch_size = 50;
    config.epochs = 20;
    config.scale = Scale::None;
    cross_modal(&mut config).classification = None;
    let mut plan = set.plan(1);
    plan.trials.truncate(1);
    let masked = set.train(&config, &plan);
    plan.reruns[0].training.retain(|&s| !missing(s));
    let without = set.train(&config, &plan);
    let [masked, without] = [masked, without].map(|t| t.predict(&set.embeddings).unwrap());
    let error = golden::error(&masked[0].values, &without[0].values);
    assert!(error < 1e-6, "{error:e}");
}

#[test]
fn views_enter_the_slots_in_order_and_pooling_takes_the_largest() {
    let set = Set::new(30, 3, 4, 1);
    let mut config = full();
    config.input = Input::LateFusion { views: 2 };
    config.scale = Scale::None;
    let mut plan = set.plan(1);
    plan.trials[0].views = Views::Fixed(vec![2, 0]);
    let trained = set.train(&config, &plan);
    let all: Vec<usize> = (0..30).collect();
    let pick = |views: &[usize]| set.embeddings.select(&all, views).unwrap();
    // The slots of one network on one view each: the fused layer is the sum of its terms.
    let weight = trained.heads()[0].parameters.get("visual.weight").unwrap();
    assert_eq!(weight.dims(), [8, 6]);
    let estimate = trained.predict(&pick(&[2, 0])).unwrap();
    assert_ne!(estimate, trained.predict(&pick(&[0, 2])).unwrap());
    assert!(trained.predict(&set.embeddings).is_err());
    // Trained on the picked views as if there were no others.
    let picked = Set {
        embeddings: pick(&[2, 0]),
        readings: set.readings.clone(),
        materials: set.materials.clone(),
    };
    let mut same = plan.clone();
    same.trials[0].views = Views::Fixed(vec![0, 1]);
    cross_modal(&mut config).classification = None;
    let [one, two] = [(&set, &plan), (&picked, &same)].map(|(set, plan)| set.train(&config, plan));
    assert_eq!(bits(&one.heads()[0]), bits(&two.heads()[0]));

    config.input = Input::ViewPooling {};
    plan.trials[0].views = Views::Fixed(vec![0, 1, 2]);
    let pooled = set.train(&config, &plan);
    let largest = all.iter().flat_map(|&s| {
        let views = [0, 1, 2].map(|v| set.embeddings.get(s, v).unwrap());
        (0..4).map(move |f| views.iter().map(|view| view[f]).fold(f32::MIN, f32::max))
    });
    let largest = Embeddings::new(largest.collect(), [30, 1, 4]).unwrap();
    let estimates = pooled.predict(&set.embeddings).unwrap();
    for same in [pick(&[2, 1, 0, 1]), largest] {
        assert_eq!(estimates, pooled.predict(&same).unwrap());
    }
}

#[test]
fn a_feature_that_was_silent_in_training_is_not_blown_up() {
    let mut set = Set::new(40, 1, 6, 1);
    let values = set.embeddings.clone();
    let with = |quiet: f32| {
        let all = (0..40).flat_map(|s| {
            let last = if s == 0 { 1e-6 } else { quiet };
            [values.get(s, 0).unwrap(), &[last]].concat()
        });
        Embeddings::new(all.collect(), [40, 1, 7]).unwrap()
    };
    set.embeddings = with(0.0);
    let mut plan = set.plan(1);
    plan.reruns[0].training = (0..40).collect();
    for scale in [Scale::Common, Scale::PerFeature] {
        let mut config = full();
        config.scale = scale;
        let trained = set.train(&config, &plan);
        let quiet = trained.predict(&set.embeddings).unwrap();
        let loud = trained.predict(&with(1.0)).unwrap();
        let range = |e: &[Estimates]| e[0].values.iter().fold(0.0_f64, |max, v| max.max(v.abs()));
        // By its own spread of 1.6e-7 the feature would enter as six million.
        assert!(range(&loud) < 2.0 * range(&quiet), "{scale:?}");
    }
}
