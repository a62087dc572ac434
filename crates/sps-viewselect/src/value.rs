//! The value network: what a set, or a policy, will lose.

use crate::adam::Adam;
use crate::problem::Problem;
use crate::stream::{Purpose, Stream};

/// A value network V on the joined probability vectors, shape (slots, views): one linear term and
/// one hidden layer of tanh units,
///
/// ```text
/// V(x) = c + w x + u tanh(b + W x)
/// ```
///
/// A set is the point where each slot's vector is 1 at its view and 0 elsewhere, so the linear term
/// holds what the slots lose each for itself, and the units hold what they lose together.
pub(crate) struct ValueNetwork {
    views: usize,
    hidden: usize,
    /// W (slots * views, hidden), then w (slots * views), b (hidden), u (hidden), c.
    parameters: Vec<f64>,
    adam: Adam,
    gradient: Vec<f64>,
}

/// The parts of the parameters, in their order.
struct Parts<T> {
    matrix: T,
    linear: T,
    bias: T,
    out: T,
    constant: T,
}

impl ValueNetwork {
    pub(crate) fn new(problem: &Problem<'_>, hidden: usize, learning_rate: f64) -> Self {
        let inputs = problem.picks() * problem.views();
        let mut parameters = vec![0.0; inputs * hidden + inputs + 2 * hidden + 1];
        let mut stream = Stream::new(problem.seed_value(), Purpose::ValueInit, 0);
        let mut fill = |part: &mut [f64], fan_in: usize| {
            // Of a set, only one input per slot is not 0.
            let bound = (3.0 / fan_in as f64).sqrt();
            part.fill_with(|| bound * (2.0 * stream.unit() - 1.0));
        };
        let parts = split_mut(&mut parameters, inputs, hidden);
        fill(parts.matrix, problem.picks());
        fill(parts.out, hidden);
        Self {
            views: problem.views(),
            hidden,
            adam: Adam::new(parameters.len(), learning_rate),
            gradient: vec![0.0; parameters.len()],
            parameters,
        }
    }

    /// V of a set.
    pub(crate) fn of_set(&self, set: &[usize]) -> f64 {
        let mut sums = self.start();
        for (slot, &view) in set.iter().enumerate() {
            sums.add(self, slot, view);
        }
        self.finish(&sums)
    }

    /// The sums of no slots; add one view per slot, then [`finish`](Self::finish).
    pub(crate) fn start(&self) -> Sums {
        let parts = self.parts();
        Sums {
            linear: parts.constant[0],
            hidden: parts.bias.to_vec(),
        }
    }

    /// V of the slots that were added.
    pub(crate) fn finish(&self, sums: &Sums) -> f64 {
        let out = self.parts().out.iter();
        sums.linear
            + out
                .zip(&sums.hidden)
                .map(|(weight, sum)| weight * sum.tanh())
                .sum::<f64>()
    }

    /// V and its gradient with respect to the joined probabilities, shape (slots, views).
    pub(crate) fn of_probabilities(&self, probabilities: &[f64]) -> (f64, Vec<f64>) {
        let sums = self.sums_of(probabilities);
        let slopes = self.slopes(&sums);
        let parts = self.parts();
        let gradient = parts
            .matrix
            .chunks_exact(self.hidden)
            .zip(parts.linear)
            .map(|(row, linear)| linear + dot(row, &slopes))
            .collect();
        (self.finish(&sums), gradient)
    }

    /// One step of Adam down the mean squared error of sets, with `share` of the learning rate.
    pub(crate) fn learn<'s>(
        &mut self,
        samples: impl ExactSizeIterator<Item = (&'s [usize], f64)>,
        on_policy: Option<(&[f64], f64)>,
        share: f64,
    ) {
        self.gradient.fill(0.0);
        let count = samples.len() + usize::from(on_policy.is_some());
        let scale = 2.0 / count.max(1) as f64;
        for (set, target) in samples {
            self.add_set_gradient(set, target, scale);
        }
        if let Some((probabilities, target)) = on_policy {
            self.add_probabilities_gradient(probabilities, target, scale);
        }
        self.adam
            .descend(&mut self.parameters, &self.gradient, share);
    }

