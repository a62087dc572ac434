//! A value network in training.

use crate::baselines::best_of;
use crate::problem::Problem;
use crate::sets::{SetList, Sets};
use crate::softmax;
use crate::stream::{Purpose, Stream};
use crate::value::ValueNetwork;
use crate::vb_nvs::ValueTraining;
use crate::vector::mean;

/// A value network and all that it was shown.
pub(crate) struct Critic {
    settings: ValueTraining,
    network: ValueNetwork,
    /// Mean and deviation of the first batch's losses: the unit of the network's targets.
    unit: Option<(f64, f64)>,
    sets: SetList,
    targets: Vec<f64>,
    stream: Stream,
}

impl Critic {
    pub(crate) fn new(settings: ValueTraining, problem: &Problem<'_>) -> Self {
        Self {
            settings,
            network: ValueNetwork::new(problem, settings.hidden, settings.learning_rate),
            unit: None,
            sets: SetList::new(problem.picks()),
            targets: Vec::new(),
            stream: Stream::new(problem.seed_value(), Purpose::ValueBatches, 0),
        }
    }

    /// Takes in sets and trains, with `share` of the learning rate. Sets that were drawn from a
    /// policy come with its joined probabilities, for which the network learns their mean loss.
    ///
    /// Half of each batch is drawn from these sets, half from all that came so far.
    pub(crate) fn learn(
        &mut self,
        sets: Sets<'_>,
        losses: &[f64],
        probabilities: Option<&[f64]>,
        share: f64,
    ) {
        let (middle, unit) = *self.unit.get_or_insert_with(|| spread(losses));
        let targets = losses.iter().map(|loss| (loss - middle) / unit);
        self.targets.extend(targets);
        self.sets.append(sets);
        let on_policy = probabilities.map(|joined| (joined, (mean(losses) - middle) / unit));
        for _ in 0..self.settings.steps {
            let drawn = self.draw(losses.len());
            let (known, targets) = (self.sets.as_sets(), &self.targets);
            let samples = drawn.iter().map(|&at| (known.get(at), targets[at]));
            self.network.learn(samples, on_policy, share);
        }
    }

    /// Indices of a batch, every second one among the last `recent`.
    fn draw(&mut self, recent: usize) -> Vec<usize> {
        let all = self.targets.len();
        (0..self.settings.batch)
            .map(|place| {
                let among = if place % 2 == 0 { all } else { recent };
                all - 1 - self.stream.below(among)
            })
            .collect()
    }

    /// The set of lowest loss so far; there is one.
    pub(crate) fn best_set(&self) -> Vec<usize> {
        best_of(self.sets.as_sets(), &self.targets)
    }

    pub(crate) fn network(&self) -> &ValueNetwork {
        &self.network
    }

    /// The gradient of the expected loss, in units of its spread, with respect to z.
    pub(crate) fn error_signal(&self, probabilities: &[f64], views: usize) -> Vec<f64> {
        let gradient = self.network.input_gradient(probabilities);
        let rows = probabilities.chunks_exact(views);
        let rows = rows.zip(gradient.chunks_exact(views));
        rows.flat_map(|(row, gradient)| softmax::backward(row, gradient))
            .map(|gradient| self.settings.weight * gradient)
            .collect()
    }
}

/// Mean and deviation; a deviation of 1 where there is none.
fn spread(losses: &[f64]) -> (f64, f64) {
    let middle = mean(losses);
    let squares = losses.iter().map(|loss| (loss - middle).powi(2));
    let deviation = (squares.sum::<f64>() / losses.len() as f64).sqrt();
    (middle, if deviation > 0.0 { deviation } else { 1.0 })
}
