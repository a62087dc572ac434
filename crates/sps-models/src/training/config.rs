use serde::{Deserialize, Serialize};

use crate::encoders::Precision;
use crate::error::{Result, require};
use crate::heads::{HeadConfig, Input, Model, Scale};
use crate::optim::AdamConfig;

/// How an encoder is trained; [`Trainer::new`](super::Trainer::new) checks it.
///
/// "Measured" points to `docs/training.md`; the paper prints the epochs and the learning rate
/// alone (section 4.2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct TrainingConfig {
    /// What stands on the embedding meanwhile, and what it makes small.
    pub objective: TrainingObjective,
    /// Passes over the training images. Paper, section 4.2: 30.
    pub epochs: usize,
    /// First epochs in which only what stands on the embedding learns: layers that know nothing yet
    /// would pull the encoder away from what it knows (Kumar et al. 2022).
    pub frozen_epochs: usize,
    /// Images, or surfaces of several views, per step, at most: an epoch is cut into batches of equal size. Measured.
    pub batch_size: usize,
    /// Gradient accumulation: how many surfaces of a step go through the network at once, at most. Each such
    /// part adds its gradient to the step's; losses stay means over the whole step. Less memory; batch norm
    /// sees the parts one by one. Default: all at once.
    pub micro_batch_size: Option<usize>,
    /// The optimiser; its learning rate is the largest of the schedule. Measured.
    pub adam: AdamConfig,
    /// Share of all steps over which the learning rate rises from zero; it then falls to zero
    /// along half a cosine (Loshchilov and Hutter 2017).
    pub warmup: f64,
    /// Largest norm of the gradient of all parameters together. Default: none.
    pub clip_norm: Option<f64>,
    /// Whether only each block's input is kept for the backward pass: less memory, more time, the
    /// same bits.
    pub checkpointing: bool,
    /// Whether batch norm goes by the running statistics of the start rather than by each batch's own, which random
    /// weights need. Default: yes, unless [`TrainingConfig::beginning`] is told of random weights.
    pub running_statistics: Option<bool>,
    /// What feature maps and their gradients are made of while the encoder is trained: f32, or bf16, which
    /// takes half the memory. Its weights stay f32. Default: f32.
    pub precision: Precision,
    /// Share of the images that is not trained on and says after each epoch how good the network
    /// is; the best one is kept. 0: none, and the last one is kept.
    pub validation: f64,
    /// Epochs without a better one after which training ends; 0: it never ends early.
    pub patience: usize,
    /// How images are varied.
    pub augmentation: Augmentation,
}

/// What an encoder is trained by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum TrainingObjective {
    /// A linear layer for all values and one for the classes: the mean squared error of the
    /// standardised values plus the cross-entropy of the classes.
    Linear {},
    /// The paper's own (section 4.1): a head for each value on one image or several views, each
    /// with the losses of its model; what is made small is their mean over the values. Discriminators
    /// play at the same time, and neither side of the game changes what both look at: the encoder
    /// learns from the game through the generated value alone. The epoch with the least error of
    /// the values on the validation part is the best.
    Heads {
        /// How the views of a surface enter. Relations are drawn anew in each step.
        #[serde(default = "single")]
        input: Input,
        /// How embeddings are scaled, by what the encoder saw before it was trained.
        #[serde(default)]
        scale: Scale,
        /// What stands between embedding and value.
        #[serde(default = "cross_modal")]
        model: Model,
        /// Views of a surface, where the input takes any number: for view pooling and relations.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        views: Option<usize>,
    },
}

impl TrainingObjective {
    /// How many views of a surface are shown at once.
    pub fn views(&self) -> usize {
        match self {
            Self::Linear {} => 1,
            Self::Heads { input, views, .. } => match input {
                Input::Single {} => 1,
                Input::LateFusion { views } => *views,
                Input::ViewPooling {} | Input::Relations { .. } => views.unwrap_or(0),
            },
        }
    }

