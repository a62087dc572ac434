//! Training through the heads of all values, against PyTorch's autograd
//! (`fixtures/golden/make_joint_golden.py`) and by its laws.

use std::collections::BTreeMap;

use candle_core::Var;
use serde::Deserialize;
use sps_regress::Embeddings;

use super::*;
use crate::embeddings_of;
use crate::heads::{Adversarial, CrossModal, Input, Model, RelationScale, Scale, Share};
use crate::optim::AdamConfig;

#[derive(Deserialize)]
struct Case {
    /// How far PyTorch's gradients in f32 are from those in f64: with oneDNN; with or without it, whichever is farther.
    rounding: [f64; 2],
    /// The same of the losses of the worst step, over their sum: with or without oneDNN, whichever is farther.
    step_rounding: f64,
    losses: Vec<BTreeMap<String, f64>>,
    encoder: BTreeMap<String, f64>,
    heads: BTreeMap<String, Vec<f64>>,
}

fn expected(case: &str) -> Case {
    serde_json::from_value(golden::json("joint.json")[case].take()).unwrap()
}

/// A case of the script.
struct Golden {
    case: &'static str,
    kind: EncoderKind,
    views: usize,
    input: Input,
}

const JOINT: Golden = Golden {
    case: "joint",
    kind: EncoderKind::SeResNext50,
    views: 1,
    input: Input::Single {},
};
const SURFACES: usize = 4;
const SIDE: usize = 64;

impl Golden {
    fn targets(&self) -> Targets {
        let of = golden::uniform("golden/joint.readings", SURFACES * 3);
        let row = |row: &[f64]| row.iter().map(|v| Some(v * 10.0 + 40.0)).collect();
        let mut rows: Vec<Vec<Option<f64>>> = of.chunks(3).map(row).collect();
        rows[2][1] = None;
        let names = ["a", "b", "c"].map(str::to_owned).to_vec();
        let shape = [SURFACES, self.views, self.kind.width()];
        let start = golden::input(&format!("golden/{}.start", self.case), &shape);
        Targets {
            values: Some(Readings::new(names, &rows).unwrap()),
            start: Some(embeddings_of(&start).unwrap()),
            materials: Some(["m", "n", "m", "o"].map(str::to_owned).to_vec()),
            ..Targets::default()
        }
    }

    /// One batch holds everything, as it is.
    fn trainer(&self) -> Trainer {
        let config = TrainingConfig {
            objective: TrainingObjective::Heads {
                input: self.input.clone(),
                scale: Scale::Common,
                model: golden::cross_modal(),
                views: any(&self.input, self.views),
            },
            epochs: 10,
            batch_size: SURFACES,
            adam: AdamConfig {
                learning_rate: 1e-5,
                ..AdamConfig::default()
            },
            warmup: 0.0,
            validation: 0.0,
            augmentation: Augmentation::STILL,
            running_statistics: Some(false),
            ..TrainingConfig::default()
        };
        let parts = parts(0..SURFACES, []);
        let start = golden::encoder(self.kind);
        let trainer = Trainer::new(&start, self.targets(), parts, config, 0).unwrap();
        for (name, variable) in trainer.objective.parameters() {
            fill(self.case, &name, variable);
        }
        trainer
    }
}

impl ImageSource for Golden {
    fn image(&self, index: usize) -> Result<Image, Box<dyn StdError + Send + Sync>> {
        let len = SIDE * SIDE * 3;
        let all = SURFACES * self.views * len;
        let all = golden::uniform(&format!("golden/{}.images", self.case), all);
        let pixels = all[index * len..][..len].iter();
        let pixels = pixels.map(|u| f32::midpoint(*u as f32, 1.0));
        Ok(Image::new(SIDE, SIDE, pixels.collect())?)
    }
}

