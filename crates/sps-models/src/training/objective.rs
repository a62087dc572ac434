use candle_core::{D, Device, Tensor, Var};
use candle_nn::ops::log_softmax;
use rand::Rng;
use serde::{Deserialize, Serialize};

use super::targets::{Classes, Standards, Targets};
use crate::data::Readings;
use crate::error::Result;
use crate::rng::stream;

/// Linear layers from embedding to values, class scores and another encoder's features, and the loss
/// of what they say.
///
/// The loss is the mean squared error of the standardised values, plus the cross-entropy of the
/// classes, plus the weighted mean squared error of the standardised features, each a mean over the
/// batch.
#[derive(Debug)]
pub(super) struct Objective {
    values: Option<(Readings, Standards, Layer)>,
    classes: Option<(Classes, Layer)>,
    features: Option<Taught>,
}

/// What a teacher's features are learnt by.
#[derive(Debug)]
struct Taught {
    /// Standardised, `(images, width)`.
    features: Tensor,
    weight: f64,
    layer: Layer,
}

/// Parts of a loss; their sum is what training makes small.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Losses {
    /// Mean squared error of the values, in units of their variance in training.
    pub values: f64,
    /// Cross-entropy of the classes, in nats.
    pub classes: f64,
    /// Share of images whose class has the highest score.
    pub accuracy: f64,
    /// Mean squared error of another encoder's features, in units of their variance in training,
    /// times its weight.
    #[serde(default)]
    pub features: f64,
}

impl Losses {
    /// What training makes small.
    pub fn total(&self) -> f64 {
        self.values + self.classes + self.features
    }

    pub(super) fn add(&mut self, other: &Self, weight: f64) {
        self.values += weight * other.values;
        self.classes += weight * other.classes;
        self.accuracy += weight * other.accuracy;
        self.features += weight * other.features;
    }
}

impl Objective {
    pub(super) fn new(
        targets: Targets,
        training: &[usize],
        width: usize,
        seed: u64,
    ) -> Result<Self> {
        let layer = |name: &'static str, outputs| Layer::new(name, width, outputs, seed);
        let values = match targets.values {
            Some(readings) => {
                let layer = layer("values", readings.properties().len())?;
                let standards = Standards::of(&readings, training);
                Some((readings, standards, layer))
            }
            None => None,
        };
        let classes = match targets.classes {
            Some(classes) => {
                let layer = layer("classes", classes.count as usize)?;
                Some((classes, layer))
            }
            None => None,
        };
        let features = match targets.features {
            Some(features) => Some(Taught {
                features: features.standardised(training)?,
                weight: features.weight,
                layer: layer("features", features.embeddings.dim(1)?)?,
            }),
            None => None,
        };
        Ok(Self {
            values,
            classes,
            features,
        })
    }

    /// The layers' parameters, by name.
    pub(super) fn parameters(&self) -> impl Iterator<Item = (String, &Var)> {
        let values = self.values.iter().map(|(_, _, layer)| layer);
        let classes = self.classes.iter().map(|(_, layer)| layer);
        let features = self.features.iter().map(|taught| &taught.layer);
        let layers = values.chain(classes).chain(features);
        layers.flat_map(Layer::parameters)
    }

    /// The loss of `embeddings`, `(images, width)`, of the given images: as a tensor to
    /// differentiate, and its parts as numbers.
    pub(super) fn loss(&self, embeddings: &Tensor, images: &[usize]) -> Result<(Tensor, Losses)> {
        let mut losses = Losses::default();
        let mut total = Tensor::zeros((), embeddings.dtype(), embeddings.device())?;
        if let Some((readings, standards, layer)) = &self.values {
            let (values, present) = standards.tensors(readings, images)?;
            let error = layer.apply(embeddings)?.sub(&values)?;
            let count = present.sum_all()?.to_scalar::<f32>()?.max(1.0);
            let squares = (error.sqr()? * present)?;
            let loss = (squares.sum_all()? / f64::from(count))?;
            losses.values = f64::from(loss.to_scalar::<f32>()?);
            total = (total + loss)?;
        }
        if let Some((classes, layer)) = &self.classes {
            let labels: Vec<u32> = images.iter().map(|&i| classes.of_image[i]).collect();
            let labels = Tensor::new(labels, embeddings.device())?;
            let scores = layer.apply(embeddings)?;
            let best = scores.detach().argmax(D::Minus1)?;
            let right = best.eq(&labels)?.to_dtype(embeddings.dtype())?;
            losses.accuracy = f64::from(right.mean_all()?.to_scalar::<f32>()?);
            let own = log_softmax(&scores, D::Minus1)?.gather(&labels.unsqueeze(1)?, 1)?;
            let loss = own.mean_all()?.neg()?;
            losses.classes = f64::from(loss.to_scalar::<f32>()?);
            total = (total + loss)?;
        }
        if let Some(taught) = &self.features {
            let loss = taught.loss(embeddings, images)?;
            losses.features = f64::from(loss.to_scalar::<f32>()?);
            total = (total + loss)?;
        }
        Ok((total, losses))
    }
}