    fn add_set_gradient(&mut self, set: &[usize], target: f64, scale: f64) {
        let mut sums = self.start();
        for (slot, &view) in set.iter().enumerate() {
            sums.add(self, slot, view);
        }
        let error = scale * (self.finish(&sums) - target);
        let slopes = self.slopes(&sums);
        let parts = self.add_head_gradient(&sums, &slopes, error);
        let hidden = slopes.len();
        for (slot, &view) in set.iter().enumerate() {
            let input = slot * parts.linear.len() / set.len() + view;
            parts.linear[input] += error;
            let row = &mut parts.matrix[input * hidden..][..hidden];
            for (gradient, slope) in row.iter_mut().zip(&slopes) {
                *gradient += error * slope;
            }
        }
    }

    fn add_probabilities_gradient(&mut self, probabilities: &[f64], target: f64, scale: f64) {
        let sums = self.sums_of(probabilities);
        let error = scale * (self.finish(&sums) - target);
        let slopes = self.slopes(&sums);
        let parts = self.add_head_gradient(&sums, &slopes, error);
        let rows = parts.matrix.chunks_exact_mut(slopes.len());
        for ((row, linear), probability) in rows.zip(parts.linear).zip(probabilities) {
            *linear += error * probability;
            for (gradient, slope) in row.iter_mut().zip(&slopes) {
                *gradient += error * slope * probability;
            }
        }
    }

    /// The gradient behind the input layer; the rest is the caller's.
    fn add_head_gradient(&mut self, sums: &Sums, slopes: &[f64], error: f64) -> Parts<&mut [f64]> {
        let inputs = self.inputs();
        let parts = split_mut(&mut self.gradient, inputs, self.hidden);
        parts.constant[0] += error;
        for (gradient, slope) in parts.bias.iter_mut().zip(slopes) {
            *gradient += error * slope;
        }
        for (gradient, sum) in parts.out.iter_mut().zip(&sums.hidden) {
            *gradient += error * sum.tanh();
        }
        parts
    }

    fn sums_of(&self, probabilities: &[f64]) -> Sums {
        let mut sums = self.start();
        let parts = self.parts();
        sums.linear += dot(parts.linear, probabilities);
        let rows = parts.matrix.chunks_exact(self.hidden);
        for (row, probability) in rows.zip(probabilities) {
            for (sum, weight) in sums.hidden.iter_mut().zip(row) {
                *sum += weight * probability;
            }
        }
        sums
    }

    /// dV / d(b + W x): `u (1 - tanh^2)`.
    fn slopes(&self, sums: &Sums) -> Vec<f64> {
        let out = self.parts().out.iter();
        out.zip(&sums.hidden)
            .map(|(weight, sum)| weight * (1.0 - sum.tanh().powi(2)))
            .collect()
    }

    fn inputs(&self) -> usize {
        (self.parameters.len() - 2 * self.hidden - 1) / (self.hidden + 1)
    }

    fn parts(&self) -> Parts<&[f64]> {
        let inputs = self.inputs();
        let (matrix, rest) = self.parameters.split_at(inputs * self.hidden);
        let (linear, rest) = rest.split_at(inputs);
        let (bias, rest) = rest.split_at(self.hidden);
        let (out, constant) = rest.split_at(self.hidden);
        Parts {
            matrix,
            linear,
            bias,
            out,
            constant,
        }
    }
}

/// Sums before the tanh units and beside them, slot by slot.
#[derive(Clone)]
pub(crate) struct Sums {
    linear: f64,
    hidden: Vec<f64>,
}

impl Sums {
    /// Adds the view of one slot.
    pub(crate) fn add(&mut self, network: &ValueNetwork, slot: usize, view: usize) {
        let parts = network.parts();
        let input = slot * network.views + view;
        self.linear += parts.linear[input];
        let row = &parts.matrix[input * network.hidden..][..network.hidden];
        for (sum, weight) in self.hidden.iter_mut().zip(row) {
            *sum += weight;
        }
    }
}

fn split_mut(all: &mut [f64], inputs: usize, hidden: usize) -> Parts<&mut [f64]> {
    let (matrix, rest) = all.split_at_mut(inputs * hidden);
    let (linear, rest) = rest.split_at_mut(inputs);
    let (bias, rest) = rest.split_at_mut(hidden);
    let (out, constant) = rest.split_at_mut(hidden);
    Parts {
        matrix,
        linear,
        bias,
        out,
        constant,
    }
}

fn dot(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}