/// A parameter of the heads as the script fills it.
fn fill(case: &str, name: &str, variable: &Var) {
    let gain = match variable.dims() {
        [_, inputs, _] => (3.0 / *inputs as f64).sqrt(),
        _ => 0.1,
    };
    // The script rounds the product to f32.
    let values = golden::tensor(&format!("golden/{case}.{name}"), variable.dims());
    let values = (values * gain).unwrap().to_dtype(DType::F32).unwrap();
    variable.set(&values).unwrap();
}

/// The largest difference of a step's losses, over their sum.
fn error(losses: &Losses, expected: &BTreeMap<String, f64>) -> f64 {
    let sum: f64 = expected.values().map(|loss| loss.abs()).sum();
    let by_name = [
        ("estimation", losses.values),
        ("embedding", losses.embedding),
        ("generator", losses.generator),
        ("discriminator", losses.discriminator),
        ("classification", losses.classes),
    ];
    let differences = by_name.map(|(name, loss)| (loss - expected[name]).abs() / sum);
    differences.into_iter().fold(0.0, f64::max)
}

#[test]
fn losses_and_gradients_are_pytorchs() {
    let two = |case, input| Golden {
        case,
        kind: EncoderKind::ResNet18,
        views: 2,
        input,
    };
    for golden in [
        JOINT,
        two("late-fusion", Input::LateFusion { views: 2 }),
        two("view-pooling", Input::ViewPooling {}),
        two("relations", relations(2, 1)),
    ] {
        let expected = expected(golden.case);
        let mut trainer = golden.trainer();
        let batch = shown(&golden, SURFACES * golden.views);
        let embeddings = trainer.encoder.forward(&batch).unwrap();
        let surfaces: Vec<usize> = (0..SURFACES).collect();
        let share = Share::whole(&surfaces);
        let (loss, losses) = trainer.objective.loss(&embeddings, share, 0).unwrap();
        let found = error(&losses, &expected.losses[0]);
        assert!(found < 1e-5, "{}: losses {found:.1e}", golden.case);
        let total = f64::from(loss.to_scalar::<f32>().unwrap());
        assert!((total - losses.total()).abs() < 1e-5, "{}", golden.case);

        let store = trainer.encoder.backward(&loss).unwrap();
        let mut worst = [0.0_f64; 2];
        let mut seen = 0;
        let norms = expected.encoder.values();
        let largest = norms.fold(0.0_f64, |max, &n| max.max(n));
        for (name, variable) in trainer.encoder.variables() {
            let Some(expected) = expected.encoder.get(name) else {
                continue;
            };
            seen += 1;
            let gradient = golden::values(store.get(variable).unwrap());
            // Behind a norm that the next norm undoes, a gradient is 0 but for rounding.
            let scale = expected.max(1e-6 * largest);
            worst[0] = worst[0].max((golden::norm(&gradient) - expected).abs() / scale);
        }
        assert_eq!(seen, expected.encoder.len(), "{}", golden.case);
        let gradients = trainer.objective.gradients(&store).unwrap();
        let parameters: Vec<String> = trainer.objective.parameters().map(|(n, _)| n).collect();
        assert_eq!(parameters.len(), expected.heads.len());
        for (name, gradient) in parameters.iter().zip(&gradients) {
            let of_values = golden::values(gradient);
            let of_values = of_values.chunks(of_values.len() / 3);
            for (gradient, expected) in of_values.zip(&expected.heads[name]) {
                let off = (golden::norm(gradient) - expected).abs() / expected.max(1e-6);
                worst[1] = worst[1].max(off);
            }
        }
        let [encoder, heads] = worst;
        let (case, rounding) = (golden.case, golden::bound(expected.rounding));
        println!("{case}: encoder {encoder:.1e}, heads {heads:.1e}; PyTorch in f32 {rounding:.1e}");
        let bound = f64::max(1e-3, 2.0 * rounding);
        assert!(encoder < bound && heads < 1e-3, "{case}: {worst:?}");
    }
}