impl Taught {
    fn loss(&self, embeddings: &Tensor, images: &[usize]) -> Result<Tensor> {
        let rows: Vec<u32> = images.iter().map(|&image| image as u32).collect();
        let rows = Tensor::new(rows, embeddings.device())?;
        let wanted = self.features.index_select(&rows, 0)?;
        let error = self.layer.apply(embeddings)?.sub(&wanted)?;
        Ok((error.sqr()?.mean_all()? * self.weight)?)
    }
}

/// `x W^T + b`.
#[derive(Debug)]
struct Layer {
    name: &'static str,
    weight: Var,
    bias: Var,
}

impl Layer {
    /// Filled as PyTorch fills a linear layer: uniformly within 1 / sqrt(width).
    fn new(name: &'static str, width: usize, outputs: usize, seed: u64) -> Result<Self> {
        let bound = 1.0 / (width as f32).sqrt();
        let draw = |leaf: &str, shape: &[usize]| {
            let mut rng = stream(seed, &format!("training/init/{name}.{leaf}"), 0);
            let values = (0..shape.iter().product()).map(|_| rng.random_range(-bound..bound));
            let values = Tensor::from_vec(values.collect::<Vec<f32>>(), shape, &Device::Cpu)?;
            Var::from_tensor(&values)
        };
        Ok(Self {
            name,
            weight: draw("weight", &[outputs, width])?,
            bias: draw("bias", &[outputs])?,
        })
    }

    fn parameters(&self) -> [(String, &Var); 2] {
        let name = |leaf: &str| format!("{}.{leaf}", self.name);
        [(name("weight"), &self.weight), (name("bias"), &self.bias)]
    }

    fn apply(&self, x: &Tensor) -> Result<Tensor> {
        let products = x.matmul(&self.weight.as_tensor().t()?)?;
        Ok(products.broadcast_add(self.bias.as_tensor())?)
    }
}

#[cfg(test)]
mod tests {
    use super::super::targets::Features;
    use super::*;

    fn targets() -> Targets {
        let rows = [
            vec![Some(1.0), Some(10.0)],
            vec![Some(3.0), None],
            vec![Some(5.0), Some(30.0)],
        ];
        let names = vec!["a".to_owned(), "b".to_owned()];
        Targets {
            values: Some(Readings::new(names, &rows).unwrap()),
            classes: Some(Classes {
                of_image: vec![0, 1, 1],
                count: 2,
            }),
            features: None,
        }
    }

    #[test]
    fn the_loss_is_that_of_its_definition() {
        let objective = Objective::new(targets(), &[0, 1, 2], 2, 0).unwrap();
        for (name, var) in objective.parameters() {
            let zero = var.zeros_like().unwrap();
            // Class 1 scores ln 3 above class 0 everywhere; values are estimated as the mean.
            let value = if name == "classes.bias" {
                Tensor::new(&[0.0f32, 3f32.ln()], &Device::Cpu).unwrap()
            } else {
                zero
            };
            var.set(&value).unwrap();
        }
        let embeddings = Tensor::zeros((3, 2), candle_core::DType::F32, &Device::Cpu).unwrap();
        let (loss, parts) = objective.loss(&embeddings, &[0, 1, 2]).unwrap();
        // Column a: standardised to -1.2247, 0, 1.2247; column b to -1, -, 1; five values.
        let values = (1.5 + 1.5 + 1.0 + 1.0) / 5.0;
        let classes = (4f64.ln() + 2.0 * (4.0f64 / 3.0).ln()) / 3.0;
        assert!((parts.values - values).abs() < 1e-6, "{parts:?}");
        assert!((parts.classes - classes).abs() < 1e-6, "{parts:?}");
        assert!((parts.accuracy - 2.0 / 3.0).abs() < 1e-6, "{parts:?}");
        let total = f64::from(loss.to_scalar::<f32>().unwrap());
        assert!((total - parts.total()).abs() < 1e-6);
    }

