use serde::{Deserialize, Serialize};

use super::trained::EpochLosses;
use crate::error::{Result, require};
use crate::labels::LabelSource;
use crate::optim::AdamConfig;

/// What a head is and how it is trained; [`Head::new`](super::Head::new) checks it.
///
/// The comment on each field says where its default comes from. "Measured" points to
/// `docs/heads.md`; the paper's supplement, which holds its further settings, was not at hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct HeadConfig {
    /// How the views of a surface enter. Default: one view (paper, section 4.2).
    pub input: Input,
    /// How embeddings are scaled. Default: one common scale. Measured.
    pub scale: Scale,
    /// What stands between embedding and value. Default: the cross-modal network.
    pub model: Model,
    /// Passes over the training surfaces. Paper, section 4.2: 30.
    pub epochs: usize,
    /// Surfaces per step. Not printed in the paper. Measured.
    pub batch_size: usize,
    /// The optimiser. The paper prints the learning rate, not the optimiser.
    pub adam: AdamConfig,
    /// Largest norm of a trial's gradient, generator and discriminator side each on its own.
    /// Default: none, as the paper mentions none; Adam's step does not grow with the gradient.
    pub clip_norm: Option<f64>,
    /// Whether the weights of the best epoch on a validation part are kept. Default: no, as the
    /// paper mentions none, and the last epoch's are kept.
    pub early_stopping: Option<EarlyStopping>,
}

/// Which epoch's weights are kept: for each trial those with the least `L_est` on the validation
/// part of its rerun ([`Rerun::validation`](sps_regress::Rerun::validation)). Where no epoch beats the
/// training mean there, the training mean is the estimate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct EarlyStopping {
    /// Epochs without a better one after which a trial ends; 0: all epochs are run.
    pub patience: usize,
    /// Share of a rerun's training surfaces to hold out, for who draws the validation part: the
    /// heads take the part that the plan names, whatever its size.
    pub validation: f64,
}

impl Default for EarlyStopping {
    fn default() -> Self {
        Self {
            patience: 0,
            validation: 0.15,
        }
    }
}

impl Default for HeadConfig {
    fn default() -> Self {
        Self {
            input: Input::Single {},
            scale: Scale::Common,
            model: Model::CrossModal(CrossModal::default()),
            epochs: 30,
            batch_size: 16,
            adam: AdamConfig {
                weight_decay: 5.0,
                ..AdamConfig::default()
            },
            clip_norm: None,
            early_stopping: None,
        }
    }
}

/// How the views of a surface become the network's visual input.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Input {
    /// One view.
    Single {},
    /// The embeddings of some views side by side, through one linear layer (paper, section 4.2,
    /// "late feature fusion"). The layer is a sum of one term per slot.
    LateFusion {
        /// Slots: how many views enter.
        views: usize,
    },
    /// The largest value of each feature over all views (Su et al. 2015).
    ViewPooling {},
    /// Relations between views in order, at several scales (Zhou et al. 2018, equation 2): a sum
    /// over the scales of the mean over a scale's relations of two layers on the relation's
    /// embeddings side by side. Which views are related is drawn by who writes the plan
    /// ([`Views::Steps`](super::Views::Steps)).
    Relations {
        /// The scales. Their slots stand one scale after the other, relation by relation.
        scales: Vec<RelationScale>,
    },
}

/// One scale of [`Input::Relations`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RelationScale {
    /// Views of a relation.
    pub views: usize,
    /// Relations that enter at once.
    pub relations: usize,
}

impl RelationScale {
    /// How many slots it has.
    pub(super) fn slots(&self) -> usize {
        self.views.saturating_mul(self.relations)
    }
}

/// How embeddings are scaled before they enter a head, by statistics of the training surfaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scale {
    /// Each feature is centred; all are divided by one number, the root mean square of their
    /// standard deviations. Features keep their relative size, so a channel that is almost
    /// always zero stays small.
    #[default]
    Common,
    /// Each feature is centred and divided by its own standard deviation, or by a tenth of the
    /// common scale where its own is smaller: a feature that was silent in training must not
    /// be blown up when it speaks.
    PerFeature,
    /// As they come.
    None,
}

/// What stands between embedding and value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Model {
    /// A linear layer from embedding to value, without a latent space (paper, section 4.1,
    /// "Regression Baseline").
    Regression {},
    /// Vision to latent space to value, with touch encoded into the same space (paper, section
    /// 4.1, "Cross-Modal Network").
    CrossModal(CrossModal),
}

impl Model {
    pub(super) fn labels(&self) -> Option<&LabelSource> {
        match self {
            Self::Regression {} => None,
            Self::CrossModal(model) => Some(&model.classification.as_ref()?.labels),
        }
    }