#[test]
fn ten_steps_are_pytorchs() {
    let expected = expected("joint");
    let mut trainer = JOINT.trainer();
    let mut steps = Vec::new();
    while !trainer.is_finished() {
        let epoch = trainer.epoch(&JOINT, |step| steps.push(step.losses));
        epoch.unwrap();
    }
    assert_eq!(steps.len(), expected.losses.len());
    let steps = steps.iter().zip(&expected.losses);
    let errors: Vec<f64> = steps.map(|(step, e)| error(step, e)).collect();
    let bound = golden::bound([1e-3, 2.0 * expected.step_rounding]);
    assert!(errors.iter().all(|&error| error < bound), "{errors:?}");
}

/// Stripes in twos: of each surface a bright and a dark image.
pub(super) struct Pairs(Stripes);

impl Pairs {
    pub(super) fn new(surfaces: usize) -> Self {
        Self(Stripes::new(surfaces))
    }

    fn targets(&self) -> Targets {
        self.targets_of(&start())
    }

    /// What `encoder` has to tell.
    pub(super) fn targets_of(&self, encoder: &Encoder) -> Targets {
        let surfaces = self.0.brightness.len();
        let seen = encoder.embed(&shown(self, 2 * surfaces)).unwrap();
        let seen = seen.reshape((surfaces, 2, ())).unwrap();
        Targets {
            classes: None,
            start: Some(embeddings_of(&seen).unwrap()),
            materials: Some((0..surfaces).map(|s| format!("m{}", s % 2)).collect()),
            ..self.0.targets()
        }
    }

    fn trainer(&self, config: TrainingConfig) -> Trainer {
        self.trainer_from(&start(), config)
    }

    fn trainer_from(&self, start: &Encoder, config: TrainingConfig) -> Trainer {
        Trainer::new(start, self.targets_of(start), self.0.parts(), config, 5).unwrap()
    }
}

impl ImageSource for Pairs {
    fn image(&self, index: usize) -> Result<Image, Box<dyn StdError + Send + Sync>> {
        let image = self.0.image(index / 2)?;
        let (height, width) = image.size();
        let factor = if index.is_multiple_of(2) { 1.0 } else { 0.5 };
        let pixels = image.pixels().iter().map(|value| value * factor);
        Ok(Image::new(height, width, pixels.collect())?)
    }
}

pub(super) fn through_heads(input: Input, model: Model) -> TrainingConfig {
    TrainingConfig {
        objective: TrainingObjective::Heads {
            scale: Scale::Common,
            model,
            views: any(&input, 2),
            input,
        },
        ..config()
    }
}

/// How many views there are, for an input that takes any number.
fn any(input: &Input, views: usize) -> Option<usize> {
    let any = matches!(input, Input::ViewPooling {} | Input::Relations { .. });
    any.then_some(views)
}

/// Relations of one scale.
fn relations(views: usize, relations: usize) -> Input {
    let scales = vec![RelationScale { views, relations }];
    Input::Relations { scales }
}

pub(super) fn inputs() -> [Input; 3] {
    let fusion = Input::LateFusion { views: 2 };
    [fusion, Input::ViewPooling {}, relations(1, 3)]
}

#[test]
fn an_encoder_learns_through_heads() {
    for input in inputs() {
        let pairs = Pairs::new(64);
        let model = Model::CrossModal(CrossModal::default());
        let config = through_heads(input.clone(), model);
        let mut trainer = pairs.trainer_from(&without_norms(), config);
        to_the_end(&mut trainer, &pairs);
        let errors = trainer.history().iter().map(|e| e.validation.unwrap());
        let errors: Vec<f64> = errors.map(|losses| losses.values).collect();
        let best = errors.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(best < 0.5, "{input:?}: {errors:.2?}");
    }
}

#[test]
fn a_training_through_heads_that_was_stopped_ends_with_the_same_bits_on_any_threads() {
    for input in inputs() {
        let pairs = Pairs::new(24);
        let config = || through_heads(input.clone(), golden::cross_modal());
        let resume = |state: &[u8]| {
            let (targets, parts) = (pairs.targets(), pairs.0.parts());
            Trainer::resume("a state", state, targets, parts, config(), 5).unwrap()
        };
        ends_alike(&pairs, || pairs.trainer(config()), resume);
    }
}

