//! How long what is missing will take; `None` where something is missing that was not measured.

use super::{Counts, OfEncoder, OfMethod, Outlook};
use crate::work::Shard;

impl OfMethod {
    /// Of its trials and selections.
    pub(super) fn seconds(&self, counts: Counts) -> Option<f64> {
        let trials = of_all(counts.trials_missing(), self.seconds_per_trial)?;
        let selections = of_all(counts.selections_missing(), self.seconds_per_selection)?;
        Some(trials + selections)
    }
}

impl OfEncoder {
    pub(super) fn seconds(&self) -> Option<f64> {
        Some(self.encoding()? + of_all(self.untrained.len(), self.seconds_per_training)?)
    }

    fn encoding(&self) -> Option<f64> {
        of_all(self.frames, self.seconds_per_frame)
    }
}

impl Outlook {
    /// One thing after the other.
    pub(super) fn seconds(&self) -> Option<f64> {
        let methods = self.methods.iter().map(|one| one.seconds(one.counts()));
        let encoders = self.encoders.iter().map(OfEncoder::seconds);
        methods.chain(encoders).sum()
    }

    /// Of the slowest of so many shards.
    pub(super) fn seconds_in_shards(&self, of: usize) -> Option<f64> {
        let mut slowest = 0.0;
        for shard in Shard::all(of) {
            slowest = f64::max(slowest, self.seconds_of_shard(shard)?);
        }
        Some(slowest)
    }

    /// Frames are encoded by all shards that look at any.
    fn seconds_of_shard(&self, shard: Shard) -> Option<f64> {
        let mut sum = 0.0;
        for (place, item) in self.items.iter().enumerate() {
            if shard.has(place) {
                for &method in &item.methods {
                    let method = &self.methods[method];
                    let counts = method.of_split.get(&item.split).copied();
                    sum += method.seconds(counts.unwrap_or_default())?;
                }
            }
        }
        for encoder in &self.encoders {
            let takes_part = |shard: &Shard| self.splits_of(encoder, *shard).next().is_some();
            if !takes_part(&shard) {
                continue;
            }
            let helping = Shard::all(shard.of).filter(takes_part).count();
            let own = self.splits_of(encoder, shard);
            let untrained = own
                .filter(|split| encoder.untrained.contains(split))
                .count();
            sum += encoder.encoding()? / helping as f64;
            sum += of_all(untrained, encoder.seconds_per_training)?;
        }
        Some(sum)
    }

    /// The split of each item of an encoder that a shard has.
    fn splits_of<'a>(
        &'a self,
        encoder: &'a OfEncoder,
        shard: Shard,
    ) -> impl Iterator<Item = usize> + 'a {
        let items = self.items.iter().enumerate();
        let own = items.filter(move |(place, item)| {
            shard.has(*place) && item.methods.iter().all(|at| encoder.methods.contains(at))
        });
        own.map(|(_, item)| item.split)
    }
}

fn of_all(count: usize, seconds_of_one: Option<f64>) -> Option<f64> {
    match count {
        0 => Some(0.0),
        some => Some(some as f64 * seconds_of_one?),
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::super::Item;
    use super::*;

    /// Two methods of one encoder, each of three splits with one trial of a second, and 12 frames of
    /// a tenth of a second.
    fn outlook() -> Outlook {
        let counts = Counts {
            trials: 1,
            ..Counts::default()
        };
        let method = |id: &str| OfMethod {
            id: id.to_owned(),
            of_split: (0..3).map(|split| (split, counts)).collect(),
            seconds_per_trial: Some(1.0),
            seconds_per_selection: None,
        };
        let item = |(method, split)| Item {
            methods: vec![method],
            split,
        };
        let places = (0..2).flat_map(|method| (0..3).map(move |split| (method, split)));
        Outlook {
            experiment: "test".to_owned(),
            folder: PathBuf::from("runs/test"),
            shard: None,
            encoders: vec![OfEncoder {
                methods: vec![0, 1],
                frames: 12,
                seconds_per_frame: Some(0.1),
                ..OfEncoder::default()
            }],
            methods: vec![method("a"), method("b")],
            items: places.map(item).collect(),
        }
    }

    #[test]
    fn shards_share_trials_and_frames() {
        let outlook = outlook();
        let close = |seconds: Option<f64>, expected: f64| {
            assert!((seconds.unwrap() - expected).abs() < 1e-9, "{seconds:?}");
        };
        close(outlook.seconds(), 6.0 + 1.2);
        close(outlook.seconds_in_shards(1), 6.0 + 1.2);
        close(outlook.seconds_in_shards(2), 3.0 + 0.6);
        // Of four, two have two items.
        close(outlook.seconds_in_shards(4), 2.0 + 0.3);
        // Of eight, two have none, and encode nothing.
        close(outlook.seconds_in_shards(8), 1.0 + 0.2);
    }

    #[test]
    fn what_was_not_measured_has_no_time() {
        let mut outlook = outlook();
        outlook.methods[1].seconds_per_trial = None;
        assert_eq!(outlook.seconds(), None);
        assert_eq!(outlook.seconds_in_shards(2), None);
        for counts in outlook.methods[1].of_split.values_mut() {
            counts.trials_done = 1;
        }
        assert!(outlook.seconds().is_some());
    }
}
