mod storage;

use std::sync::{Arc, Mutex};

use safetensors::SafeTensors;
use sps_regress::kernel_ridge::KernelRidge;
use sps_regress::nearest::Nearest;
use sps_regress::ridge::Ridge;
use sps_regress::stacking::{Stacking, TrainedStacks};
use sps_regress::{
    Embeddings, Error, Estimates, FittedRegressor, Plan, Regressor, Rerun, Result, TrainingData,
    Trial, Views,
};

use crate::golden::uniform;
use crate::support::Set;

impl Set {
    /// Feature 0 is the reading of `p0`; `p1` is in no feature.
    fn stacked(surfaces: usize) -> Self {
        let values = uniform("stacking.x", surfaces * 3);
        let seen = values.chunks(3).map(|x| Some(x[0])).collect();
        let noise = uniform("stacking.noise", surfaces).into_iter().map(Some);
        let values = values.iter().map(|&x| x as f32).collect();
        let embeddings = Embeddings::new(values, [surfaces, 1, 3]).unwrap();
        Self::of(embeddings, &[seen, noise.collect()])
    }

    fn reruns(&self, reruns: u64) -> Plan {
        let rerun = |number| Rerun::new(number, number as usize..number as usize + 24);
        let reruns = (0..reruns).map(rerun).collect();
        Plan::each(5, self.readings.properties(), reruns)
    }
}

/// Says what a rule says of an embedding, and remembers what it was trained on.
#[derive(Clone)]
struct Rule {
    says: fn(&[f32]) -> f64,
    plans: Arc<Mutex<Vec<Plan>>>,
    trials: Vec<Trial>,
    stops_early: bool,
    kept: bool,
}

impl Rule {
    fn new(says: fn(&[f32]) -> f64) -> Self {
        Self {
            says,
            plans: Arc::default(),
            trials: Vec::new(),
            stops_early: false,
            kept: true,
        }
    }
}

impl Regressor for Rule {
    fn fit(&self, _: &TrainingData<'_>, plan: &Plan) -> Result<Box<dyn FittedRegressor>> {
        self.plans.lock().unwrap().push(plan.clone());
        let trials = plan.trials.clone();
        Ok(Box::new(Self {
            trials,
            ..self.clone()
        }))
    }

    fn needs_validation(&self) -> bool {
        self.stops_early
    }
}

impl FittedRegressor for Rule {
    fn trials(&self) -> Vec<&Trial> {
        self.trials.iter().collect()
    }

    fn predict(&self, embeddings: &Embeddings) -> Result<Vec<Estimates>> {
        let surfaces = || (0..embeddings.surfaces()).filter_map(|s| embeddings.get(s, 0));
        let estimates = self.trials.iter().map(|trial| Estimates {
            property: trial.property.clone(),
            rerun: trial.rerun,
            values: surfaces().map(self.says).collect(),
        });
        Ok(estimates.collect())
    }

    fn filtered(&self, keep: &dyn Fn(&Trial) -> bool) -> Box<dyn FittedRegressor> {
        let mut kept = self.clone();
        kept.trials.retain(keep);
        Box::new(kept)
    }

    fn multiply_adds(&self) -> u64 {
        self.trials.len() as u64
    }

    fn kind(&self) -> &'static str {
        "rules"
    }

    fn to_bytes(&self) -> Result<Vec<u8>> {
        let refused = || Error::Other("\"rules\" are not kept".into());
        self.kept.then(Vec::new).ok_or_else(refused)
    }
}

fn refused<T>(outcome: Result<T>, expected: &str) {
    let error = outcome.err().map(|error| error.to_string());
    let error = error.unwrap_or_default();
    assert!(error.contains(expected), "{error:?}, not {expected:?}");
}

/// The weights of each stack, as they are stored.
fn weights(stacks: &TrainedStacks) -> Vec<Vec<f64>> {
    let bytes = stacks.to_bytes().unwrap();
    let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
    let metadata = &header.metadata().as_ref().unwrap()["sps-stacks"];
    let metadata: serde_json::Value = serde_json::from_str(metadata).unwrap();
    let stacks = metadata["stacks"].as_array().unwrap().iter();
    let weights = stacks.map(|stack| serde_json::from_value(stack["weights"].clone()).unwrap());
    weights.collect()
}

fn three() -> Stacking {
    let members: Vec<Box<dyn Regressor>> = vec![
        Box::new(Ridge::default()),
        Box::new(KernelRidge::default()),
        Box::new(Nearest),
    ];
    Stacking::new(members, 4).unwrap()
}

#[test]
fn a_perfect_member_has_all_the_weight() {
    let set = Set::stacked(30);
    let wrong = Rule::new(|x| f64::from(x[0] + x[1] - 0.5 * x[2]));
    let perfect = Rule::new(|x| f64::from(x[0]));
    let stacking = Stacking::new(vec![Box::new(wrong), Box::new(perfect)], 3).unwrap();
    let mut plan = set.reruns(1);
    plan.trials.truncate(1);
    let stacks = stacking.train(&set.data(), &plan).unwrap();
    let weights = &weights(&stacks)[0];
    let all = weights[0].abs() < 1e-12 && (weights[1] - 1.0).abs() < 1e-12;
    assert!(all, "{weights:?}");
    let estimates = stacks.predict(&set.embeddings).unwrap();
    for (surface, value) in estimates[0].values.iter().enumerate() {
        assert!((value - set.readings.get(surface, 0).unwrap()).abs() < 1e-12);
    }
}