/// What both sides of the game look at is no part of the game.
#[test]
fn a_discriminator_moves_no_encoder() {
    let pairs = Pairs::new(24);
    let gradient = |adversarial: Option<Adversarial>| {
        let model = Model::CrossModal(CrossModal {
            adversarial,
            ..CrossModal::default()
        });
        let config = through_heads(Input::LateFusion { views: 2 }, model);
        let mut trainer = pairs.trainer(config);
        let embeddings = trainer.encoder.forward(&shown(&pairs, 8)).unwrap();
        let share = Share::whole(&[0, 1, 2, 3]);
        let (loss, _) = trainer.objective.loss(&embeddings, share, 0).unwrap();
        let store = trainer.encoder.backward(&loss).unwrap();
        let (_, variable) = trainer.encoder.variables().next().unwrap();
        golden::values(store.get(variable).unwrap())
    };
    // A generator that hardly plays: what is left of the game is the discriminator's side.
    let alone = gradient(None);
    let beside = gradient(Some(Adversarial {
        weight: 1e-30,
        ..Adversarial::default()
    }));
    assert_eq!(alone, beside);
}

mod hard_cases {
    use super::*;

    fn refused(targets: Targets, input: Input, expected: &str) {
        let config = through_heads(input, golden::cross_modal());
        let trainer = Trainer::new(&start(), targets, parts(0..16, 16..24), config, 5);
        golden::refused(trainer, expected);
    }

    #[test]
    fn targets_that_heads_cannot_learn_are_refused() {
        let targets = Pairs::new(24).targets();
        let refused = |change: &dyn Fn(&mut Targets), expected: &str| {
            let mut targets = targets.clone();
            change(&mut targets);
            refused(targets, Input::LateFusion { views: 2 }, expected);
        };
        refused(&|t| t.start = None, "what the encoder sees at the start");
        let classes = Classes {
            of_image: vec![0; 24],
            count: 1,
        };
        let expected = "heads form their labels themselves";
        refused(&|t| t.classes = Some(classes.clone()), expected);
        refused(&|t| t.materials = None, "materials");
        refused(&|t| drop(t.materials.as_mut().unwrap().pop()), "23");
        let wide = Embeddings::new(vec![0.0; 24 * 2 * 7], [24, 2, 7]).unwrap();
        refused(&|t| t.start = Some(wide.clone()), "width 7");
        let unread = Readings::new(vec!["brightness".into()], &vec![vec![None]; 24]).unwrap();
        let expected = "at least one that a training surface";
        refused(&|t| t.values = Some(unread.clone()), expected);
    }

    #[test]
    fn inputs_that_do_not_fit_the_views_are_refused() {
        let targets = Pairs::new(24).targets();
        refused(targets.clone(), Input::Single {}, "expected 1 views");
        let three = Input::LateFusion { views: 3 };
        refused(targets.clone(), three, "expected 3 views");
        refused(targets, relations(3, 1), "at least 3");
    }

    /// A batch whose surfaces have no reading of a value, or no label, has no loss of it, and none
    /// of it is NaN.
    #[test]
    fn a_batch_without_readings_is_finite() {
        let pairs = Pairs::new(24);
        let mut targets = pairs.targets();
        let row = |s| vec![(s == 7).then_some(1.0), Some(f64::from(s))];
        let rows: Vec<_> = (0..24).map(row).collect();
        let names = vec!["rare".to_owned(), "common".to_owned()];
        targets.values = Some(Readings::new(names, &rows).unwrap());
        let mut config = through_heads(Input::ViewPooling {}, golden::cross_modal());
        (config.batch_size, config.epochs) = (2, 1);
        let mut trainer = Trainer::new(&start(), targets, pairs.0.parts(), config, 5).unwrap();
        let epoch = trainer.epoch(&pairs, |step| assert!(step.losses.total().is_finite()));
        assert!(epoch.unwrap().validation.unwrap().total().is_finite());
    }
}
