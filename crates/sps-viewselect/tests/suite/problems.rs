//! Losses whose optimum is known, or can be gone through. Shared by tests, benchmark and example.

use sps_viewselect::{LossError, SetLoss, Sets};

#[path = "../../../../fixtures/golden/rule.rs"]
#[allow(dead_code, reason = "how far results are off is told otherwise here")]
mod rule;

pub(crate) use rule::numbers as uniform;

/// A known best triple under noise.
///
/// Each slot has a bowl about its planted view, some 0.15 N wide; the first two slots also want the
/// planted difference between them, whatever their place (the paper: "the relative difference
/// between viewing angles is more important ... than the global values"); every set has its own
/// noise of 0 to 0.1, some 45 times what one view beside the planted one costs. The planted triple
/// has loss 0; `MARGIN` keeps all others above it.
pub(crate) struct Planted {
    views: usize,
    pub(crate) best: [usize; 3],
    seed: u64,
}

const MARGIN: f64 = 0.05;
const NOISE: f64 = 0.1;

impl Planted {
    pub(crate) fn new(views: usize, seed: u64) -> Self {
        let mut draws = uniform(&format!("planted/{views}/{seed}"));
        let mut draw = || 0.5 * (draws.next().unwrap_or_default() + 1.0);
        let best = std::array::from_fn(|_| (draw() * views as f64) as usize);
        Self { views, best, seed }
    }

    pub(crate) fn loss(&self, set: &[usize]) -> f64 {
        if set == self.best {
            return 0.0;
        }
        let width = 0.15 * self.views as f64;
        let bowl = |distance: f64| 1.0 - (-(distance / width).powi(2) / 2.0).exp();
        let slots = set.iter().zip(self.best);
        let slots = slots.map(|(&view, best)| bowl(view as f64 - best as f64));
        let difference = |set: &[usize]| set[0] as f64 - set[1] as f64;
        let pair = bowl(difference(set) - difference(&self.best));
        MARGIN + slots.sum::<f64>() + 0.5 * pair + NOISE * self.noise(set)
    }

    /// In [0, 1), a function of the set alone.
    fn noise(&self, set: &[usize]) -> f64 {
        let mut z = set.iter().fold(self.seed, |hash, &view| {
            (hash ^ (view as u64 + 1))
                .wrapping_mul(0x9E37_79B9_7F4A_7C15)
                .rotate_left(29)
        });
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z ^= z >> 27;
        (z >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A frozen late-fusion estimator: per-slot terms that are smooth over the views, added up, and a
/// small head. The loss is the mean over surfaces of the squared error.
///
/// Term h of slot m is `gain(view) * truth + disturbance(view, surface)`, both smooth random
/// functions of the view. Many sets are nearly as good as the best.
pub(crate) struct LateFusion {
    views: usize,
    picks: usize,
    truths: Vec<f64>,
    /// (slot, view, surface, hidden), row-major.
    terms: Vec<f64>,
}

const HIDDEN: usize = 4;

impl LateFusion {
    pub(crate) fn new(views: usize, picks: usize, surfaces: usize, seed: u64) -> Self {
        let mut draws = uniform(&format!("late-fusion/{views}/{picks}/{surfaces}/{seed}"));
        let truths: Vec<f64> = draws.by_ref().take(surfaces).collect();
        let mut terms = vec![0.0; picks * views * surfaces * HIDDEN];
        for slot in 0..picks {
            for hidden in 0..HIDDEN {
                let gain = Smooth::new(&mut draws, 2.0);
                for (surface, truth) in truths.iter().enumerate() {
                    let disturbance = Smooth::new(&mut draws, 4.0);
                    for view in 0..views {
                        let place = view as f64 / views as f64;
                        let index = ((slot * views + view) * surfaces + surface) * HIDDEN + hidden;
                        terms[index] = (gain.at(place) * truth + 0.7 * disturbance.at(place))
                            / (picks as f64).sqrt();
                    }
                }
            }
        }
        Self {
            views,
            picks,
            truths,
            terms,
        }
    }

    fn term(&self, slot: usize, view: usize) -> &[f64] {
        let length = self.truths.len() * HIDDEN;
        &self.terms[(slot * self.views + view) * length..][..length]
    }
}

impl SetLoss for LateFusion {
    fn views(&self) -> usize {
        self.views
    }

    fn picks(&self) -> usize {
        self.picks
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        // The sum over the first M - 1 slots, kept while sets share them.
        let mut prefix: &[usize] = &[];
        let mut sum = vec![0.0; self.truths.len() * HIDDEN];
        for (set, loss) in sets.iter().zip(losses) {
            let (&last, first) = set.split_last().ok_or("an empty set")?;
            if prefix != first {
                sum.fill(0.0);
                for (slot, &view) in first.iter().enumerate() {
                    for (sum, term) in sum.iter_mut().zip(self.term(slot, view)) {
                        *sum += term;
                    }
                }
                prefix = first;
            }
            let terms = self.term(self.picks - 1, last).chunks_exact(HIDDEN);
            let squares = sum.chunks_exact(HIDDEN).zip(terms).zip(&self.truths);
            let squares = squares.map(|((sum, term), truth)| {
                let hidden = sum.iter().zip(term).map(|(sum, term)| (sum + term).tanh());
                (truth - hidden.sum::<f64>() / HIDDEN as f64 * 2.0).powi(2)
            });
            *loss = squares.sum::<f64>() / self.truths.len() as f64;
        }
        Ok(())
    }
}

/// A random sum of cosines, of a few cycles over all views.
struct Smooth([(f64, f64, f64); 5]);

impl Smooth {
    fn new(draws: &mut impl Iterator<Item = f64>, cycles: f64) -> Self {
        let mut draw = || draws.next().unwrap_or_default();
        Self(std::array::from_fn(|_| {
            let frequency = std::f64::consts::PI * cycles * (draw() + 1.0);
            (draw(), frequency, std::f64::consts::PI * draw())
        }))
    }

    fn at(&self, place: f64) -> f64 {
        let wave = |(height, frequency, phase): &(f64, f64, f64)| {
            height * (frequency * place + phase).cos()
        };
        self.0.iter().map(wave).sum()
    }
}
