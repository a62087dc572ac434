//! Speed against error: which methods are worth their time, and what people ask of them.

use serde::{Deserialize, Serialize};

use super::MethodResult;
use crate::config::SpeedConfig;

/// The front of the methods and the answers to two questions, as ids of methods.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Speed {
    /// The methods that no other is both faster and better than, from fast to slow.
    pub front: Vec<String>,
    /// The share asked for, 0.05 for 5 % more error.
    pub within_error: f64,
    /// The fastest method whose error is within so large a share of the best error.
    pub fastest_within_error: Option<String>,
    /// The seconds per surface asked for.
    pub within_seconds: f64,
    /// The method of least error that takes so many seconds per surface at most.
    pub best_within_seconds: Option<String>,
}

/// A method in the plane of the two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Which of the methods.
    pub method: usize,
    /// Per surface at prediction.
    pub seconds: f64,
    /// The share of variance that the estimates leave unexplained, 1 - R².
    pub error: f64,
}

impl Point {
    /// Whether it is as good as `other` in both and better in one.
    fn dominates(&self, other: &Self) -> bool {
        let no_worse = self.seconds <= other.seconds && self.error <= other.error;
        no_worse && (self.seconds < other.seconds || self.error < other.error)
    }
}

/// The methods that have both numbers.
pub fn points(methods: &[MethodResult]) -> Vec<Point> {
    let all = methods.iter().enumerate();
    let points = all.filter_map(|(method, result)| {
        Some(Point {
            method,
            seconds: result.costs.predict_seconds_per_surface?,
            error: 1.0 - result.means.r2_mean?,
        })
    });
    points.collect()
}

/// The methods that look at a photograph, or at its embedding, and have both numbers.
pub fn looking(methods: &[MethodResult]) -> Vec<Point> {
    let mut points = points(methods);
    points.retain(|point| {
        let MethodResult { costs, encoder, .. } = &methods[point.method];
        costs.frames_decoded_per_surface > 0.0 || !encoder.is_empty()
    });
    points
}

/// The Pareto front: the points that none other dominates, from fast to slow. Equal points are all
/// on it or all not.
pub fn front(points: &[Point]) -> Vec<Point> {
    let beaten = |point: &Point| points.iter().any(|other| other.dominates(point));
    let mut front: Vec<Point> = points.iter().copied().filter(|p| !beaten(p)).collect();
    front.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    front
}

/// The fastest of the points whose error is at most `share` above the best; of equally fast ones
/// that of least error.
pub fn fastest(points: &[Point], share: f64) -> Option<Point> {
    let best = points.iter().map(|point| point.error).reduce(f64::min)?;
    let near = points.iter().filter(|p| p.error <= best * (1.0 + share));
    near.min_by(|a, b| by(a, b, |p| [p.seconds, p.error]))
        .copied()
}

/// The point of least error among those that take at most `seconds`; of equally good ones the
/// fastest.
pub fn best_within(points: &[Point], seconds: f64) -> Option<Point> {
    let fast = points.iter().filter(|point| point.seconds <= seconds);
    fast.min_by(|a, b| by(a, b, |p| [p.error, p.seconds]))
        .copied()
}

fn by(a: &Point, b: &Point, of: fn(&Point) -> [f64; 2]) -> std::cmp::Ordering {
    let ([first, second], [other, next]) = (of(a), of(b));
    first.total_cmp(&other).then(second.total_cmp(&next))
}

impl Speed {
    pub(crate) fn of(methods: &[MethodResult], asked: SpeedConfig) -> Self {
        let points = points(methods);
        let id = |point: Point| methods[point.method].id.clone();
        Self {
            front: front(&points).into_iter().map(id).collect(),
            within_error: asked.within_error,
            fastest_within_error: fastest(&points, asked.within_error).map(id),
            within_seconds: asked.within_seconds,
            best_within_seconds: best_within(&points, asked.within_seconds).map(id),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};

    fn of(all: &[(f64, f64)]) -> Vec<Point> {
        let point = |(method, &(seconds, error))| Point {
            method,
            seconds,
            error,
        };
        all.iter().enumerate().map(point).collect()
    }

    #[test]
    fn the_front_is_a_staircase_and_equal_points_share_their_fate() {
        let front = |all: &[(f64, f64)]| -> Vec<usize> {
            let front = front(&of(all)).into_iter();
            front.map(|point| point.method).collect()
        };
        let steps = [(1.0, 0.9), (3.0, 0.5), (2.0, 0.95), (4.0, 0.5), (5.0, 0.2)];
        assert_eq!(front(&steps), [0, 1, 4]);
        let equal = [(1.0, 0.5), (1.0, 0.5), (1.0, 0.6), (2.0, 0.5)];
        assert_eq!(front(&equal), [0, 1]);
        assert!(front(&[]).is_empty());
    }

    /// Against the definition, on small numbers so that many are equal.
    #[test]
    fn no_point_beats_one_of_the_front_and_one_of_the_front_beats_every_other() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut draw = || f64::from(random.next_u32() % 7);
        for count in 1..60 {
            let all: Vec<(f64, f64)> = (0..count).map(|_| (draw(), draw())).collect();
            let points = of(&all);
            let front = front(&points);
            assert!(!front.is_empty());
            for point in &points {
                let better = |p: &&Point| {
                    (p.seconds < point.seconds && p.error <= point.error)
                        || (p.seconds <= point.seconds && p.error < point.error)
                };
                if front.contains(point) {
                    assert_eq!(points.iter().find(better), None);
                } else {
                    assert!(front.iter().any(|p| better(&p)));
                }
            }
            let steps = front.windows(2);
            assert!(steps.into_iter().all(|two| two[0].error >= two[1].error));
        }
    }

    #[test]
    fn the_questions_are_answered() {
        let points = of(&[
            (8.0, 0.50),
            (2.0, 0.51),
            (1.0, 0.511),
            (0.5, 0.9),
            (2.0, 0.505),
        ]);
        // 2 % above 0.5 is 0.51.
        assert_eq!(fastest(&points, 0.02).unwrap().method, 4);
        assert_eq!(fastest(&points, 0.0).unwrap().method, 0);
        assert_eq!(best_within(&points, 1.0).unwrap().method, 2);
        assert_eq!(best_within(&points, 2.5).unwrap().method, 4);
        assert_eq!(best_within(&points, 0.1), None);
        assert_eq!(fastest(&[], 0.02), None);
    }
}
