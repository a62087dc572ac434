//! Multi-scale temporal relations: which ordered groups of views are related.

use std::iter::successors;

use serde::{Deserialize, Serialize};

use crate::error::{SelectError, require, require_some};
use crate::problem::check_sizes;
use crate::stream::{Purpose, Stream};

/// The sampling of Zhou, Andonian, Oliva and Torralba, "Temporal Relational Reasoning in Videos"
/// (ECCV 2018, sections 3.2 and 3.3): for each scale d a few groups of d views in increasing order.
/// The estimate is a sum over scales of the mean over the scale's groups of `h_d(g_d(views))`; the
/// relation heads g and h belong to the estimator.
///
/// Groups of one scale are distinct and every one is equally likely; where a scale has no more
/// groups than `per_scale`, all of them come, in lexicographic order. A draw depends on seed and
/// step alone.
///
/// ```
/// use sps_viewselect::TemporalRelations;
///
/// let relations = TemporalRelations::default().sampler(100, 7)?;
/// for step in 0..3 {
///     for scale in relations.training_step(step) {
///         for views in &scale.groups {
///             assert_eq!(views.len(), scale.views_per_group);
///             assert!(views.is_sorted());
///         }
///     }
/// }
/// // At test time estimates are averaged over several draws.
/// let draws: Vec<_> = relations.test_draws().collect();
/// assert_eq!(draws.len(), 10);
/// # Ok::<(), sps_viewselect::SelectError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct TemporalRelations {
    /// Views per group, one entry for each scale. Default `[2, 3]`: with three views picked, there
    /// are no longer relations.
    pub scales: Vec<usize>,
    /// Groups per scale and draw. Default 3, as in the authors' code (`subsample_num`).
    pub per_scale: usize,
    /// Draws that a test-time estimate is averaged over. Default 10.
    pub test_draws: u64,
}

impl Default for TemporalRelations {
    fn default() -> Self {
        Self {
            scales: vec![2, 3],
            per_scale: 3,
            test_draws: 10,
        }
    }
}

impl TemporalRelations {
    /// Checks the settings against the number of views.
    ///
    /// # Errors
    /// [`SelectError::NoViews`]; [`SelectError::TooManyPicks`] if a scale is larger than `views`;
    /// [`SelectError::NoPicks`] if one is 0; [`SelectError::Setting`] if there is no scale, or
    /// `per_scale` or `test_draws` is 0.
    pub fn sampler(self, views: usize, seed: u64) -> Result<RelationSampler, SelectError> {
        require(!self.scales.is_empty(), "scales", "empty", "at least one")?;
        require_some("per-scale", self.per_scale)?;
        require_some("test-draws", self.test_draws)?;
        for &scale in &self.scales {
            check_sizes(views, scale)?;
        }
        Ok(RelationSampler {
            settings: self,
            views,
            seed,
        })
    }
}

/// The groups of one scale.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Relations {
    /// Views in each group, d.
    pub views_per_group: usize,
    /// The groups, each of d distinct views in increasing order.
    pub groups: Vec<Vec<usize>>,
}

/// Draws relations; made by [`TemporalRelations::sampler`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RelationSampler {
    settings: TemporalRelations,
    views: usize,
    seed: u64,
}

impl RelationSampler {
    /// The relations of one training step, scale by scale.
    pub fn training_step(&self, step: u64) -> Vec<Relations> {
        self.draw(step.wrapping_mul(2))
    }

    /// The draws that a test-time estimate is averaged over, none of them a training step's.
    pub fn test_draws(&self) -> impl Iterator<Item = Vec<Relations>> + '_ {
        (0..self.settings.test_draws).map(|draw| self.draw(draw.wrapping_mul(2) + 1))
    }

    fn draw(&self, index: u64) -> Vec<Relations> {
        let mut stream = Stream::new(self.seed, Purpose::Relations, index);
        let scales = self.settings.scales.iter();
        scales
            .map(|&scale| Relations {
                views_per_group: scale,
                groups: groups(self.views, scale, self.settings.per_scale, &mut stream),
            })
            .collect()
    }
}

fn groups(views: usize, scale: usize, count: usize, stream: &mut Stream) -> Vec<Vec<usize>> {
    if combinations(views, scale) <= count as u128 {
        let first: Vec<usize> = (0..scale).collect();
        return successors(Some(first), |group| next(group, views)).collect();
    }
    let mut groups: Vec<Vec<usize>> = Vec::with_capacity(count);
    while groups.len() < count {
        let mut group = stream.distinct_below(views, scale);
        group.sort_unstable();
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    groups
}

/// N over d, or as much as fits.
fn combinations(views: usize, scale: usize) -> u128 {
    let scale = scale.min(views - scale);
    (0..scale).fold(1_u128, |count, taken| {
        // Whole at every step: a product of k consecutive numbers is a multiple of k!.
        count.saturating_mul((views - taken) as u128) / (taken as u128 + 1)
    })
}

/// The next group in lexicographic order.
fn next(group: &[usize], views: usize) -> Option<Vec<usize>> {
    let scale = group.len();
    // The last place that can still grow, and the smallest views after it.
    let grows = |&place: &usize| group[place] < views - scale + place;
    let place = (0..scale).rev().find(grows)?;
    let grown = (0..scale - place).map(|later| group[place] + 1 + later);
    Some(group[..place].iter().copied().chain(grown).collect())
}
