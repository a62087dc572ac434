//! A network in inference.
//!
//! The plan is made once from the network's layers. Batch norm is folded into the convolution
//! before it. What follows a convolution, up to the gate, the shortcut and the rectifier of a residual
//! branch, happens where it stores its sums: the mean of a 1x1 convolution's output is that
//! convolution of the mean of its input, so the gate is known before. Convolutions side by side
//! write into one map. A map lies in memory with the padding that its readers need around it, in a
//! slot that is free again once it has been read.

mod folded;
mod fused;
mod gate;
mod resources;
mod scales;
mod slots;
#[cfg(test)]
mod tests;

use std::fmt::Debug;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

pub use resources::Resources;
pub use scales::Scale;

use crate::error::{Error, Result};
use crate::images::Images;
use crate::network::{Map, Network};
use crate::ops::bands::{Threads, by_team, inside_pool, on_all_threads, pass};
use crate::ops::grid::Grid;
use crate::ops::mean::frame_means;
use crate::ops::simd::Level;
use crate::ops::words::{Bf16Pair, Bytes, Word};
use crate::precision::Precision;
use crate::tensors::{self, Tensors};
use crate::windows::CellSums;
use fused::{Fused, GROUP, Seen, Workspace};
use resources::{Share, shares};
use scales::Values;

/// A network with its tensors, ready to embed images. Clones share it. The page of
/// [`network`](crate::network) has an example.
#[derive(Debug, Clone)]
pub struct Inference {
    kernels: Arc<dyn Kernels>,
    resources: Resources,
}

impl Inference {
    /// Lays a network's tensors out for the kernels. int8 needs the scale of each map of the network, from
    /// [`calibrate`]; further ones are left alone.
    ///
    /// # Errors
    /// Tensors that are not the network's; int8 with too few scales.
    pub fn new(
        network: &Network,
        tensors: &dyn Tensors,
        precision: Precision,
        scales: Option<&[Scale]>,
        level: Level,
    ) -> Result<Self> {
        tensors::check(network, tensors)?;
        match precision {
            Precision::F32 => Self::of::<f32>(network, tensors, None, (level, false)),
            Precision::Bf16x2 => Self::of::<f32>(network, tensors, None, (level, true)),
            Precision::Bf16 => Self::of::<Bf16Pair>(network, tensors, None, (level, false)),
            Precision::Int8 => {
                let maps = network.channels.len();
                let Some(of_maps) = scales.and_then(|scales| scales.get(..maps)) else {
                    let found = scales.map_or(0, <[Scale]>::len);
                    return Err(Error::input("scales for int8", found, maps));
                };
                Self::of::<Bytes>(network, tensors, Some(of_maps.to_vec()), (level, false))
            }
        }
    }

    fn of<W: Word>(
        network: &Network,
        tensors: &dyn Tensors,
        scales: Option<Vec<Scale>>,
        kernels: (Level, bool),
    ) -> Result<Self> {
        Ok(Self {
            kernels: Arc::new(Pooled {
                fused: Fused::<W>::new(network, tensors, scales, kernels)?,
                workspaces: Mutex::default(),
            }),
            resources: Resources::default(),
        })
    }

    /// What passes may take.
    pub fn resources(&self) -> Resources {
        self.resources
    }

    /// The same network, whose passes may take something else. Clones that there are already keep to theirs.
    #[must_use]
    pub fn with_resources(self, resources: Resources) -> Self {
        Self { resources, ..self }
    }

    /// Gives back to the system the memory that is kept for passes to come, for all clones.
    pub fn shrink(&self) {
        self.kernels.shrink();
    }

    /// Bytes that are kept for passes to come, for all clones together.
    pub fn idle_bytes(&self) -> usize {
        self.kernels.idle_bytes()
    }

    /// Embeds a batch, `(images, width)`, on the threads of the caller's rayon pool. The embedding of an image is
    /// the same to the last bit whatever else is in the batch and however many threads there are.
    ///
    /// As many images as the threads can share evenly are each embedded by one thread. Those that are left go to one
    /// thread each, or to teams of threads that share the rows of feature maps, whichever is sooner done.
    ///
    /// Callers from outside the pool wait until one of its threads is in no other pass.
    ///
    /// # Errors
    /// Images smaller than the network takes.
    pub fn embed(&self, images: &Images<'_>) -> Result<Vec<f32>> {
        self.kernels.embed(images, &self.resources)
    }

    /// The sums of the feature maps of the first of the images at each depth, for
    /// [`Windows::embed`](crate::Windows::embed), by all threads together.
    ///
    /// # Errors
    /// An image smaller than the network takes.
    pub fn cell_sums(&self, image: &Images<'_>) -> Result<Vec<CellSums>> {
        self.kernels.cell_sums(image, &self.resources)
    }
}

