//! How a batch of images is shared among threads.

use std::fmt::Debug;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::fused::{Fused, GROUP, Seen, Workspace};
use super::images::{Normalisation, Order};
use super::windows::CellSums;
use crate::ops::bands::{Threads, inside_pool};
use crate::ops::grid::Size;
use crate::ops::mean::frame_means;
use crate::ops::words::Word;

/// Images and what is taken out of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Images<'a> {
    /// `(3, ..size)` or `(..size, 3)` each
    pub(super) pixels: &'a [&'a [f32]],
    pub(super) order: Order,
    pub(super) size: Size,
    pub(super) normalisation: &'a Normalisation,
}

impl<'a> Images<'a> {
    pub(super) fn frames(&self) -> usize {
        self.pixels.len()
    }

    /// The images one by one.
    pub(super) fn iter(&self) -> impl Iterator<Item = &'a [f32]> {
        self.pixels.iter().copied()
    }

    fn split_at(self, frames: usize) -> (Self, Self) {
        let (left, right) = self.pixels.split_at(frames);
        let with = |pixels| Self { pixels, ..self };
        (with(left), with(right))
    }

    fn chunks(self, frames: usize) -> impl Iterator<Item = Self> {
        let chunks = self.pixels.chunks(frames);
        chunks.map(move |pixels| Self { pixels, ..self })
    }
}

/// The images of a batch that lies in memory as a whole.
pub(super) fn each(values: &[f32], size: Size) -> Vec<&[f32]> {
    let len = 3 * size.iter().product::<usize>();
    values.chunks_exact(len.max(1)).collect()
}

/// A network of any kind and of any words on the CPU kernels.
pub(super) trait Kernels: Debug + Send + Sync {
    /// Embeds a batch, `(frames, width)`.
    ///
    /// As many frames as the threads can share evenly are each embedded by one thread; the
    /// threads then work together on those that are left.
    fn embed(&self, images: Images<'_>) -> Vec<f32>;

    /// The sums of the feature maps of one image at each depth, by all threads together.
    fn cell_sums(&self, image: Images<'_>) -> Vec<CellSums>;
}

impl<W: Word> Kernels for Pooled<W> {
    fn embed(&self, images: Images<'_>) -> Vec<f32> {
        inside_pool(|| self.embed_inside(images))
    }

    fn cell_sums(&self, image: Images<'_>) -> Vec<CellSums> {
        let mut sums = Vec::new();
        let see = |seen: Seen<'_, W>| sums.push(CellSums::new(seen.memory, seen.grid, seen.scale));
        let network = &self.network;
        inside_pool(|| self.with_workspace(|w| network.walk(Threads::All, &image, w, see)));
        sums
    }
}

/// A network and the workspaces that are not in use.
#[derive(Debug)]
pub(super) struct Pooled<W> {
    network: Fused<W>,
    workspaces: Mutex<Vec<Workspace<W>>>,
}

impl<W: Word> Pooled<W> {
    pub(super) fn new(network: Fused<W>) -> Self {
        Self {
            network,
            workspaces: Mutex::new(Vec::new()),
        }
    }

    fn embed_inside(&self, images: Images<'_>) -> Vec<f32> {
        let width = self.network.width();
        let mut embeddings = vec![0.0; images.frames() * width];
        let threads = rayon::current_num_threads();
        let share = images.frames() / threads;
        let (even, left) = images.split_at(share * threads);
        let (even_out, left_out) = embeddings.split_at_mut(share * threads * width);
        if share > 0 {
            let outs = even_out.chunks_mut(share * width);
            let shares: Vec<_> = even.chunks(share).zip(outs).collect();
            shares
                .into_par_iter()
                .for_each(|(images, out)| self.embed_groups(Threads::One, images, out));
        }
        if left.frames() > 0 {
            self.embed_groups(Threads::All, left, left_out);
        }
        embeddings
    }

    fn embed_groups(&self, threads: Threads, images: Images<'_>, embeddings: &mut [f32]) {
        self.with_workspace(|workspace| {
            let width = self.network.width();
            let outs = embeddings.chunks_mut(GROUP * width);
            for (images, out) in images.chunks(GROUP).zip(outs) {
                self.network.walk(threads, &images, workspace, |seen| {
                    let frames = out.chunks_exact_mut(width).skip(seen.first);
                    let mut means: Vec<&mut [f32]> = frames
                        .take(seen.grid.frames)
                        .map(|frame| &mut frame[seen.block.clone()])
                        .collect();
                    frame_means(
                        threads,
                        self.network.level(),
                        seen.memory,
                        seen.grid,
                        &mut means,
                    );
                    for mean in means.into_iter().flatten() {
                        *mean = seen.scale.value(*mean);
                    }
                });
            }
        });
    }

    /// Runs `work` with a workspace that is not in use.
    fn with_workspace<T>(&self, work: impl FnOnce(&mut Workspace<W>) -> T) -> T {
        let lock = || {
            self.workspaces
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
        };
        let mut workspace = lock().pop().unwrap_or_default();
        let outcome = work(&mut workspace);
        lock().push(workspace);
        outcome
    }
}
