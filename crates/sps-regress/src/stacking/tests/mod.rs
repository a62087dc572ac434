mod storage;

use std::sync::{Arc, Mutex};

use super::*;
use crate::data::Readings;
use crate::fitted::{Fitted, FittedModel};
use crate::golden::uniform;
use crate::kernel_ridge::KernelRidge;
use crate::nearest::Nearest;
use crate::ridge::Ridge;

/// Surfaces whose feature 0 is the reading of `seen`; `noise` is in no feature.
struct Set {
    embeddings: Embeddings,
    readings: Readings,
}

impl Set {
    fn new(surfaces: usize) -> Self {
        let values = uniform("stacking.x", surfaces * 3);
        let noise = uniform("stacking.noise", surfaces);
        let row = |s: usize| vec![Some(f64::from(values[3 * s] as f32)), Some(noise[s])];
        let rows: Vec<Vec<_>> = (0..surfaces).map(row).collect();
        let values: Vec<f32> = values.into_iter().map(|x| x as f32).collect();
        Self {
            embeddings: Embeddings::new(values, [surfaces, 1, 3]).unwrap(),
            readings: Readings::new(vec!["seen".into(), "noise".into()], &rows).unwrap(),
        }
    }

    fn data(&self) -> TrainingData<'_> {
        TrainingData::new(&self.embeddings, &self.readings)
    }

    fn plan(&self, reruns: u64) -> Plan {
        let rerun = |number| Rerun::new(number, number as usize..number as usize + 24);
        let reruns = (0..reruns).map(rerun).collect();
        Plan::each(5, self.readings.properties(), reruns)
    }
}

/// Says what a rule says of an embedding, and remembers what it was trained on.
struct Rule {
    says: fn(&[f32]) -> f64,
    plans: Arc<Mutex<Vec<Plan>>>,
    stops_early: bool,
}

#[derive(Clone)]
struct FittedRule {
    says: fn(&[f32]) -> f64,
    trial: Trial,
}

impl Rule {
    fn new(says: fn(&[f32]) -> f64) -> Self {
        Self {
            says,
            plans: Arc::default(),
            stops_early: false,
        }
    }
}

impl Regressor for Rule {
    fn fit(&self, _: &TrainingData<'_>, plan: &Plan) -> Result<Box<dyn FittedRegressor>> {
        self.plans.lock().unwrap().push(plan.clone());
        let fitted = |trial: &Trial| FittedRule {
            says: self.says,
            trial: trial.clone(),
        };
        Ok(Box::new(Fitted(plan.trials.iter().map(fitted).collect())))
    }

    fn needs_validation(&self) -> bool {
        self.stops_early
    }
}

impl FittedModel for FittedRule {
    const KIND: &'static str = "rules";

    fn trial(&self) -> &Trial {
        &self.trial
    }

    fn estimate(models: &[Self], embeddings: &Embeddings) -> Result<Vec<Vec<f64>>> {
        let surfaces = || (0..embeddings.surfaces()).map(|s| embeddings.surface(s));
        let estimates = models.iter().map(|one| surfaces().map(one.says).collect());
        Ok(estimates.collect())
    }

    fn multiply_adds(models: &[Self]) -> u64 {
        models.len() as u64
    }

    fn to_bytes(_: &[Self]) -> Result<Vec<u8>> {
        let what = "kind of fitted models";
        Err(Error::input(what, "\"rules\"", "one that is kept"))
    }

    fn from_bytes(_: &[u8]) -> Result<Vec<Self>> {
        unreachable!("it is not kept")
    }
}

fn refused<T>(outcome: Result<T>, expected: &str) {
    let error = outcome.err().map(|error| error.to_string());
    let error = error.unwrap_or_default();
    assert!(error.contains(expected), "{error:?}, not {expected:?}");
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
    let set = Set::new(30);
    let wrong = Rule::new(|x| f64::from(x[0] + x[1] - 0.5 * x[2]));
    let perfect = Rule::new(|x| f64::from(x[0]));
    let stacking = Stacking::new(vec![Box::new(wrong), Box::new(perfect)], 3).unwrap();
    let mut plan = set.plan(1);
    plan.trials.truncate(1);
    let stacks = stacking.train(&set.data(), &plan).unwrap();
    let weights = &stacks.stacks[0].weights;
    let all = weights[0].abs() < 1e-12 && (weights[1] - 1.0).abs() < 1e-12;
    assert!(all, "{weights:?}");
    let estimates = stacks.predict(&set.embeddings).unwrap();
    for (surface, value) in estimates[0].values.iter().enumerate() {
        assert!((value - set.readings.get(surface, 0).unwrap()).abs() < 1e-12);
    }
}

#[test]
fn what_cannot_be_predicted_gets_the_mean() {
    let set = Set::new(30);
    let kernel = KernelRidge::default();
    // It says the contrary of what is: a weight below zero would fit.
    let contrary = Rule::new(|x| f64::from(-x[0]));
    let stacking = Stacking::new(vec![Box::new(contrary), Box::new(kernel)], 4).unwrap();
    let stacks = stacking.train(&set.data(), &set.plan(1)).unwrap();
    assert_eq!(stacks.stacks[0].weights[0], 0.0);
    let mut plan = set.plan(1);
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
    let set = Set::new(40);
    let units: Vec<usize> = (0..40).map(|surface| 100 - surface / 3).collect();
    for seed in 0..20 {
        let rule = Rule::new(|x| f64::from(x[0]));
        let plans = Arc::clone(&rule.plans);
        let stacking = Stacking::new(vec![Box::new(rule)], 3).unwrap();
        let plan = Plan {
            seed,
            ..set.plan(2)
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
    let set = Set::new(40);
    let plan = set.plan(3);
    let all = three().train(&set.data(), &plan).unwrap();
    let estimates = all.predict(&set.embeddings).unwrap();
    for (at, trial) in plan.trials.iter().enumerate() {
        let alone = Plan {
            reruns: vec![plan.reruns[at / 2].clone()],
            trials: vec![trial.clone()],
            ..plan
        };
        let alone = three().train(&set.data(), &alone).unwrap();
        assert_eq!(alone.stacks, all.stacks[at..=at]);
        assert_eq!(alone.predict(&set.embeddings).unwrap(), estimates[at..=at]);
        let kept = all.filtered(&|other| other == trial);
        assert_eq!(kept.predict(&set.embeddings).unwrap(), estimates[at..=at]);
    }
}

#[test]
fn hard_cases() {
    let set = Set::new(40);
    // One unit: nothing can be held out, and the mean is what is left.
    let stacks = three().train(&set.data().with_units(&[7; 40]), &set.plan(1));
    let stacks = stacks.unwrap();
    let mut all = stacks.stacks.iter();
    assert!(all.all(|stack| stack.weights == [0.0; 3]));
    assert_eq!(stacks.multiply_adds(), 0);
    let odd = set.data().with_units(&[1]);
    refused(three().train(&odd, &set.plan(1)), "units");
    let mut plan = set.plan(1);
    plan.trials[1].views = Views::Random;
    refused(three().train(&set.data(), &plan), "views");
    let mut plan = set.plan(1);
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
