//! What the estimate of one surface costs.

use super::Number;

/// Of one method.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Costs {
    pub frames_decoded: f64,
    pub frames_encoded: f64,
    /// From the frame on.
    pub seconds: Number,
    pub decode_seconds: Number,
    pub encode_seconds: Number,
    pub head_seconds: Number,
    pub peak_memory_bytes: Number,
    pub multiply_adds: Number,
    /// All reruns together.
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
        Self {
            frames_decoded: sum(|costs| Some(costs.frames_decoded)).unwrap_or_default(),
            frames_encoded: sum(|costs| Some(costs.frames_encoded)).unwrap_or_default(),
            seconds: sum(|costs| costs.seconds),
            decode_seconds: sum(|costs| costs.decode_seconds),
            encode_seconds: sum(|costs| costs.encode_seconds),
            head_seconds: sum(|costs| costs.head_seconds),
            peak_memory_bytes: memory.reduce(f64::max),
            multiply_adds: sum(|costs| costs.multiply_adds),
            encoder_train_seconds: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn costs_are_weighed_by_how_often_they_are_paid() {
        let costs = |seconds, memory| Costs {
            frames_decoded: seconds,
            seconds: Some(seconds),
            peak_memory_bytes: Some(memory),
            ..Costs::default()
        };
        let all = [(0.75, costs(1.0, 9.0)), (0.25, costs(5.0, 7.0))];
        let weighed = Costs::weighed(&all);
        assert_eq!(weighed.seconds, Some(2.0));
        assert_eq!(weighed.frames_decoded, 2.0);
        assert_eq!(weighed.peak_memory_bytes, Some(9.0));
        assert_eq!(weighed.multiply_adds, None);
        assert_eq!(Costs::weighed(&[]).seconds, None);
    }
}
