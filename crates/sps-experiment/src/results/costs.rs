//! What the estimate of one surface costs.

use serde::{Deserialize, Serialize};

use super::Number;

/// Of one method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Costs {
    /// At prediction.
    pub frames_decoded_per_surface: f64,
    /// At prediction.
    pub frames_encoded_per_surface: f64,
    /// Of one estimate, without the cache; the median.
    pub predict_seconds_per_surface: Number,
    /// The three parts of it; medians of their own.
    pub decode_seconds_per_surface: Number,
    /// Of the encoder.
    pub encode_seconds_per_surface: Number,
    /// Of what estimates from embeddings.
    pub head_seconds_per_surface: Number,
    /// The encoder, and the most that one estimate has allocated at any one time.
    pub peak_memory_bytes: Number,
    /// Of encoder and heads.
    pub multiply_adds_per_surface: Number,
    /// All properties and reruns together.
    pub train_seconds: f64,
    /// To train the encoder, all reruns together; 0 where it is left as it is.
    pub encoder_train_seconds: f64,
}

impl Costs {
    /// The mean of costs, each with the share of surfaces that has it; of the memory the most.
    pub(crate) fn weighed(all: &[(f64, Self)]) -> Self {
        let sum = |of: fn(&Self) -> Number| {
            let terms = all.iter().map(|(share, costs)| Some(share * of(costs)?));
            terms.sum::<Number>().filter(|_| !all.is_empty())
        };
        let memory = all.iter().filter_map(|(_, costs)| costs.peak_memory_bytes);
        let decoded = sum(|costs| Some(costs.frames_decoded_per_surface));
        let encoded = sum(|costs| Some(costs.frames_encoded_per_surface));
        Self {
            frames_decoded_per_surface: decoded.unwrap_or_default(),
            frames_encoded_per_surface: encoded.unwrap_or_default(),
            predict_seconds_per_surface: sum(|costs| costs.predict_seconds_per_surface),
            decode_seconds_per_surface: sum(|costs| costs.decode_seconds_per_surface),
            encode_seconds_per_surface: sum(|costs| costs.encode_seconds_per_surface),
            head_seconds_per_surface: sum(|costs| costs.head_seconds_per_surface),
            peak_memory_bytes: memory.reduce(f64::max),
            multiply_adds_per_surface: sum(|costs| costs.multiply_adds_per_surface),
            ..Self::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn costs_are_weighed_by_how_often_they_are_paid() {
        let costs = |seconds, memory| Costs {
            frames_decoded_per_surface: seconds,
            predict_seconds_per_surface: Some(seconds),
            peak_memory_bytes: Some(memory),
            ..Costs::default()
        };
        let all = [(0.75, costs(1.0, 9.0)), (0.25, costs(5.0, 7.0))];
        let weighed = Costs::weighed(&all);
        assert_eq!(weighed.predict_seconds_per_surface, Some(2.0));
        assert_eq!(weighed.frames_decoded_per_surface, 2.0);
        assert_eq!(weighed.peak_memory_bytes, Some(9.0));
        assert_eq!(weighed.multiply_adds_per_surface, None);
        assert_eq!(Costs::weighed(&[]).predict_seconds_per_surface, None);
    }
}