/// The scale of each map of a network in int8, found on images like those that it is to embed. A few dozen
/// are enough.
///
/// The images go through the network in f32. A map's numbers are then 255 steps from the least to
/// the largest of its values, 0 among them, after each end was brought nearer to 0 by as many hundredths
/// as make the squared error of rounding and clipping least over these images: first the upper end,
/// then the lower one, then the upper one again.
///
/// # Errors
/// Tensors that are not the network's, images smaller than it takes, no image at all, one that makes a feature map
/// that is not finite.
pub fn calibrate(
    network: &Network,
    tensors: &dyn Tensors,
    batches: &[Images<'_>],
    level: Level,
) -> Result<Vec<Scale>> {
    tensors::check(network, tensors)?;
    let fused = Fused::<f32>::new(network, tensors, None, (level, false))?;
    let mut seen = vec![Values::new(); network.channels.len()];
    for images in batches {
        fused.check(images)?;
        let see = |map: Map, memory: &[f32], grid: &Grid| {
            for place in grid.places() {
                seen[map].see(&memory[place..place + grid.channels]);
            }
        };
        inside_pool(|| fused.each_map(Threads::All, images, see));
    }
    scales::scales(network, &seen)
}

/// A network of any words.
trait Kernels: Debug + Send + Sync {
    fn embed(&self, images: &Images<'_>, resources: &Resources) -> Result<Vec<f32>>;

    fn cell_sums(&self, image: &Images<'_>, resources: &Resources) -> Result<Vec<CellSums>>;

    fn shrink(&self);

    fn idle_bytes(&self) -> usize;
}

impl<W: Word> Kernels for Pooled<W> {
    fn embed(&self, images: &Images<'_>, resources: &Resources) -> Result<Vec<f32>> {
        self.fused.check(images)?;
        let worth = resources.worth(self.fused.layer_multiply_adds(images.size));
        let shares = shares(images.frames(), resources.of_pool(), worth);
        let threads = |shares: &Vec<Share>| shares.iter().map(|share| share.threads).sum();
        let threads = shares.iter().map(threads).max().unwrap_or(1);
        let run = || self.embed_shares(shares, *images, resources);
        Ok(pass(threads, resources.spin, run))
    }

    fn cell_sums(&self, image: &Images<'_>, resources: &Resources) -> Result<Vec<CellSums>> {
        self.fused.check(image)?;
        let (image, _) = image.split_at(1);
        let mut sums = Vec::new();
        let see = |seen: Seen<'_, W>| sums.push(CellSums::new(seen.memory, seen.grid, seen.scale));
        let walk = |w: &mut Workspace<W>| self.fused.walk(Threads::All, &image, w, see);
        let worth = resources.worth(self.fused.layer_multiply_adds(image.size));
        let threads = resources.of_pool().min(worth);
        let run = || self.with_workspace(resources, walk);
        pass(threads, resources.spin, run);
        Ok(sums)
    }

    fn shrink(&self) {
        drop(std::mem::take(&mut *self.idle()));
    }

    fn idle_bytes(&self) -> usize {
        self.idle().iter().map(Workspace::bytes).sum()
    }
}

/// A network and the workspaces that are not in use.
#[derive(Debug)]
struct Pooled<W> {
    fused: Fused<W>,
    workspaces: Mutex<Vec<Workspace<W>>>,
}

impl<W: Word> Pooled<W> {
    fn embed_shares(
        &self,
        shares: [Vec<Share>; 2],
        images: Images<'_>,
        resources: &Resources,
    ) -> Vec<f32> {
        let width = self.fused.network.width();
        let mut embeddings = vec![0.0; images.frames() * width];
        let (mut images, mut outs) = (images, &mut embeddings[..]);
        for shares in shares {
            let mut items = Vec::new();
            for share in shares {
                let (of_share, images_left) = images.split_at(share.frames);
                let (out, outs_left) = outs.split_at_mut(share.frames * width);
                items.push((share.threads, of_share, out));
                (images, outs) = (images_left, outs_left);
            }
            on_all_threads(items, |(threads, images, out)| {
                let team = if threads > 1 {
                    Threads::All
                } else {
                    Threads::One
                };
                let embed = || self.embed_groups(team, images, out, resources);
                by_team(threads, embed);
            });
        }
        embeddings
    }

    fn embed_groups(
        &self,
        threads: Threads,
        images: Images<'_>,
        embeddings: &mut [f32],
        resources: &Resources,
    ) {
        self.with_workspace(resources, |workspace| {
            let width = self.fused.network.width();
            let outs = embeddings.chunks_mut(GROUP * width);
            for (images, out) in images.chunks(GROUP).zip(outs) {
                self.fused.walk(threads, &images, workspace, |seen| {
                    let frames = out.chunks_exact_mut(width).skip(seen.first);
                    let frames = frames.take(seen.grid.frames);
                    let means = frames.map(|frame| &mut frame[seen.block.clone()]);
                    let mut means: Vec<&mut [f32]> = means.collect();
                    let (level, grid) = (self.fused.level, seen.grid);
                    frame_means(threads, level, seen.memory, grid, &mut means);
                    for mean in means.into_iter().flatten() {
                        *mean = seen.scale.value(*mean);
                    }
                });
            }
        });
    }

    fn idle(&self) -> MutexGuard<'_, Vec<Workspace<W>>> {
        let idle = self.workspaces.lock();
        idle.unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs `work` with a workspace that is not in use, and keeps it where there is room.
    fn with_workspace<T>(
        &self,
        resources: &Resources,
        work: impl FnOnce(&mut Workspace<W>) -> T,
    ) -> T {
        let mut workspace = self.idle().pop().unwrap_or_default();
        let outcome = work(&mut workspace);
        let mut idle = self.idle();
        let bytes: usize = idle.iter().chain([&workspace]).map(Workspace::bytes).sum();
        if bytes <= resources.memory {
            idle.push(workspace);
        }
        outcome
    }
}
