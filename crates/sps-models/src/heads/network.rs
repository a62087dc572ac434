//! The networks, each a stack of equal ones with weights of their own.

use candle_core::{DType, Device, Result, Tensor, bail};

use super::config::{CrossModal, HeadConfig, Input, Model, RelationScale};
use crate::stacked::{Parameter, leaky_relu, linear, matmul};
use crate::weights::TensorSpec;

/// Sizes that the data decide.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Dims {
    /// Slots of the visual input.
    pub(super) slots: usize,
    /// Features of one slot.
    pub(super) width: usize,
    /// Classes of the auxiliary classifier.
    pub(super) classes: usize,
}

/// A parameter of one trial, before it is filled.
pub(super) struct Spec<'a> {
    pub(super) name: &'a str,
    /// `(inputs, outputs)` of a weight, `(outputs)` of a bias.
    pub(super) shape: &'a [usize],
    /// Inputs of the layer.
    pub(super) fan_in: usize,
}

/// Gives the stacked tensor `(trials, ..shape)` for each parameter asked for.
pub(super) type Fill<'a> = dyn FnMut(&Spec<'_>) -> crate::Result<Parameter> + 'a;

/// The parameters of one trial's network.
pub(super) fn specs(config: &HeadConfig, dims: Dims) -> crate::Result<Vec<TensorSpec>> {
    let mut specs = Vec::new();
    let nothing = Tensor::zeros(0, DType::F32, &Device::Cpu)?;
    let mut fill = |spec: &Spec<'_>| {
        specs.push(TensorSpec::new(spec.name, spec.shape));
        Ok(Parameter::constant(nothing.clone()))
    };
    Network::new(&mut fill, config, dims)?;
    Ok(specs)
}

/// A linear layer, `(inputs, outputs)`.
pub(super) struct Linear {
    weight: Parameter,
    bias: Parameter,
}

impl Linear {
    fn new(fill: &mut Fill<'_>, name: &str, inputs: usize, outputs: usize) -> crate::Result<Self> {
        let mut fill = |part: &str, shape: &[usize]| {
            let name = &format!("{name}.{part}");
            fill(&Spec {
                name,
                shape,
                fan_in: inputs,
            })
        };
        Ok(Self {
            weight: fill("weight", &[inputs, outputs])?,
            bias: fill("bias", &[outputs])?,
        })
    }

    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        linear(x, &self.weight, &self.bias)
    }
}

/// Two linear layers with a rectifier between them.
pub(super) struct TwoLayers {
    hidden: Linear,
    output: Linear,
}

impl TwoLayers {
    fn new(fill: &mut Fill<'_>, name: &str, sizes: [usize; 3]) -> crate::Result<Self> {
        let [inputs, hidden, outputs] = sizes;
        Ok(Self {
            hidden: Linear::new(fill, &format!("{name}.hidden"), inputs, hidden)?,
            output: Linear::new(fill, &format!("{name}.output"), hidden, outputs)?,
        })
    }

    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        self.output.forward(&self.hidden.forward(x)?.relu()?)
    }
}

/// `D(v, t)` as a logit: one hidden layer over the image embedding and the tactile value.
///
/// The hidden layer is kept as two terms, `v W_v + b` and `t W_t`, because the first is the same
/// for the measured and the generated value.
pub(super) struct Discriminator {
    /// The embedding's term.
    pub(super) visual: Linear,
    tactile: Parameter,
    logit: Linear,
}

impl Discriminator {
    fn new(fill: &mut Fill<'_>, width: usize, hidden: usize) -> crate::Result<Self> {
        Ok(Self {
            visual: Linear::new(fill, "discriminator.visual", width, hidden)?,
            tactile: fill(&Spec {
                name: "discriminator.tactile.weight",
                shape: &[1, hidden],
                // The value enters the layer beside the embedding.
                fan_in: width + 1,
            })?,
            logit: Linear::new(fill, "discriminator.logit", hidden, 1)?,
        })
    }

    /// The same discriminator as a constant, for the generator's side of the game.
    pub(super) fn frozen(&self) -> Self {
        let constant = |layer: &Linear| Linear {
            weight: layer.weight.frozen(),
            bias: layer.bias.frozen(),
        };
        Self {
            visual: constant(&self.visual),
            tactile: self.tactile.frozen(),
            logit: constant(&self.logit),
        }
    }

    /// The logit for values `(trials, rows, 1)` beside the embeddings' term.
    pub(super) fn logit(&self, visual_term: &Tensor, value: &Tensor) -> Result<Tensor> {
        let hidden = (visual_term + matmul(value, &self.tactile)?)?;
        self.logit.forward(&leaky_relu(&hidden)?)?.squeeze(2)
    }
}

/// From the visual input to the latent space.
enum Vision {
    /// The views side by side through one layer (paper, section 4.2, "late feature fusion").
    Fusion(Linear),
    Relations(Vec<Relation>),
}