#[test]
fn what_cannot_be_predicted_gets_the_mean() {
    let set = Set::stacked(30);
    let kernel = KernelRidge::default();
    // It says the contrary of what is: a weight below zero would fit.
    let contrary = Rule::new(|x| f64::from(-x[0]));
    let stacking = Stacking::new(vec![Box::new(contrary), Box::new(kernel)], 4).unwrap();
    let stacks = stacking.train(&set.data(), &set.reruns(1)).unwrap();
    assert_eq!(weights(&stacks)[0][0], 0.0);
    let mut plan = set.reruns(1);
    plan.trials.remove(0);
    let rule = Rule::new(|_| 1e3);
    let stacks = Stacking::new(vec![Box::new(rule)], 4).unwrap();
    // A constant far from the mean helps nowhere but by chance of the sign of the sum.
    let stacks = stacks.train(&set.data(), &plan).unwrap();
    let readings: Vec<f64> = (0..24).filter_map(|s| set.readings.get(s, 1)).collect();
    let mean = readings.iter().sum::<f64>() / 24.0;
    for value in &stacks.predict(&set.embeddings).unwrap()[0].values {
        assert!((value - mean).abs() < 1e-12);
    }
}

/// Units of three surfaces each, on any seed.
#[test]
fn folds_never_split_a_unit() {
    let set = Set::stacked(40);
    let units: Vec<usize> = (0..40).map(|surface| 100 - surface / 3).collect();
    for seed in 0..20 {
        let rule = Rule::new(|x| f64::from(x[0]));
        let plans = Arc::clone(&rule.plans);
        let stacking = Stacking::new(vec![Box::new(rule)], 3).unwrap();
        let plan = Plan {
            seed,
            ..set.reruns(2)
        };
        let data = set.data().with_units(&units);
        stacking.train(&data, &plan).unwrap();
        let plans = plans.lock().unwrap();
        let (inner, whole) = (&plans[0], &plans[1]);
        assert_eq!((inner.reruns.len(), &whole.reruns), (6, &plan.reruns));
        for (at, fold) in inner.reruns.iter().enumerate() {
            let all = &plan.reruns[at / 3].training;
            let held: Vec<_> = all.iter().filter(|s| !fold.training.contains(s)).collect();
            assert!(!held.is_empty() && held.len() + fold.training.len() == all.len());
            let trained = |s: &&usize| fold.training.iter().any(|&t| units[**s] == units[t]);
            assert!(!held.iter().any(trained));
        }
    }
}

/// A trial has the bits that it would have alone.
#[test]
fn company_changes_nothing() {
    let set = Set::stacked(40);
    let plan = set.reruns(3);
    let all = three().train(&set.data(), &plan).unwrap();
    let estimates = all.predict(&set.embeddings).unwrap();
    for (at, trial) in plan.trials.iter().enumerate() {
        let alone = Plan {
            reruns: vec![plan.reruns[at / 2].clone()],
            trials: vec![trial.clone()],
            ..plan
        };
        let alone = three().train(&set.data(), &alone).unwrap();
        assert_eq!(alone.predict(&set.embeddings).unwrap(), estimates[at..=at]);
        let kept = all.filtered(&|other| other == trial);
        assert!(alone.to_bytes().unwrap() == kept.to_bytes().unwrap());
        assert_eq!(kept.predict(&set.embeddings).unwrap(), estimates[at..=at]);
    }
}

#[test]
fn hard_cases() {
    let set = Set::stacked(40);
    // One unit: nothing can be held out, and the mean is what is left.
    let stacks = three().train(&set.data().with_units(&[7; 40]), &set.reruns(1));
    let stacks = stacks.unwrap();
    assert_eq!(weights(&stacks), [[0.0; 3]; 2]);
    assert_eq!(stacks.multiply_adds(), 0);
    let odd = set.data().with_units(&[1]);
    refused(three().train(&odd, &set.reruns(1)), "units");
    let mut plan = set.reruns(1);
    plan.trials[1].views = Views::Random;
    refused(three().train(&set.data(), &plan), "views");
    let mut plan = set.reruns(1);
    plan.reruns[0].number = u64::MAX;
    for trial in &mut plan.trials {
        trial.rerun = u64::MAX;
    }
    refused(three().train(&set.data(), &plan), "number of a rerun");
    let members = || -> Vec<Box<dyn Regressor>> { vec![Box::new(Nearest)] };
    assert!(Stacking::new(members(), 1).is_err());
    assert!(Stacking::new(Vec::new(), 2).is_err());
    let mut stopping = Rule::new(|_| 0.0);
    stopping.stops_early = true;
    refused(Stacking::new(vec![Box::new(stopping)], 2), "early stopping");
    let many = (0..5).flat_map(|_| members()).collect();
    assert!(Stacking::new(many, 2).is_err());
}
