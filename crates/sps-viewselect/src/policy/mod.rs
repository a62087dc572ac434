//! The neural viewpoint selector: M vectors z over N views, and the gradient that trains them.

use crate::problem::Problem;
use crate::sets::{SetList, Sets};
use crate::softmax;
use crate::stream::{Purpose, Stream};
use crate::vector::add;

#[cfg(test)]
mod hard_cases;
#[cfg(test)]
mod tests;

/// M viewpoint selector vectors z, each a distribution over N views: the paper's NVS network
/// (section "Viewpoint Selector Framework").
///
/// With repeats allowed, the slots of a set are independent draws from `softmax(z_m)`. Distinct
/// views are drawn slot by slot, slot m from `softmax(z_m)` without the views of the slots before
/// it; probability, gradient and arg-max are those of that process.
///
/// All numbers are finite for all finite logits.
#[derive(Clone, Debug)]
pub(crate) struct Policy {
    /// The vectors z, shape (picks, views), row-major.
    pub(crate) logits: Vec<f64>,
    views: usize,
    distinct: bool,
}

impl Policy {
    /// Every view equally probable, in every slot, as the paper starts.
    pub(crate) fn uniform(problem: &Problem<'_>) -> Self {
        Self {
            logits: vec![0.0; problem.picks() * problem.views()],
            views: problem.views(),
            distinct: problem.is_distinct(),
        }
    }

    /// `softmax(z_m)` of every slot, joined: shape (picks, views), row-major. The value network's
    /// input.
    pub(crate) fn probabilities(&self) -> Vec<f64> {
        let rows = self.rows();
        rows.flat_map(|row| softmax::softmax(row, &[])).collect()
    }

    /// Gradient, with respect to z, of the sum over the slots of the entropy of `softmax(z_m)` in nats:
    /// shape (picks, views), row-major.
    pub(crate) fn entropy_gradient(&self) -> Vec<f64> {
        let mut gradient = Vec::with_capacity(self.logits.len());
        for row in self.rows() {
            gradient.extend(softmax::entropy_gradient(&softmax::log_softmax(row, &[])));
        }
        gradient
    }

    /// `count` sets, drawn from the stream of (seed, step).
    pub(crate) fn sample(&self, seed: u64, step: u64, count: usize) -> SetList {
        let mut stream = Stream::new(seed, Purpose::PolicySamples, step);
        let free: Vec<Vec<f64>> = self.rows().map(|row| softmax::softmax(row, &[])).collect();
        let mut sets = SetList::new(free.len());
        let mut set = vec![0; free.len()];
        for _ in 0..count {
            for (slot, (row, free)) in self.rows().zip(&free).enumerate() {
                let taken = self.taken(&set, slot);
                let draw = stream.unit();
                set[slot] = if taken.is_empty() {
                    drawn_view(free, draw)
                } else {
                    drawn_view(&softmax::softmax(row, taken), draw)
                };
            }
            sets.push(&set);
        }
        sets
    }

    /// The most probable view of every slot: the paper's `q_m = argmax_i softmax(z_m)_i`. Of equals
    /// the lowest index. Distinct views are taken slot by slot.
    pub(crate) fn arg_max(&self) -> Vec<usize> {
        let mut set = Vec::new();
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
    pub(crate) fn reinforce_gradient(&self, sets: Sets<'_>, advantages: &[f64]) -> Vec<f64> {
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
        gradient
    }

    fn rows(&self) -> std::slice::ChunksExact<'_, f64> {
        self.logits.chunks_exact(self.views)
    }

    /// The views that slot `slot` of `set` cannot take any more.
    fn taken<'a>(&self, set: &'a [usize], slot: usize) -> &'a [usize] {
        if self.distinct { &set[..slot] } else { &[] }
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