    /// How much each loss counts; one that is not there counts for 0.
    pub(crate) fn loss_weights(&self) -> EpochLosses {
        let mut weights = EpochLosses {
            estimation: 1.0,
            ..EpochLosses::default()
        };
        if let Self::CrossModal(model) = self {
            let (game, classes) = (&model.adversarial, &model.classification);
            weights.embedding = model.embedding_weight;
            weights.generator = game.as_ref().map_or(0.0, |game| game.weight);
            weights.discriminator = f64::from(u8::from(game.is_some()));
            weights.classification = classes.as_ref().map_or(0.0, |c| c.weight);
        }
        weights
    }
}

/// The cross-modal network and its losses,
/// `L = L_est + l1 L_emb + l2 L_adv + l3 L_class`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct CrossModal {
    /// Size of the latent space. Paper, section 4.2: 50 for one image, 100 for several.
    pub latent: usize,
    /// Units of the hidden layer of generator and tactile encoder. Not printed in the paper; as
    /// many as the latent space of the single-image network.
    pub hidden: usize,
    /// `l1`, weight of `L_emb`. Not printed in the paper. Measured. At 0 there is no tactile encoder.
    pub embedding_weight: f64,
    /// `l2` and the discriminator; none leaves `L_adv` out.
    pub adversarial: Option<Adversarial>,
    /// `l3` and the labels; none leaves `L_class` out.
    pub classification: Option<Classification>,
}

impl Default for CrossModal {
    fn default() -> Self {
        Self {
            latent: 50,
            hidden: 50,
            embedding_weight: 0.01,
            adversarial: None,
            classification: None,
        }
    }
}

/// The adversarial objective.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Adversarial {
    /// `l2`. Not printed in the paper. Measured.
    pub weight: f64,
    /// Units of the discriminator's hidden layer. Not printed in the paper; as in the generator.
    pub hidden: usize,
}

impl Default for Adversarial {
    fn default() -> Self {
        Self {
            weight: 1.0,
            hidden: 50,
        }
    }
}

/// The auxiliary classification objective.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Classification {
    /// `l3`. Not printed in the paper. Measured.
    #[serde(default = "default_classification_weight")]
    pub weight: f64,
    /// The labels.
    pub labels: LabelSource,
}

impl Classification {
    /// The labels, with the default weight.
    pub fn new(labels: LabelSource) -> Self {
        Self {
            weight: default_classification_weight(),
            labels,
        }
    }
}

fn default_classification_weight() -> f64 {
    0.3
}

impl HeadConfig {
    /// Refuses the first value that is out of its range.
    pub(crate) fn check(&self) -> Result<()> {
        at_least_one("epochs", self.epochs)?;
        at_least_one("batch-size", self.batch_size)?;
        self.adam.check()?;
        if let Some(norm) = self.clip_norm {
            positive("clip-norm", norm)?;
        }
        if let Some(EarlyStopping { validation, .. }) = self.early_stopping {
            let share = validation > 0.0 && validation < 1.0;
            let expected = "above 0, below 1";
            require(share, "early-stopping.validation", validation, expected)?;
        }
        self.input.check(&self.model)?;
        match &self.model {
            Model::Regression {} => Ok(()),
            Model::CrossModal(model) => model.check(),
        }
    }
}

/// More views side by side than anyone has, and few enough to multiply by an embedding's width.
const MOST_SLOTS: usize = 1 << 16;

impl Input {
    fn check(&self, model: &Model) -> Result<()> {
        let slots = self.slots();
        require(slots <= MOST_SLOTS, "input", slots, "at most 65536 slots")?;
        match self {
            Self::Single {} | Self::ViewPooling {} => Ok(()),
            Self::LateFusion { views } => at_least_one("input.views", *views),
            Self::Relations { scales } => {
                at_least_one("input.scales", scales.len())?;
                for scale in scales {
                    at_least_one("input.scales.views", scale.views)?;
                    at_least_one("input.scales.relations", scale.relations)?;
                }
                let latent = matches!(model, Model::CrossModal(_));
                require(latent, "model", "regression", "cross-modal under relations")
            }
        }
    }
}

impl CrossModal {
    fn check(&self) -> Result<()> {
        at_least_one("model.latent", self.latent)?;
        at_least_one("model.hidden", self.hidden)?;
        let weight = self.embedding_weight;
        let sensible = weight.is_finite() && weight >= 0.0;
        require(sensible, "model.embedding-weight", weight, "0 or more")?;
        if let Some(adversarial) = &self.adversarial {
            at_least_one("model.adversarial.hidden", adversarial.hidden)?;
            positive("model.adversarial.weight", adversarial.weight)?;
        }
        if let Some(classification) = &self.classification {
            positive("model.classification.weight", classification.weight)?;
            classification.labels.check()?;
        }
        Ok(())
    }
}

fn at_least_one(key: &'static str, value: usize) -> Result<()> {
    require(value >= 1, key, value, "at least 1")
}

fn positive(key: &'static str, value: f64) -> Result<()> {
    require(value.is_finite() && value > 0.0, key, value, "above 0")
}