    #[test]
    fn the_loss_of_features_is_that_of_its_definition() {
        let rows = [[1.0f32, 5.0], [3.0, 5.0], [5.0, 5.0], [99.0, 7.0]];
        let targets = Targets {
            features: Some(Features {
                embeddings: Tensor::new(&rows, &Device::Cpu).unwrap(),
                weight: 2.0,
            }),
            ..Targets::default()
        };
        let objective = Objective::new(targets, &[0, 1, 2], 2, 0).unwrap();
        for (_, var) in objective.parameters() {
            var.set(&var.zeros_like().unwrap()).unwrap();
        }
        let embeddings = Tensor::zeros((2, 2), candle_core::DType::F32, &Device::Cpu).unwrap();
        let (loss, parts) = objective.loss(&embeddings, &[2, 1]).unwrap();
        // Column 1: standardised to 1.2247 and 0; column 2 never changes and is 0.
        let expected = 2.0 * 1.5 / 4.0;
        assert!((parts.features - expected).abs() < 1e-6, "{parts:?}");
        assert!((f64::from(loss.to_scalar::<f32>().unwrap()) - expected).abs() < 1e-6);
    }

    #[test]
    fn every_parameter_receives_a_gradient() {
        let objective = Objective::new(targets(), &[0, 1, 2], 4, 0).unwrap();
        let embeddings = Tensor::ones((3, 4), candle_core::DType::F32, &Device::Cpu).unwrap();
        let (loss, _) = objective.loss(&embeddings, &[0, 1, 2]).unwrap();
        let gradients = loss.backward().unwrap();
        for (name, var) in objective.parameters() {
            let gradient = gradients.get(var).unwrap().abs().unwrap();
            let sum = gradient.sum_all().unwrap().to_scalar::<f32>().unwrap();
            assert!(sum > 0.0, "{name}");
        }
    }

    mod hard_cases {
        use super::*;

        /// Scores of some 1e4, against the definition in f64.
        #[test]
        fn class_scores_of_1e4_have_their_loss() {
            let objective = Objective::new(targets(), &[0, 1, 2], 2, 0).unwrap();
            for (name, var) in objective.parameters() {
                if name == "classes.weight" {
                    let rows = [[1.0_f32, 0.5], [-0.5, 0.75]];
                    var.set(&Tensor::new(&rows, &Device::Cpu).unwrap()).unwrap();
                } else if name == "classes.bias" {
                    var.set(&var.zeros_like().unwrap()).unwrap();
                }
            }
            let embeddings = Tensor::full(1e4f32, (3, 2), &Device::Cpu).unwrap();
            let (loss, parts) = objective.loss(&embeddings, &[0, 1, 2]).unwrap();
            // Class 0 scores 15,000 and class 1 2,500; one image is of class 0, two of class 1.
            let expected = 2.0 * 12_500.0 / 3.0;
            let error = (parts.classes / expected - 1.0).abs();
            let sum = 15_000_f32.exp() + 2_500_f32.exp();
            let naive = -(2_500_f32.exp() / sum).ln();
            println!("class scores of 1e4: error {error:.1e}, bound 2e-7, naive form {naive}");
            assert!(error <= 2e-7, "{parts:?}");
            assert!(naive.is_nan(), "the naive form");
            let gradients = loss.backward().unwrap();
            for (name, var) in objective.parameters() {
                let gradient = gradients.get(var).unwrap().flatten_all().unwrap();
                let gradient = gradient.to_vec1::<f32>().unwrap();
                assert!(gradient.iter().all(|g| g.is_finite()), "{name}");
                if name == "classes.bias" {
                    assert!((gradient[0] - 2.0 / 3.0).abs() <= 1e-7, "{gradient:?}");
                    assert!((gradient[1] + 2.0 / 3.0).abs() <= 1e-7, "{gradient:?}");
                }
            }
        }
    }
}
