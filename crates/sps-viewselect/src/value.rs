//! The value network: what a set, or a policy, will lose.

use crate::adam::Adam;
use crate::problem::Problem;
use crate::stream::{Purpose, Stream};
use crate::vector::{add, dot};

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
    parameters: Parameters,
    adam: [Adam; 5],
    gradient: Parameters,
}

/// W (slots * views, hidden), w (slots * views), b (hidden), u (hidden) and c.
#[derive(Clone)]
struct Parameters {
    matrix: Vec<f64>,
    linear: Vec<f64>,
    bias: Vec<f64>,
    out: Vec<f64>,
    constant: Vec<f64>,
}

impl Parameters {
    fn zeros(inputs: usize, hidden: usize) -> Self {
        Self {
            matrix: vec![0.0; inputs * hidden],
            linear: vec![0.0; inputs],
            bias: vec![0.0; hidden],
            out: vec![0.0; hidden],
            constant: vec![0.0],
        }
    }

    fn all(&mut self) -> [&mut Vec<f64>; 5] {
        [
            &mut self.matrix,
            &mut self.linear,
            &mut self.bias,
            &mut self.out,
            &mut self.constant,
        ]
    }
}

impl ValueNetwork {
    pub(crate) fn new(problem: &Problem<'_>, hidden: usize, learning_rate: f64) -> Self {
        let mut parameters = Parameters::zeros(problem.picks() * problem.views(), hidden);
        let mut stream = Stream::new(problem.seed_value(), Purpose::ValueInit, 0);
        let mut fill = |part: &mut [f64], fan_in: usize| {
            // Of a set, only one input per slot is not 0.
            let bound = (3.0 / fan_in as f64).sqrt();
            part.fill_with(|| bound * (2.0 * stream.unit() - 1.0));
        };
        fill(&mut parameters.matrix, problem.picks());
        fill(&mut parameters.out, hidden);
        let adam = |part: &mut Vec<f64>| Adam::new(part.len(), learning_rate);
        Self {
            views: problem.views(),
            hidden,
            adam: parameters.all().map(adam),
            gradient: parameters.clone(),
            parameters,
        }
    }

    /// V of a set.
    pub(crate) fn of_set(&self, set: &[usize]) -> f64 {
        self.finish(&self.sums_of_set(set))
    }

    /// The sums of no slots; add one view per slot, then [`finish`](Self::finish).
    pub(crate) fn start(&self) -> Sums {
        Sums {
            linear: self.parameters.constant[0],
            hidden: self.parameters.bias.clone(),
        }
    }

    /// V of the slots that were added.
    pub(crate) fn finish(&self, sums: &Sums) -> f64 {
        let units = self.parameters.out.iter().zip(&sums.hidden);
        let units = units.map(|(weight, sum)| weight * sum.tanh());
        sums.linear + units.sum::<f64>()
    }

    /// V, the units' outputs, and dV / d(b + W x) = `u (1 - tanh^2)`.
    fn activate(&self, sums: &Sums) -> Activation {
        let out = &self.parameters.out;
        let units: Vec<f64> = sums.hidden.iter().map(|sum| sum.tanh()).collect();
        let slopes = out.iter().zip(&units);
        let slopes = slopes.map(|(weight, unit)| weight * (1.0 - unit * unit));
        Activation {
            value: sums.linear + dot(out, &units),
            slopes: slopes.collect(),
            units,
        }
    }

    /// The gradient of V with respect to the joined probabilities, shape (slots, views).
    pub(crate) fn input_gradient(&self, probabilities: &[f64]) -> Vec<f64> {
        let slopes = self.activate(&self.sums_of(probabilities)).slopes;
        let rows = self.parameters.matrix.chunks_exact(self.hidden);
        let rows = rows.zip(&self.parameters.linear);
        rows.map(|(row, linear)| linear + dot(row, &slopes))
            .collect()
    }

    /// One step of Adam down the mean squared error of sets, with `share` of the learning rate.
    pub(crate) fn learn<'s>(
        &mut self,
        samples: impl ExactSizeIterator<Item = (&'s [usize], f64)>,
        on_policy: Option<(&[f64], f64)>,
        share: f64,
    ) {
        for part in self.gradient.all() {
            part.fill(0.0);
        }
        let count = samples.len() + usize::from(on_policy.is_some());
        let scale = 2.0 / count.max(1) as f64;
        for (set, target) in samples {
            self.add_set_gradient(set, target, scale);
        }
        if let Some((probabilities, target)) = on_policy {
            self.add_probabilities_gradient(probabilities, target, scale);
        }
        let parts = self.parameters.all().into_iter().zip(self.gradient.all());
        for (adam, (part, gradient)) in self.adam.iter_mut().zip(parts) {
            adam.descend(part, gradient, share);
        }
    }

    fn add_set_gradient(&mut self, set: &[usize], target: f64, scale: f64) {
        let (error, slopes) = self.add_head_gradient(&self.sums_of_set(set), target, scale);
        for (slot, &view) in set.iter().enumerate() {
            let input = slot * self.views + view;
            self.gradient.linear[input] += error;
            let row = &mut self.gradient.matrix[input * self.hidden..][..self.hidden];
            add(row, error, &slopes);
        }
    }

