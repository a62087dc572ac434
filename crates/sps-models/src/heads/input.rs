//! From the embeddings of a surface's views to the network's visual input.

use rand::seq::index;
use sps_base::streams::ChaCha8Rng;
use sps_regress::{Embeddings, Spread, Views};

use super::config::{HeadConfig, Input, RelationScale, Scale};

/// Centre and scale of each feature of one slot.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct InputStatistics {
    pub(super) mean: Vec<f32>,
    /// One over the scale; zero for features that never vary in training, which thereby drop out.
    pub(super) factor: Vec<f32>,
}

impl InputStatistics {
    /// Over the given surfaces; over the fixed views, or all where they are drawn.
    pub(super) fn new(
        HeadConfig { scale, input, .. }: &HeadConfig,
        embeddings: &Embeddings,
        surfaces: &[usize],
        views: &Views,
    ) -> Self {
        let width = embeddings.width();
        if *scale == Scale::None {
            return Self {
                mean: vec![0.0; width],
                factor: vec![1.0; width],
            };
        }
        let all: Vec<usize> = (0..embeddings.views()).collect();
        let views = match views {
            Views::Fixed(views) => views,
            Views::Random | Views::Steps(_) => &all,
        };
        let seen = |&surface: &usize| rows(input, embeddings, surface, views);
        let spread = Spread::of(width, surfaces.iter().flat_map(seen));
        let factors = embeddings.block_places().flat_map(|place| {
            // Each block is scaled by itself.
            let common = spread.common(place.clone());
            let spread = &spread;
            place.map(move |feature| {
                if common == 0.0 {
                    return 0.0;
                }
                let scale = match scale {
                    Scale::PerFeature => spread.deviation(feature).max(0.1 * common),
                    Scale::Common | Scale::None => common,
                };
                (1.0 / scale) as f32
            })
        });
        Self {
            mean: spread.mean().iter().map(|&mean| mean as f32).collect(),
            factor: factors.collect(),
        }
    }

    /// Appends `features`, scaled.
    pub(super) fn push(&self, features: &[f32], out: &mut Vec<f32>) {
        let parameters = self.mean.iter().zip(&self.factor);
        let scaled = features.iter().zip(parameters);
        out.extend(scaled.map(|(x, (mean, factor))| (x - mean) * factor));
    }

    /// Appends the visual input of one surface, `slots x width` values.
    pub(super) fn push_seen(
        &self,
        input: &Input,
        embeddings: &Embeddings,
        surface: usize,
        views: &[usize],
        out: &mut Vec<f32>,
    ) {
        for row in rows(input, embeddings, surface, views) {
            self.push(&row, out);
        }
    }
}

/// What the network sees of a surface: one row per slot.
fn rows<'a>(
    input: &Input,
    embeddings: &'a Embeddings,
    surface: usize,
    views: &[usize],
) -> Vec<std::borrow::Cow<'a, [f32]>> {
    let one = |&view: &usize| embeddings.get(surface, view).unwrap_or_default();
    match input {
        Input::Single {} | Input::LateFusion { .. } | Input::Relations { .. } => {
            views.iter().map(|view| one(view).into()).collect()
        }
        Input::ViewPooling {} => {
            let mut largest = vec![f32::NEG_INFINITY; embeddings.width()];
            for features in views.iter().map(one) {
                for (max, &x) in largest.iter_mut().zip(features) {
                    *max = max.max(x);
                }
            }
            vec![largest.into()]
        }
    }
}

impl Input {
    /// How many slots the network has.
    pub(super) fn slots(&self) -> usize {
        match self {
            Self::Single {} | Self::ViewPooling {} => 1,
            Self::LateFusion { views } => *views,
            Self::Relations { scales } => {
                let slots = scales.iter().map(RelationScale::slots);
                slots.fold(0, usize::saturating_add)
            }
        }
    }

    /// How many views fill the slots; `None` for any number.
    pub(super) fn views(&self) -> Option<usize> {
        match self {
            Self::Single {} => Some(1),
            Self::LateFusion { .. } | Self::Relations { .. } => Some(self.slots()),
            Self::ViewPooling {} => None,
        }
    }

    /// Distinct views drawn at random, as many as there are slots, in random order.
    pub(super) fn draw(&self, views: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
        index::sample(rng, views, self.slots().min(views)).into_vec()
    }
}