    fn check(&self) -> Result<()> {
        let Self::Heads {
            input,
            scale,
            model,
            views,
        } = self
        else {
            return Ok(());
        };
        let any = matches!(input, Input::ViewPooling {} | Input::Relations { .. });
        let found = views.map_or("none".to_owned(), |views| views.to_string());
        let (fits, expected) = if any {
            (self.views() > 0, "at least 1")
        } else {
            (views.is_none(), "none, where the input says how many")
        };
        require(fits, "objective.views", found, expected)?;
        if let Input::Relations { scales } = input {
            let most = scales.iter().map(|scale| scale.views).max().unwrap_or(0);
            let expected = format!("at least {most}, as many as a relation has");
            let shown = self.views();
            require(most <= shown, "objective.views", shown, expected)?;
        }
        head(input, *scale, model).check()
    }
}

/// The heads of an objective.
pub(super) fn head(input: &Input, scale: Scale, model: &Model) -> HeadConfig {
    HeadConfig {
        input: input.clone(),
        scale,
        model: model.clone(),
        ..HeadConfig::default()
    }
}

fn single() -> Input {
    Input::Single {}
}

fn cross_modal() -> Model {
    HeadConfig::default().model
}

/// How a training image is varied, each time it is shown.
///
/// Nothing here turns or stretches an image, so that it still shows the surface from the same
/// roll angle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Augmentation {
    /// Side of the square that is cut out at random, relative to the image's shorter side; 1 is
    /// the largest square there is.
    pub crop: f64,
    /// Whether half of the images are turned upside down, which maps the roll axis onto itself.
    pub flip: bool,
    /// Largest relative change of brightness, of contrast, and of each colour on its own.
    pub brightness: f64,
    /// See [`Augmentation::brightness`].
    pub contrast: f64,
    /// See [`Augmentation::brightness`].
    pub colour: f64,
}

impl Default for TrainingConfig {
    fn default() -> Self {
        Self {
            objective: TrainingObjective::Linear {},
            epochs: 30,
            frozen_epochs: 0,
            batch_size: 16,
            micro_batch_size: None,
            adam: AdamConfig::default(),
            warmup: 0.05,
            clip_norm: None,
            checkpointing: false,
            running_statistics: None,
            precision: Precision::F32,
            validation: 0.1,
            patience: 0,
            augmentation: Augmentation::default(),
        }
    }
}

impl Default for Augmentation {
    fn default() -> Self {
        Self {
            crop: 0.875,
            flip: true,
            brightness: 0.2,
            contrast: 0.2,
            colour: 0.05,
        }
    }
}

impl TrainingConfig {
    /// Refuses the first value that is out of its range, by its key.
    ///
    /// # Errors
    /// That value, and what it may be.
    pub fn check(&self) -> Result<()> {
        self.objective.check()?;
        require(self.epochs > 0, "epochs", self.epochs, "at least 1")?;
        let batch = self.batch_size;
        require(batch > 1, "batch-size", batch, "at least 2")?;
        if let Some(part) = self.micro_batch_size {
            let sensible = (2..=batch).contains(&part);
            let expected = format!("2 to {batch}, the `batch-size`");
            require(sensible, "micro-batch-size", part, expected)?;
        }
        self.adam.check()?;
        let share = |value: f64| (0.0..1.0).contains(&value);
        let expected = "at least 0 and below 1";
        require(share(self.warmup), "warmup", self.warmup, expected)?;
        let validation = self.validation;
        require(share(validation), "validation", validation, expected)?;
        if let Some(norm) = self.clip_norm {
            let sensible = norm.is_finite() && norm > 0.0;
            require(sensible, "clip-norm", norm, "above 0")?;
        }
        let precision = self.precision;
        let sensible = matches!(precision, Precision::F32 | Precision::Bf16);
        require(sensible, "precision", precision, "f32 or bf16")?;
        let needs = self.patience == 0 || self.validation > 0.0;
        let expected = "0 where `validation` is 0";
        require(needs, "patience", self.patience, expected)?;
        self.augmentation.check()
    }

    /// Fills in `running_statistics` where it is not given: no if training begins with `random` weights, yes if with
    /// others.
    #[must_use]
    pub fn beginning(mut self, random: bool) -> Self {
        self.running_statistics.get_or_insert(!random);
        self
    }

    /// Whether targets must hold what the encoder sees before it is trained.
    pub fn needs_start(&self) -> bool {
        matches!(self.objective, TrainingObjective::Heads { .. })
    }

