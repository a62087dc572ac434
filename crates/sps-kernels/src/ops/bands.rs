//! How work on a feature map is split over threads.

use std::cell::Cell;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use super::grid::{Grid, pixels};
use super::words::Word;

/// Whether a kernel may use more than the calling thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Threads {
    /// The calling thread alone: others work on other images.
    One,
    /// Every thread of the pool that the caller is in.
    All,
}

/// Rows of a feature map, and the part of its memory that holds them.
#[derive(Debug)]
pub(crate) struct Band<'a, W = f32> {
    /// The frames that the rows belong to.
    pub(crate) frames: Range<usize>,
    /// The pixels' numbers, counted over all frames.
    pub(crate) pixels: Range<usize>,
    /// The index in the whole memory at which `target` begins.
    pub(crate) origin: usize,
    /// The memory.
    pub(crate) target: &'a mut [W],
}

impl<W> Band<'_, W> {
    /// The rows of a map that the pixels are, counted over all frames.
    pub(crate) fn rows(&self, grid: &Grid) -> Range<usize> {
        let width = grid.size[2].max(1);
        self.pixels.start / width..self.pixels.end / width
    }
}

/// Runs `work` on a thread of the pool that the caller is in: from outside, each parallel step in it
/// would be handed over and waited for asleep. The pool's other threads stay awake until it is done.
pub(crate) fn inside_pool<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::scope(|_| {
        let _awake = Awake::new();
        work()
    })
}

thread_local! {
    /// Whether a pass runs on this thread, which others may wait for.
    static HOST: Cell<bool> = const { Cell::new(false) };
}

/// Has the pool's other threads look for work until it is dropped: to wake one takes longer than many a
/// layer.
struct Awake {
    over: Arc<AtomicBool>,
    /// Whether this thread was a host already.
    host: bool,
}

impl Awake {
    fn new() -> Self {
        let over = Arc::new(AtomicBool::new(false));
        for _ in 1..rayon::current_num_threads() {
            let over = Arc::clone(&over);
            rayon::spawn(move || {
                // A host may come upon it while it waits for other threads.
                while !HOST.get() && !over.load(Ordering::Relaxed) {
                    look_for_work();
                }
            });
        }
        Self {
            over,
            host: HOST.replace(true),
        }
    }
}

impl Drop for Awake {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        HOST.set(self.host);
    }
}

/// Calls `work` on bands that cover the grid: one band of all frames for [`Threads::One`], and
/// several of each frame for [`Threads::All`].
pub(crate) fn for_each_band<W: Word>(
    threads: Threads,
    grid: &Grid,
    target: &mut [W],
    work: impl Fn(Band<'_, W>) + Send + Sync,
) {
    for_each_band_of(1, threads, grid, target, work);
}

/// As [`for_each_band`], but rows stay together that are, from a time step's first, in the same so many.
pub(super) fn for_each_band_of<W: Word>(
    together: usize,
    threads: Threads,
    grid: &Grid,
    target: &mut [W],
    work: impl Fn(Band<'_, W>) + Send + Sync,
) {
    let frame_pixels = pixels(grid.size);
    match threads {
        Threads::One => work(Band {
            frames: 0..grid.frames,
            pixels: 0..grid.frames * frame_pixels,
            origin: 0,
            target,
        }),
        Threads::All => {
            let count = 2 * rayon::current_num_threads();
            on_all_threads(
                bands(count.div_ceil(grid.frames.max(1)), together, grid, target),
                work,
            );
        }
    }
}

/// Does `work` on each item, on all threads of the pool that the caller is in. The thread that waits for the
/// last ones stays awake: the system may wake a thread on the core of the one that called it, where both
/// then lie for milliseconds.
pub(super) fn on_all_threads<T: Send>(items: Vec<T>, work: impl Fn(T) + Send + Sync) {
    let left = AtomicUsize::new(items.len());
    rayon::scope(|scope| {
        for item in items {
            let (work, done) = (&work, Done(&left));
            scope.spawn(move |_| {
                let _done = done;
                work(item);
            });
        }
        while left.load(Ordering::Relaxed) > 0 {
            look_for_work();
        }
    });
}

/// Counts down when it is dropped, also by a panic.
struct Done<'a>(&'a AtomicUsize);

impl Drop for Done<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Does a piece of the pool's work where there is one.
fn look_for_work() {
    if rayon::yield_now() == Some(rayon::Yield::Idle) {
        std::thread::yield_now();
    }
}

/// Calls `work` on bands that cover the grid, at most so many of each frame, and returns what it says of each, in
/// order.
pub(super) fn map_bands<W: Word, T: Send>(
    per_frame: usize,
    grid: &Grid,
    target: &mut [W],
    work: impl Fn(Band<'_, W>) -> T + Send + Sync,
) -> Vec<T> {
    let bands = bands(per_frame, 1, grid, target);
    bands.into_par_iter().map(work).collect()
}

/// Bands of whole rows, at most so many of each frame; none reaches over two frames.
fn bands<'a, W>(
    per_frame: usize,
    together: usize,
    grid: &Grid,
    target: &'a mut [W],
) -> Vec<Band<'a, W>> {
    let [time, height, width] = grid.size;
    let in_height = height.div_ceil(together).max(1);
    let units = time * in_height;
    let per_frame = per_frame.clamp(1, units.max(1));
    let row = |unit: usize| unit / in_height * height + unit % in_height * together;
    let mut bands = Vec::with_capacity(grid.frames * per_frame);
    let (mut rest, mut origin) = (target, 0);
    for frame in 0..grid.frames {
        for part in 0..per_frame {
            let first = frame * time * height;
            let from = first + row(units * part / per_frame);
            let to = first + row(units * (part + 1) / per_frame);
            let end = if (frame, part) == (grid.frames - 1, per_frame - 1) {
                origin + rest.len()
            } else {
                row_start(grid, to)
            };
            let (target, tail) = rest.split_at_mut(end - origin);
            bands.push(Band {
                frames: frame..frame + 1,
                pixels: from * width..to * width,
                origin,
                target,
            });
            (rest, origin) = (tail, end);
        }
    }
    bands
}

/// The index at which a row's first pixel lies, rows counted over all frames.
fn row_start(grid: &Grid, row: usize) -> usize {
    let [time, height, _] = grid.size;
    let (frame, row) = (row / (time * height), row % (time * height));
    let place = [
        grid.before[0] + row / height,
        grid.before[1] + row % height,
        grid.before[2],
    ];
    grid.index(frame, place)
}