    fn add_probabilities_gradient(&mut self, probabilities: &[f64], target: f64, scale: f64) {
        let sums = self.sums_of(probabilities);
        let (error, slopes) = self.add_head_gradient(&sums, target, scale);
        add(&mut self.gradient.linear, error, probabilities);
        let rows = self.gradient.matrix.chunks_exact_mut(self.hidden);
        for (row, probability) in rows.zip(probabilities) {
            add(row, error * probability, &slopes);
        }
    }

    /// Adds the gradient behind the input layer; returns the scaled error and the units' slopes, for what is before it.
    fn add_head_gradient(&mut self, sums: &Sums, target: f64, scale: f64) -> (f64, Vec<f64>) {
        let activation = self.activate(sums);
        let error = scale * (activation.value - target);
        self.gradient.constant[0] += error;
        add(&mut self.gradient.bias, error, &activation.slopes);
        add(&mut self.gradient.out, error, &activation.units);
        (error, activation.slopes)
    }

    fn sums_of_set(&self, set: &[usize]) -> Sums {
        let mut sums = self.start();
        for (slot, &view) in set.iter().enumerate() {
            sums.add(self, slot, view);
        }
        sums
    }

    fn sums_of(&self, probabilities: &[f64]) -> Sums {
        let mut sums = self.start();
        sums.linear += dot(&self.parameters.linear, probabilities);
        let rows = self.parameters.matrix.chunks_exact(self.hidden);
        for (row, probability) in rows.zip(probabilities) {
            add(&mut sums.hidden, *probability, row);
        }
        sums
    }
}

/// What the network makes of sums.
struct Activation {
    value: f64,
    units: Vec<f64>,
    slopes: Vec<f64>,
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
        let input = slot * network.views + view;
        self.linear += network.parameters.linear[input];
        let row = &network.parameters.matrix[input * network.hidden..][..network.hidden];
        add(&mut self.hidden, 1.0, row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loss::SetFunction;

    const SLOTS: usize = 2;
    const VIEWS: usize = 3;

    fn network() -> ValueNetwork {
        let loss = SetFunction::new(VIEWS, SLOTS, |_: &[usize]| 0.0);
        let problem = Problem::new(&loss).expect("views enough").seed(4);
        let mut network = ValueNetwork::new(&problem, 5, 1e-2);
        let mut stream = Stream::new(5, Purpose::ValueInit, 0);
        for parameter in network.parameters.all().into_iter().flatten() {
            *parameter += stream.unit() - 0.5;
        }
        network
    }

    const PROBABILITIES: [f64; SLOTS * VIEWS] = [0.2, 0.5, 0.3, 0.7, 0.0, 0.3];

    fn value_at(network: &ValueNetwork, probabilities: &[f64]) -> f64 {
        network.finish(&network.sums_of(probabilities))
    }

    #[test]
    fn a_set_is_the_point_of_its_probabilities() {
        let network = network();
        let point = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0];
        let difference = network.of_set(&[2, 0]) - value_at(&network, &point);
        assert!(difference.abs() < 1e-14);
    }

    #[test]
    fn the_input_gradient_matches_differences() {
        let network = network();
        let gradient = network.input_gradient(&PROBABILITIES);
        for (index, gradient) in gradient.iter().enumerate() {
            let moved = |by: f64| {
                let mut probabilities = PROBABILITIES;
                probabilities[index] += by;
                value_at(&network, &probabilities)
            };
            let difference = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((gradient - difference).abs() < 1e-9);
        }
    }

    #[test]
    fn the_training_gradient_matches_differences() {
        let mut network = network();
        let samples: [(&[usize], f64); 2] = [(&[0, 2], 0.3), (&[1, 1], -0.8)];
        let error = |network: &ValueNetwork| {
            let sets = samples.iter();
            let sets = sets.map(|(set, target)| network.of_set(set) - target);
            let on_policy = value_at(network, &PROBABILITIES) - 0.1;
            (sets.map(|error| error.powi(2)).sum::<f64>() + on_policy.powi(2)) / 3.0
        };
        let parameters = network.parameters.clone();
        network.learn(samples.into_iter(), Some((&PROBABILITIES, 0.1)), 1.0);
        let gradient = network.gradient.all().map(|part| part.clone()).concat();
        for (index, gradient) in gradient.iter().enumerate() {
            let mut moved = |by: f64| {
                network.parameters = parameters.clone();
                let parameter = network.parameters.all().into_iter().flatten().nth(index);
                *parameter.expect("a parameter") += by;
                error(&network)
            };
            let difference = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((gradient - difference).abs() < 1e-8, "{index}");
        }
    }

    #[test]
    fn training_fits_what_slots_lose_together() {
        // An exclusive or: no sum of slots fits it.
        let mut network = network();
        let samples: [(&[usize], f64); 4] = [
            (&[0, 0], 0.0),
            (&[0, 1], 1.0),
            (&[1, 0], 1.0),
            (&[1, 1], 0.0),
        ];
        for _ in 0..2000 {
            network.learn(samples.into_iter(), None, 1.0);
        }
        for (set, target) in samples {
            assert!((network.of_set(set) - target).abs() < 0.05);
        }
    }
}
