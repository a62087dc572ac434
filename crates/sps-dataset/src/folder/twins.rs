use std::collections::HashMap;

use sps_base::parallel;

use super::DatasetFolder;
use crate::pattern::{SIDE, dot, pattern, unit_vectors};
use crate::{RollAngle, Source, SourceError, Surface};

/// What became of the groups of a dataset as near twins were kept together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NearTwins {
    /// How many groups there are now.
    pub groups: usize,
    /// Surfaces in the largest.
    pub largest: usize,
}

impl DatasetFolder {
    /// Joins the groups of surfaces that show one weave, grain or print, though in other colours.
    ///
    /// A photograph is taken as a grey image whose shorter side is 256 pixels. It is described by
    /// the energies of first and second differences in four directions at five scales, each scale
    /// half as large as the one before, in decibels less their mean. Descriptions are centred and
    /// whitened over all surfaces; two are as alike as the cosine of the angle between them. Two
    /// surfaces are near twins where the mean likeness of the view nearest to nadir and of the view
    /// farthest from it is at least `likeness`; a photograph whose grey values hardly differ is like
    /// no other. Twins of twins share a group too, and surfaces that shared one still do: a group
    /// has the name that the first of its surfaces had.
    ///
    /// As descriptions are compared with their mean, a dataset of one pattern alone has no twins.
    ///
    /// # Errors
    /// As [`Source::frame`].
    pub fn keep_near_twins_together(&mut self, likeness: f64) -> Result<NearTwins, SourceError> {
        let views = self.compared_views();
        let described = views.iter().map(|&view| {
            let patterns = parallel::map(0..self.surfaces.len(), |at| {
                let frame = self.frame_to_resize(at, view, Some(SIDE))?;
                Ok(pattern(&frame))
            });
            let patterns = patterns.into_iter().collect::<Result<_, _>>()?;
            Ok(unit_vectors(patterns))
        });
        let views = described.collect::<Result<Vec<_>, SourceError>>()?;
        Ok(join(&mut self.surfaces, &views, likeness))
    }

    /// The view nearest to nadir and the one farthest from it, which may be the same.
    fn compared_views(&self) -> Vec<usize> {
        let angles = self.view_angles();
        let tilt = |&view: &usize| angles[view].0.abs();
        let nearest = self.nearest_view(RollAngle::NADIR);
        let farthest = (0..angles.len()).max_by(|a, b| tilt(a).total_cmp(&tilt(b)));
        let mut views: Vec<usize> = nearest.into_iter().chain(farthest).collect();
        views.dedup();
        views
    }
}

/// Joins groups whose surfaces are alike; `views` has for each view a unit vector of each surface.
fn join(surfaces: &mut [Surface], views: &[Vec<Option<Vec<f64>>>], likeness: f64) -> NearTwins {
    let alike = |a: usize, b: usize| {
        let of_view = |view: &Vec<Option<Vec<f64>>>| match (&view[a], &view[b]) {
            (Some(a), Some(b)) => dot(a, b),
            _ => 0.0,
        };
        views.iter().map(of_view).sum::<f64>() / views.len() as f64 >= likeness
    };
    let twins = parallel::map(0..surfaces.len(), |a| -> Vec<(usize, usize)> {
        let later = a + 1..surfaces.len();
        later.filter(|&b| alike(a, b)).map(|b| (a, b)).collect()
    });

    let mut seen: HashMap<&str, usize> = HashMap::new();
    let groups = surfaces.iter().map(|surface| surface.group.as_str());
    let first = |(at, group)| *seen.entry(group).or_insert(at);
    // The first surface of each one's group.
    let mut firsts: Vec<usize> = groups.enumerate().map(first).collect();
    for (a, b) in twins.into_iter().flatten() {
        let [kept, joined] = [firsts[a].min(firsts[b]), firsts[a].max(firsts[b])];
        if kept < joined {
            let moved = firsts.iter_mut().filter(|first| **first == joined);
            moved.for_each(|first| *first = kept);
        }
    }
    let mut sizes = vec![0_usize; surfaces.len()];
    for (at, first) in firsts.into_iter().enumerate() {
        sizes[first] += 1;
        let name = surfaces[first].group.clone();
        surfaces[at].group = name;
    }
    NearTwins {
        groups: sizes.iter().filter(|&&size| size > 0).count(),
        largest: sizes.into_iter().max().unwrap_or(0),
    }
}
