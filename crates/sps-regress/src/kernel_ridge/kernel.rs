use std::ops::Range;

use faer::Mat;
use serde::{Deserialize, Serialize};

use crate::data::Embeddings;
use crate::dense::product;

/// Squared distances below this part of the squared norms are rounding, and count as none.
const ROUNDING: f64 = 1e-13;

/// How alike one block `x` of the embedding of a view and another `y` are; `w` is the width, a multiple of the
/// block's median distance between training surfaces.
#[derive(Default, Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// `exp(-|x - y| / w)` with the Euclidean norm, as the Matérn kernel of smoothness 1/2
    /// (Rasmussen and Williams 2006, section 4.2.1).
    #[default]
    Exponential,
    /// `exp(-|x - y|² / 2w²)`.
    Gaussian,
    /// `(x - m)(y - m)`, with `m` the training mean: ridge regression. Of several blocks each counts in units of
    /// its variance. It has no width.
    Linear,
}

/// A kernel of one view: the weighted mean of its blocks' kernels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shape {
    /// Which kernel a block has.
    #[serde(rename = "kind")]
    pub kernel: Kernel,
    /// A multiple of the median distance between the training surfaces' embeddings, block by block of each view.
    /// The linear kernel has none.
    #[serde(default = "no_width")]
    pub width: f64,
    /// How much more the later blocks count, which are the deeper ones: block `b` of `n`, from 0, weighs
    /// `exp(leaning b / (n - 1))` over the sum of all. At 0 all count alike.
    #[serde(default)]
    pub leaning: f64,
}

const fn no_width() -> f64 {
    1.0
}

impl Shape {
    /// Of blocks that count alike.
    pub const fn even(kernel: Kernel, width: f64) -> Self {
        Self {
            kernel,
            width,
            leaning: 0.0,
        }
    }

    /// The weight of one of so many blocks; all are 1 together.
    pub(super) fn weight(self, block: usize, blocks: usize) -> f64 {
        let last = blocks.saturating_sub(1).max(1) as f64;
        // Over the largest of them, so that none is more than a number holds.
        let largest = if self.leaning > 0.0 { 1.0 } else { 0.0 };
        let weight = |block: usize| (self.leaning * (block as f64 / last - largest)).exp();
        weight(block) / (0..blocks).map(weight).sum::<f64>()
    }

    /// The kernel at a [proximity](Points::proximities), with the block's scale.
    pub(super) fn at(self, proximity: f64, scale: f64) -> f64 {
        match self.kernel {
            Kernel::Exponential => (-proximity / (self.width * scale)).exp(),
            Kernel::Gaussian => (-0.5 * (proximity / (self.width * scale)).powi(2)).exp(),
            Kernel::Linear => proximity / scale,
        }
    }
}

/// How near surfaces are to each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Proximity {
    /// Euclidean distances.
    Distance,
    /// Products about the training mean, for linear kernels.
    Product,
}

impl Proximity {
    pub(super) fn all_linear(shapes: &[Shape]) -> bool {
        shapes.iter().all(|shape| shape.kernel == Kernel::Linear)
    }

    /// What these kernels are of, which are either all linear or none of them.
    pub(super) fn of(shapes: &[Shape]) -> Self {
        if Self::all_linear(shapes) {
            Self::Product
        } else {
            Self::Distance
        }
    }

    /// The scale of a block's proximities: the median distance of the training surfaces that differ; or of
    /// products their mean for each surface with itself, but for a block alone the number of features.
    pub(super) fn scale(self, proximities: &Mat<f64>, alone: Option<usize>) -> f64 {
        if self == Self::Product {
            let surfaces = proximities.ncols();
            let trace: f64 = (0..surfaces).map(|i| proximities[(i, i)]).sum();
            return match alone {
                Some(features) => features as f64,
                None if trace > 0.0 => trace / surfaces as f64,
                None => 1.0,
            };
        }
        let columns = 0..proximities.ncols();
        let pairs = columns.flat_map(|j| (0..j).map(move |i| proximities[(i, j)]));
        let mut distances: Vec<f64> = pairs.filter(|&distance| distance > 0.0).collect();
        if distances.is_empty() {
            return 1.0;
        }
        let middle = distances.len() / 2;
        let odd = distances.len() % 2 == 1;
        let (below, &mut upper, _) = distances.select_nth_unstable_by(middle, f64::total_cmp);
        let lower = below.iter().copied().fold(0.0, f64::max);
        if odd { upper } else { 0.5 * (lower + upper) }
    }
}

/// One block of a view.
#[derive(Clone, Debug)]
pub(super) struct Part {
    view: usize,
    block: usize,
    /// Its place among the features of the view.
    features: Range<usize>,
}