impl Vision {
    fn new(fill: &mut Fill<'_>, input: &Input, dims: Dims, latent: usize) -> crate::Result<Self> {
        let Input::Relations { scales } = input else {
            let inputs = dims.slots * dims.width;
            return Ok(Self::Fusion(Linear::new(fill, "visual", inputs, latent)?));
        };
        let mut start = 0;
        let relations = scales.iter().enumerate().map(|(at, &scale)| {
            let sizes = [scale.views * dims.width, latent, latent];
            let relation = Relation {
                layers: TwoLayers::new(fill, &format!("relations.{at}"), sizes)?,
                scale,
                start,
                width: dims.width,
            };
            start += scale.slots() * dims.width;
            Ok(relation)
        });
        Ok(Self::Relations(relations.collect::<crate::Result<_>>()?))
    }

    /// `(trials, rows, latent)`.
    fn forward(&self, visual: &Tensor) -> Result<Tensor> {
        match self {
            Self::Fusion(layer) => layer.forward(visual),
            Self::Relations(relations) => {
                let terms = relations.iter().map(|one| one.forward(visual));
                match terms.reduce(|sum, term| sum? + term?) {
                    Some(sum) => sum,
                    None => bail!("relations without a scale"),
                }
            }
        }
    }
}

/// One scale of relations: `mean_i h(g(views_i))`.
struct Relation {
    layers: TwoLayers,
    scale: RelationScale,
    /// Where its inputs start.
    start: usize,
    width: usize,
}

impl Relation {
    fn forward(&self, visual: &Tensor) -> Result<Tensor> {
        let (trials, rows, _) = visual.dims3()?;
        let RelationScale { views, relations } = self.scale;
        let inputs = visual
            .narrow(2, self.start, relations * views * self.width)?
            .contiguous()?
            .reshape((trials, rows * relations, views * self.width))?;
        let terms = self.layers.forward(&inputs)?;
        terms.reshape((trials, rows, relations, ()))?.mean(2)
    }
}

/// The parts of the paper's figure 3 behind the image encoder.
pub(super) struct CrossModalNetwork {
    visual: Vision,
    pub(super) generator: TwoLayers,
    /// From values `(trials, rows, 1)` to `e_t`, `(trials, rows, latent)`.
    pub(super) tactile: Option<TwoLayers>,
    pub(super) discriminator: Option<Discriminator>,
    /// From `e_v` to logits, `(trials, rows, classes)`.
    pub(super) classifier: Option<Linear>,
}

impl CrossModalNetwork {
    fn new(
        fill: &mut Fill<'_>,
        input: &Input,
        model: &CrossModal,
        dims: Dims,
    ) -> crate::Result<Self> {
        let CrossModal { latent, hidden, .. } = *model;
        Ok(Self {
            visual: Vision::new(fill, input, dims, latent)?,
            generator: TwoLayers::new(fill, "generator", [latent, hidden, 1])?,
            tactile: if model.embedding_weight > 0.0 {
                Some(TwoLayers::new(fill, "tactile", [1, hidden, latent])?)
            } else {
                None
            },
            discriminator: match &model.adversarial {
                Some(game) => Some(Discriminator::new(fill, dims.width, game.hidden)?),
                None => None,
            },
            classifier: match &model.classification {
                Some(_) => Some(Linear::new(fill, "classifier", latent, dims.classes)?),
                None => None,
            },
        })
    }

    /// `e_v`, `(trials, rows, latent)`.
    pub(super) fn latent(&self, visual: &Tensor) -> Result<Tensor> {
        self.visual.forward(visual)
    }
}

/// A stack of networks.
pub(super) enum Network {
    Regression(Linear),
    CrossModal(Box<CrossModalNetwork>),
}

impl Network {
    pub(super) fn new(fill: &mut Fill<'_>, config: &HeadConfig, dims: Dims) -> crate::Result<Self> {
        Ok(match &config.model {
            Model::Regression {} => {
                Self::Regression(Linear::new(fill, "value", dims.slots * dims.width, 1)?)
            }
            Model::CrossModal(model) => {
                let network = CrossModalNetwork::new(fill, &config.input, model, dims)?;
                Self::CrossModal(Box::new(network))
            }
        })
    }

    /// Standardised estimates `(trials, rows, 1)` for the visual input
    /// `(trials, rows, slots x width)`.
    pub(super) fn estimate(&self, visual: &Tensor) -> Result<Tensor> {
        match self {
            Self::Regression(value) => value.forward(visual),
            Self::CrossModal(network) => network.generator.forward(&network.latent(visual)?),
        }
    }
}

/// Whether a parameter is trained against the others.
pub(super) fn is_discriminator(name: &str) -> bool {
    name.starts_with("discriminator.")
}
