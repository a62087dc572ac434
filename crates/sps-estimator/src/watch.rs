//! Whether photographs keep coming as those of the fit did.

use std::borrow::Borrow;

use sps_base::streams::{below, named_stream};

use crate::error::{Error, Result, refuse};
use crate::estimator::Estimator;
use crate::novelty::Familiar;

/// The evidence from which on there is an alarm: exchangeable photographs reach it in one of so many rounds
/// at most.
const ALARM: f64 = 100.0;
/// Photographs of a round, after which evidence is gathered anew.
const ROUND: usize = 10_000;
/// The share of the evidence that moves between bets at each photograph.
const JUMP: f64 = 0.01;

/// Gathers evidence that photographs, one after the other, are stranger than those of the fit.
///
/// The score of a surface is the mean distance to its five nearest among those surfaces of the fit that do
/// not calibrate. Where nothing has changed, those that calibrate and those that come are exchangeable, and
/// the rank of each new score among all before it, ties broken at random, is uniform and independent of the
/// others. The evidence is a martingale that bets on high ranks: the Simple Jumper of Vovk, Petej, Nouretdinov,
/// Ahlberg, Carlsson and Gammerman, "Retrain or not retrain: conformal test martingales for change-point
/// detection" (COPA 2021), algorithm 1, with bets on strange photographs alone. By Ville's inequality it
/// reaches 100 in at most one of 100 rounds of 10,000 photographs.
///
/// What is shown must come as the surfaces of the fit were drawn where nothing has changed: one after the other
/// at random, each once. Many of a kind in a row, or one surface again and again, are a change.
#[derive(Debug)]
pub struct Watch<E> {
    estimator: E,
    evidence: Evidence,
}

impl<E: Borrow<Estimator>> Watch<E> {
    /// Begins to watch.
    ///
    /// # Errors
    /// A model whose surfaces all calibrate, or none; one whose encoder learned from them.
    pub fn new(estimator: E) -> Result<Self> {
        let familiar = estimator.borrow().fitted.familiar.as_ref();
        let calibrating = familiar.map_or(Vec::new(), Familiar::scores_aside);
        if calibrating.is_empty() {
            let expected =
                "surfaces that calibrate, and others, that the encoder did not learn from";
            return refuse("to watch by", "no surface", expected);
        }
        Ok(Self {
            estimator,
            evidence: Evidence::new(calibrating, 0),
        })
    }

    /// Takes in the next surface by the embeddings of its photographs, `(views, width)`.
    ///
    /// # Errors
    /// Photographs of another number of views than the model has, a value that is not finite.
    pub fn see(&mut self, values: &[f32]) -> Result<()> {
        self.evidence.take(self.score(values)?);
        Ok(())
    }

    /// Takes in the scores of surfaces whose order says nothing, such as that of names, in one drawn at
    /// random.
    pub fn see_in_any_order(&mut self, mut scores: Vec<f64>) {
        let mut draws = named_stream(0, "order of a watch", self.seen());
        for at in (1..scores.len()).rev() {
            scores.swap(at, below(&mut draws, at as u64 + 1) as usize);
        }
        for score in scores {
            self.evidence.take(score);
        }
    }

    /// How strange a surface looks, by the embeddings of its photographs, `(views, width)`.
    ///
    /// # Errors
    /// As [`Watch::see`].
    pub fn score(&self, values: &[f32]) -> Result<f64> {
        let model: &Estimator = self.estimator.borrow();
        let embeddings = model.embedder.table(values, 1, model.about.angles.len())?;
        let familiar = model.fitted.familiar.as_ref();
        let familiar =
            familiar.map_err(|reason| Error::input("to watch by", reason, "surfaces"))?;
        Ok(familiar.score(&embeddings))
    }

    /// Surfaces seen.
    pub fn seen(&self) -> u64 {
        self.evidence.seen
    }

    /// What 1 has become that was bet, at fair odds, on a change for the stranger in this round.
    pub fn evidence(&self) -> f64 {
        self.evidence.bets.iter().sum()
    }

    /// The number of the surface at which the evidence first was 100.
    pub fn alarm(&self) -> Option<u64> {
        self.evidence.alarm
    }
}