impl Part {
    /// The blocks of each of the views.
    pub(super) fn all(embeddings: &Embeddings) -> impl Iterator<Item = Self> {
        let of_view = |view| {
            let places = embeddings.block_places().enumerate();
            places.map(move |(block, features)| Self {
                view,
                block,
                features,
            })
        };
        (0..embeddings.views()).flat_map(of_view)
    }

    fn of<'a>(&self, embeddings: &'a Embeddings, surface: usize) -> &'a [f32] {
        &embeddings.view(surface, self.view)[self.features.clone()]
    }
}

/// One block of a view of the training surfaces, ready to be compared with.
pub(super) struct Points {
    proximity: Proximity,
    part: Part,
    views: usize,
    blocks: usize,
    /// Mean of each feature.
    centre: Vec<f64>,
    /// `(width, surfaces)`, less the centre.
    centred: Mat<f64>,
    /// Squared lengths of these.
    norms: Vec<f64>,
}

impl Points {
    pub(super) fn new(proximity: Proximity, embeddings: &Embeddings, part: Part) -> Self {
        let centre = centre(embeddings, &part);
        let points = centred(embeddings, 0..embeddings.surfaces(), &part, &centre);
        Self {
            proximity,
            views: embeddings.views(),
            blocks: embeddings.blocks().len(),
            part,
            norms: norms(&points),
            centre,
            centred: points,
        }
    }

    /// Distances between training surfaces, products where the kernel is linear; `(surfaces,
    /// surfaces)`, and the unit in which they shall be told.
    pub(super) fn among_themselves(&self) -> (Mat<f64>, f64) {
        let proximities = self.compared(&self.centred, &self.norms);
        let alone = (self.blocks == 1).then_some(self.centre.len());
        let scale = self.proximity.scale(&proximities, alone);
        (proximities, scale)
    }

    /// The same from the training surfaces to some of other embeddings; `(training surfaces, those
    /// in the range)`. The embeddings must have the views and blocks of the training surfaces.
    pub(super) fn proximities(&self, embeddings: &Embeddings, range: Range<usize>) -> Mat<f64> {
        let others = centred(embeddings, range, &self.part, &self.centre);
        self.compared(&others, &norms(&others))
    }

    /// Adds the block's kernel at these proximities to the mean over all views, of which all blocks' weights
    /// are 1 together.
    pub(super) fn add(&self, sum: &mut Mat<f64>, proximities: &Mat<f64>, scale: f64, shape: Shape) {
        let weight = shape.weight(self.part.block, self.blocks) / self.views as f64;
        for (sum, proximities) in sum.col_iter_mut().zip(proximities.col_iter()) {
            for (sum, &proximity) in sum.iter_mut().zip(proximities.iter()) {
                *sum += weight * shape.at(proximity, scale);
            }
        }
    }

    fn compared(&self, others: &Mat<f64>, others_norms: &[f64]) -> Mat<f64> {
        let mut products = product(self.centred.transpose(), others);
        if self.proximity == Proximity::Product {
            return products;
        }
        for (column, other) in products.col_iter_mut().zip(others_norms) {
            for (value, norm) in column.iter_mut().zip(&self.norms) {
                let lengths = norm + other;
                let squared = lengths - 2.0 * *value;
                *value = if squared > ROUNDING * lengths {
                    squared.sqrt()
                } else {
                    0.0
                };
            }
        }
        products
    }
}

/// The mean of each feature, exact where all surfaces are equal.
fn centre(embeddings: &Embeddings, part: &Part) -> Vec<f64> {
    let mut sums = vec![0.0; part.features.len()];
    if embeddings.surfaces() == 0 {
        return sums;
    }
    let first = part.of(embeddings, 0);
    for surface in 0..embeddings.surfaces() {
        let values = part.of(embeddings, surface).iter().zip(first);
        for (sum, (&value, &first)) in sums.iter_mut().zip(values) {
            *sum += f64::from(value) - f64::from(first);
        }
    }
    let surfaces = embeddings.surfaces() as f64;
    let mean = |(sum, &first): (&f64, &f32)| f64::from(first) + sum / surfaces;
    sums.iter().zip(first).map(mean).collect()
}

fn centred(embeddings: &Embeddings, range: Range<usize>, part: &Part, centre: &[f64]) -> Mat<f64> {
    Mat::from_fn(centre.len(), range.len(), |feature, column| {
        f64::from(part.of(embeddings, range.start + column)[feature]) - centre[feature]
    })
}

fn norms(points: &Mat<f64>) -> Vec<f64> {
    let squared = |column: faer::ColRef<'_, f64>| column.iter().map(|v| v * v).sum();
    points.col_iter().map(squared).collect()
}
