//! Adam (Kingma and Ba 2015), as PyTorch has it.

/// The moments of one vector of parameters.
#[derive(Clone, Debug)]
pub(crate) struct Adam {
    rate: f64,
    steps: i32,
    first: Vec<f64>,
    second: Vec<f64>,
}

/// The paper's defaults.
const BETA1: f64 = 0.9;
const BETA2: f64 = 0.999;
const EPSILON: f64 = 1e-8;

impl Adam {
    pub(crate) fn new(parameters: usize, rate: f64) -> Self {
        Self {
            rate,
            steps: 0,
            first: vec![0.0; parameters],
            second: vec![0.0; parameters],
        }
    }

    /// One step down along the gradient, with `share` of the learning rate.
    pub(crate) fn descend(&mut self, parameters: &mut [f64], gradient: &[f64], share: f64) {
        self.steps = self.steps.saturating_add(1);
        let rate = self.rate * share / (1.0 - BETA1.powi(self.steps));
        let second_scale = 1.0 / (1.0 - BETA2.powi(self.steps)).sqrt();
        let moments = self.first.iter_mut().zip(&mut self.second);
        for ((parameter, gradient), (first, second)) in
            parameters.iter_mut().zip(gradient).zip(moments)
        {
            *first += (1.0 - BETA1) * (gradient - *first);
            *second += (1.0 - BETA2) * (gradient * gradient - *second);
            *parameter -= rate * *first / (second.sqrt() * second_scale + EPSILON);
        }
    }
}

#[cfg(test)]
mod tests {
    use safetensors::Dtype;

    use super::*;
    use crate::golden::{golden, uniform};

    const PARAMETERS: usize = 15;

    fn image(name: &str) -> Vec<f64> {
        let numbers = uniform(name, PARAMETERS).into_iter();
        numbers.map(|u| f64::from(u as f32)).collect()
    }

    #[test]
    fn ten_steps_match_pytorch() {
        let expected = golden("adam", "params", Dtype::F64, &[10, 5, 3]);
        let mut expected = expected.into_iter().map(f64::from_le_bytes);
        let mut parameters = image("golden/adam.param");
        let mut adam = Adam::new(PARAMETERS, 1e-2);
        for step in 0..10 {
            let coefficients = image(&format!("golden/adam.coef.{step}"));
            // The gradient of sum sin^2(p c).
            let both = parameters.iter().zip(&coefficients);
            let gradient: Vec<f64> = both.map(|(p, c)| (2.0 * p * c).sin() * c).collect();
            adam.descend(&mut parameters, &gradient, 1.0);
            for found in &parameters {
                let expected = expected.next().expect("ten steps");
                assert!((found - expected).abs() < 1e-13, "{found} {expected}");
            }
        }
    }
}