#[derive(Debug)]
struct Evidence {
    /// Of the surfaces that calibrate.
    calibrating: Vec<f64>,
    /// With those seen in this round; ascending.
    scores: Vec<f64>,
    /// On strange photographs, and none.
    bets: [f64; 2],
    /// Of the numbers that break ties.
    seed: u64,
    seen: u64,
    alarm: Option<u64>,
}

impl Evidence {
    fn new(mut calibrating: Vec<f64>, seed: u64) -> Self {
        calibrating.sort_by(f64::total_cmp);
        Self {
            scores: calibrating.clone(),
            calibrating,
            bets: [0.5; 2],
            seed,
            seen: 0,
            alarm: None,
        }
    }

    fn take(&mut self, score: f64) {
        if self.scores.len() >= self.calibrating.len() + ROUND {
            self.scores.clone_from(&self.calibrating);
            self.bets = [0.5; 2];
        }
        let below_it = self.scores.partition_point(|other| *other < score);
        let above = self.scores.len() - self.scores.partition_point(|other| *other <= score);
        let equal = self.scores.len() - below_it - above;
        let p = (above as f64 + self.tie() * (equal + 1) as f64) / (self.scores.len() + 1) as f64;
        self.scores.insert(below_it, score);
        let all = self.bets.iter().sum::<f64>();
        for (bet, slope) in self.bets.iter_mut().zip([-1.0, 0.0]) {
            let moved = (1.0 - JUMP) * *bet + JUMP * all / 2.0;
            *bet = moved * (1.0 + slope * (p - 0.5));
        }
        self.seen += 1;
        if self.bets.iter().sum::<f64>() >= ALARM {
            self.alarm.get_or_insert(self.seen);
        }
    }

    /// A number in [0, 1), another for each surface.
    fn tie(&self) -> f64 {
        const STEPS: u64 = 1 << 53;
        below(&mut named_stream(self.seed, "watch", self.seen), STEPS) as f64 / STEPS as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal numbers (Box and Muller 1958) of a stream.
    fn normal(stream: u64, at: u64) -> f64 {
        let mut stream = named_stream(stream, "scores", at);
        let mut uniform = || (below(&mut stream, 1 << 53) as f64 + 0.5) / (1_u64 << 53) as f64;
        (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()
    }

    fn alarm(stream: u64, shift: f64, length: u64, round: impl Fn(f64) -> f64) -> Option<u64> {
        let calibrating = (0..60).map(|at| round(normal(stream, at))).collect();
        let mut evidence = Evidence::new(calibrating, stream);
        (60..60 + length).for_each(|at| evidence.take(round(normal(stream, at) + shift)));
        evidence.alarm
    }

    /// At most one of 100 is promised; of 1,000 streams 10, and three standard errors of that are 9.4.
    #[test]
    fn exchangeable_streams_raise_no_more_alarms_than_promised() {
        for round in [|score: f64| score, |score: f64| score.round()] {
            let alarms = (0..1000).filter(|&stream| alarm(stream, 0.0, 500, round).is_some());
            let alarms = alarms.count();
            println!("{alarms} of 1,000 streams");
            assert!(alarms <= 19, "{alarms}");
        }
    }

    #[test]
    fn strange_streams_are_noticed() {
        let alarms = (0..100).map(|stream| alarm(stream, 2.0, 500, |score| score));
        let mut alarms = alarms.collect::<Option<Vec<u64>>>().unwrap();
        alarms.sort_unstable();
        println!("noticed after {} at the median", alarms[50]);
        assert!(alarms[50] < 40, "{alarms:?}");
        // What is more familiar than the fit is nothing to warn of.
        assert!((0..100).all(|stream| alarm(stream, -2.0, 500, |score| score).is_none()));
    }

    #[test]
    fn a_round_begins_anew_and_an_alarm_stays() {
        let mut evidence = Evidence::new((0..60).map(f64::from).collect(), 0);
        (0..40).for_each(|_| evidence.take(1000.0));
        let alarm = evidence.alarm;
        assert!(alarm.is_some());
        (0..ROUND).for_each(|_| evidence.take(-1.0));
        assert_eq!(evidence.scores.len(), 60 + 40);
        assert!(evidence.bets.iter().sum::<f64>() <= 1.0);
        assert_eq!(evidence.alarm, alarm);
    }
}