    /// The learning rate of step `step` of `steps`.
    pub(super) fn learning_rate(&self, step: usize, steps: usize) -> f64 {
        let largest = self.adam.learning_rate;
        let warm = self.warmup * steps as f64;
        let step = step as f64 + 0.5;
        if step < warm {
            return largest * step / warm;
        }
        let through = ((step - warm) / (steps as f64 - warm)).min(1.0);
        largest * 0.5 * (1.0 + (std::f64::consts::PI * through).cos())
    }
}

impl Augmentation {
    /// None.
    #[cfg(test)]
    pub(super) const STILL: Self = Self {
        crop: 1.0,
        flip: false,
        brightness: 0.0,
        contrast: 0.0,
        colour: 0.0,
    };

    fn check(&self) -> Result<()> {
        let crop = self.crop;
        let sensible = crop > 0.0 && crop <= 1.0;
        require(sensible, "augmentation.crop", crop, "above 0 and at most 1")?;
        for (name, value) in [
            ("augmentation.brightness", self.brightness),
            ("augmentation.contrast", self.contrast),
            ("augmentation.colour", self.colour),
        ] {
            let sensible = (0.0..1.0).contains(&value);
            require(sensible, name, value, "at least 0 and below 1")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_learning_rate_rises_and_falls_to_zero() {
        let config = TrainingConfig {
            warmup: 0.1,
            ..TrainingConfig::default()
        };
        let rates: Vec<f64> = (0..100).map(|s| config.learning_rate(s, 100)).collect();
        let peak = rates.iter().copied().fold(0.0, f64::max);
        assert!((peak - 1e-4).abs() < 1e-6);
        assert!(rates[..10].is_sorted());
        assert!(rates[10..].iter().rev().is_sorted());
        assert!(rates[0] < 1e-5 && rates[99] < 1e-6);
        // Half of the cosine lies at its middle.
        assert!((config.learning_rate(54, 100) / 1e-4 - 0.5).abs() < 0.02);
    }

    #[test]
    fn an_objective_says_how_many_views_it_shows() {
        let read = |text: &str| -> TrainingObjective { toml::from_str(text).unwrap() };
        assert_eq!(TrainingConfig::default().objective.views(), 1);
        let views = |input: &str, views: &str| {
            let text = format!("kind = \"heads\"\ninput = {input}\n{views}");
            let objective = read(&text);
            objective.check().map(|()| objective.views())
        };
        let pooling = "{ kind = \"view-pooling\" }";
        let fusion = "{ kind = \"late-fusion\", views = 3 }";
        let pairs = "{ kind = \"relations\", scales = [{ views = 2, relations = 3 }] }";
        assert_eq!(views("{ kind = \"single\" }", "").unwrap(), 1);
        assert_eq!(views(fusion, "").unwrap(), 3);
        assert_eq!(views(pooling, "views = 5").unwrap(), 5);
        assert_eq!(views(pairs, "views = 2").unwrap(), 2);
        for (input, given) in [(pooling, ""), (fusion, "views = 3"), (pairs, "views = 1")] {
            let message = views(input, given).unwrap_err().to_string();
            assert!(message.starts_with("objective.views: found"), "{message}");
        }
    }

    #[test]
    fn each_value_that_cannot_be_meant_is_refused_by_name() {
        let refused = |change: fn(&mut TrainingConfig), name: &str| {
            let mut config = TrainingConfig::default();
            config.check().unwrap();
            change(&mut config);
            let message = config.check().unwrap_err().to_string();
            assert!(message.starts_with(name), "{message}");
        };
        refused(|c| c.epochs = 0, "epochs");
        refused(|c| c.batch_size = 1, "batch-size");
        refused(|c| c.micro_batch_size = Some(1), "micro-batch-size");
        refused(|c| c.micro_batch_size = Some(17), "micro-batch-size");
        refused(|c| c.adam.beta1 = 1.0, "adam.beta1");
        refused(|c| c.warmup = 1.0, "warmup");
        refused(|c| c.validation = -0.1, "validation");
        refused(|c| c.clip_norm = Some(0.0), "clip-norm");
        refused(|c| c.precision = Precision::Int8, "precision");
        refused(|c| (c.patience, c.validation) = (3, 0.0), "patience");
        refused(|c| c.augmentation.crop = 0.0, "augmentation.crop");
        refused(|c| c.augmentation.contrast = 1.0, "augmentation.contrast");
    }
}
