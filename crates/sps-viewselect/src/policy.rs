//! The neural viewpoint selector: M vectors z over N views, and the gradient that trains them.

use crate::error::{SelectError, require, require_length};
use crate::problem::check_sizes;
use crate::sets::{SetList, Sets, is_distinct};
use crate::softmax;
use crate::stream::{Purpose, Stream};
use crate::vector::add;

/// M viewpoint selector vectors z, each a distribution over N views: the paper's NVS network
/// (section "Viewpoint Selector Framework").
///
/// With repeats allowed, the slots of a set are independent draws from `softmax(z_m)`. Distinct
/// views are drawn slot by slot, slot m from `softmax(z_m)` without the views of the slots before
/// it; probability, gradient and arg-max are those of that process.
///
/// All numbers are finite for all finite logits.
#[derive(Clone, Debug, PartialEq)]
pub struct Policy {
    /// Shape (picks, views), row-major.
    logits: Vec<f64>,
    views: usize,
    picks: usize,
    distinct: bool,
}

impl Policy {
    /// Every view equally probable, in every slot, as the paper starts.
    ///
    /// # Errors
    ///
    /// [`SelectError::NoViews`], [`SelectError::NoPicks`], [`SelectError::TooManyPicks`].
    pub fn uniform(picks: usize, views: usize, distinct: bool) -> Result<Self, SelectError> {
        check_sizes(views, picks)?;
        Ok(Self {
            logits: vec![0.0; picks * views],
            views,
            picks,
            distinct,
        })
    }

    /// The given logits, shape (picks, views), row-major.
    ///
    /// # Errors
    ///
    /// As [`uniform`](Self::uniform); [`SelectError::Length`] if `logits` does not hold
    /// `picks * views` of them, [`SelectError::Setting`] if one is not finite.
    pub fn from_logits(
        logits: Vec<f64>,
        picks: usize,
        views: usize,
        distinct: bool,
    ) -> Result<Self, SelectError> {
        check_sizes(views, picks)?;
        require_length("the slice of logits", logits.len(), picks * views)?;
        let strange = logits.iter().find(|logit| !logit.is_finite());
        if let Some(strange) = strange {
            require(false, "logits", strange, "finite numbers")?;
        }
        Ok(Self {
            logits,
            views,
            picks,
            distinct,
        })
    }

    /// The selector vectors z, shape (picks, views), row-major.
    pub fn logits(&self) -> &[f64] {
        &self.logits
    }

    pub(crate) fn logits_mut(&mut self) -> &mut [f64] {
        &mut self.logits
    }

    /// `softmax(z_m)` of every slot, joined: shape (picks, views), row-major. The value network's
    /// input.
    pub fn probabilities(&self) -> Vec<f64> {
        self.rows()
            .flat_map(|row| softmax::softmax(row, &[]))
            .collect()
    }

    /// Sum over the slots of the entropy of `softmax(z_m)`, in nats: from 0 to `M ln N`.
    pub fn entropy(&self) -> f64 {
        self.rows()
            .map(|row| softmax::entropy(&softmax::log_softmax(row, &[])))
            .sum()
    }

    /// Gradient of [`entropy`](Self::entropy) with respect to z, shape (picks, views), row-major.
    pub fn entropy_gradient(&self) -> Vec<f64> {
        self.rows()
            .flat_map(|row| {
                let log_probabilities = softmax::log_softmax(row, &[]);
                softmax::entropy_gradient(&log_probabilities).collect::<Vec<_>>()
            })
            .collect()
    }

    /// The log-probability of drawing `set`, in nats.
    ///
    /// # Errors
    ///
    /// [`SelectError::Length`], [`SelectError::NoSuchView`], [`SelectError::Repeated`] if `set`
    /// cannot be drawn.
    pub fn log_probability(&self, set: &[usize]) -> Result<f64, SelectError> {
        self.check(set)?;
        Ok(self
            .rows()
            .zip(set)
            .enumerate()
            .map(|(slot, (row, &view))| softmax::log_softmax(row, self.taken(set, slot))[view])
            .sum())
    }

    /// `count` sets, drawn from the stream of (seed, step).
    pub fn sample(&self, seed: u64, step: u64, count: usize) -> SetList {
        let mut stream = Stream::new(seed, Purpose::PolicySamples, step);
        let free: Vec<Vec<f64>> = self.rows().map(|row| softmax::softmax(row, &[])).collect();
        let mut sets = SetList::new(self.picks);
        let mut set = vec![0; self.picks];
        for _ in 0..count {
            for slot in 0..self.picks {
                let taken = self.taken(&set, slot);
                let draw = stream.unit();
                set[slot] = if taken.is_empty() {
                    drawn_view(&free[slot], draw)
                } else {
                    drawn_view(&softmax::softmax(self.row(slot), taken), draw)
                };
            }
            sets.push(&set);
        }
        sets
    }

    /// The most probable view of every slot: the paper's `q_m = argmax_i softmax(z_m)_i`. Of equals
    /// the lowest index. Distinct views are taken slot by slot.
    pub fn arg_max(&self) -> Vec<usize> {
        let mut set = Vec::with_capacity(self.picks);
        for row in self.rows() {
            let taken = self.taken(&set, set.len());
            let best = (0..self.views)
                .filter(|view| !taken.contains(view))
                .reduce(|best, view| if row[view] > row[best] { view } else { best });
            set.extend(best);
        }
        set
    }

    /// The REINFORCE gradient (Williams 1992) with respect to z: the gradient of
    ///
    /// ```text
    /// mean over b of advantage_b * sum over m of log softmax(z_m)[set_b[m]]
    /// ```
    ///
    /// Shape (picks, views), row-major. Going up along it makes sets of positive advantage more
    /// probable. No sets have a gradient of 0.
    ///
    /// # Errors
    ///
    /// [`SelectError::Length`] if there is not one advantage for each set; as
    /// [`log_probability`](Self::log_probability) for each set.
    pub fn reinforce_gradient(
        &self,
        sets: Sets<'_>,
        advantages: &[f64],
    ) -> Result<Vec<f64>, SelectError> {
        require_length("the slice of advantages", advantages.len(), sets.len())?;
        sets.iter().try_for_each(|set| self.check(set))?;
        let scale = 1.0 / advantages.len().max(1) as f64;
        let mut gradient = vec![0.0; self.logits.len()];
        let rows = gradient.chunks_exact_mut(self.views);
        for (slot, (gradient, row)) in rows.zip(self.rows()).enumerate() {
            // Weight of the whole row's softmax, from sets that leave no view out.
            let mut free = 0.0;
            for (set, advantage) in sets.iter().zip(advantages) {
                let advantage = scale * advantage;
                let taken = self.taken(set, slot);
                gradient[set[slot]] += advantage;
                if taken.is_empty() {
                    free += advantage;
                } else {
                    add(gradient, -advantage, &softmax::softmax(row, taken));
                }
            }
            add(gradient, -free, &softmax::softmax(row, &[]));
        }
        Ok(gradient)
    }

    fn rows(&self) -> std::slice::ChunksExact<'_, f64> {
        self.logits.chunks_exact(self.views)
    }

    fn row(&self, slot: usize) -> &[f64] {
        &self.logits[slot * self.views..][..self.views]
    }

    /// The views that slot `slot` of `set` cannot take any more.
    fn taken<'a>(&self, set: &'a [usize], slot: usize) -> &'a [usize] {
        if self.distinct { &set[..slot] } else { &[] }
    }

    fn check(&self, set: &[usize]) -> Result<(), SelectError> {
        require_length("the set", set.len(), self.picks)?;
        let set_of = || set.to_vec();
        if set.iter().any(|&view| view >= self.views) {
            let last = self.views - 1;
            return Err(SelectError::NoSuchView {
                set: set_of(),
                last,
            });
        }
        if self.distinct && !is_distinct(set) {
            return Err(SelectError::Repeated { set: set_of() });
        }
        Ok(())
    }
}

/// The view in whose part of [0, 1) the draw lies. Rounding may leave a draw beyond all parts: then
/// the last view that has a part.
fn drawn_view(probabilities: &[f64], mut draw: f64) -> usize {
    let mut last = 0;
    for (view, &probability) in probabilities.iter().enumerate() {
        if probability > 0.0 {
            if draw < probability {
                return view;
            }
            draw -= probability;
            last = view;
        }
    }
    last
}
