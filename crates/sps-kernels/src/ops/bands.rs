//! How work on a feature map is split over threads.

use std::cell::{Cell, RefCell};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::grid::{Grid, pixels};
use super::words::Word;

/// Whether a kernel may use more than the calling thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Threads {
    /// The calling thread alone: others work on other images.
    One,
    /// Every thread of the caller's team, by default of the pool that it is in.
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
    pub(crate) target: &'a mut [W],
}

impl<W> Band<'_, W> {
    /// The rows of a map that the pixels are, counted over all frames.
    pub(crate) fn rows(&self, grid: &Grid) -> Range<usize> {
        let width = grid.size[2].max(1);
        self.pixels.start / width..self.pixels.end / width
    }
}

/// How long threads that have nothing to do stay awake during a pass: to wake one takes longer than many a layer.
pub(crate) const SPIN: Duration = Duration::from_millis(2);

/// Until a caller asks again for a thread that is in no pass.
const RETRY: Duration = Duration::from_micros(100);

thread_local! {
    /// How many threads share the work that this one does, where that is part of a pass; 0 elsewhere.
    static TEAM: Cell<usize> = const { Cell::new(0) };
    /// Set once the pass is over that this thread stays awake for.
    static AWAKE_FOR: RefCell<Option<Arc<AtomicBool>>> = const { RefCell::new(None) };
}

/// Runs `work`, a pass, by all threads of the pool that the caller is in.
pub(crate) fn inside_pool<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    pass(rayon::current_num_threads(), SPIN, work)
}

/// Runs `work`, which so many threads share, on a thread of the pool that the caller is in: from outside, each
/// parallel step in it would be handed over and waited for asleep. A thread that waits within a pass begins
/// none from outside: neither would be over before the other.
pub(crate) fn pass<T: Send>(threads: usize, spin: Duration, work: impl FnOnce() -> T + Send) -> T {
    let run = |work| {
        let _awake = awake(threads, spin);
        by_team(threads, work)
    };
    if rayon::current_thread_index().is_some() {
        return run(work);
    }
    let mut work = Some(work);
    loop {
        if let Some(outcome) = rayon::scope(|_| work.take_if(|_| !in_pass()).map(run)) {
            return outcome;
        }
        std::thread::sleep(RETRY);
    }
}

fn in_pass() -> bool {
    TEAM.get() > 0
}

/// Does `work`, which so many threads share.
pub(crate) fn by_team<T>(threads: usize, work: impl FnOnce() -> T) -> T {
    let before = TEAM.replace(threads);
    let _restored = AtEnd(|| TEAM.set(before));
    work()
}

/// Does something when it is dropped, also by a panic.
struct AtEnd<F: FnMut()>(F);

impl<F: FnMut()> Drop for AtEnd<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

/// How many threads share the work of the caller.
fn team() -> usize {
    match TEAM.get() {
        0 => rayon::current_num_threads(),
        threads => threads,
    }
}

/// Has other threads of the pool look for work until what it returns is dropped.
fn awake(threads: usize, spin: Duration) -> AtEnd<impl FnMut()> {
    let over = Arc::new(AtomicBool::new(false));
    let threads = if spin.is_zero() { 1 } else { threads };
    for _ in 1..threads {
        let over = Arc::clone(&over);
        rayon::spawn(move || {
            // Taken up where a thread waits within a pass, or is awake already: for the later one, then.
            if !in_pass() && AWAKE_FOR.replace(Some(over)).is_none() {
                look_for_work(spin);
            }
        });
    }
    AtEnd(move || over.store(true, Ordering::Relaxed))
}

/// Does pieces of the pool's work until the pass is over or there was none for so long.
fn look_for_work(spin: Duration) {
    let over = |pass: &Option<Arc<AtomicBool>>| {
        pass.as_ref()
            .is_none_or(|over| over.load(Ordering::Relaxed))
    };
    let mut since = Instant::now();
    while !AWAKE_FOR.with_borrow(over) && since.elapsed() < spin {
        match rayon::yield_now() {
            Some(rayon::Yield::Executed) => since = Instant::now(),
            _ => std::thread::yield_now(),
        }
    }
    AWAKE_FOR.take();
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
            let count = 2 * team();
            let per_frame = count.div_ceil(grid.frames.max(1));
            on_all_threads(bands(per_frame, together, grid, target), work);
        }
    }
}

/// Does `work` on each item, on the threads that share the caller's work. The caller takes items from the end, the
/// others from the start, so that neighbours lie in one cache from layer to layer. Then it waits for those
/// that others have taken, for nothing else, and awake: the system may wake a thread on the core of
/// the one that called it, where both then lie for milliseconds.
pub(crate) fn on_all_threads<T: Send>(items: Vec<T>, work: impl Fn(T) + Send + Sync) {
    let helpers = team().min(items.len()).saturating_sub(1);
    let items = Mutex::new(items.into_iter());
    let take = |last: bool| {
        let mut items = items.lock().unwrap_or_else(PoisonError::into_inner);
        let item = if last {
            items.next_back()
        } else {
            items.next()
        };
        drop(items);
        item.map(&work).is_some()
    };
    if helpers == 0 {
        while take(false) {}
    } else {
        share(helpers, &take);
    }
}

/// Until no item is left, the caller takes the last one (`take(true)`) and so many helpers the first.
fn share(helpers: usize, take: &(dyn Fn(bool) -> bool + Sync)) {
    let [begun, done] = [const { AtomicUsize::new(0) }; 2];
    rayon::scope(|scope| {
        for _ in 0..helpers {
            scope.spawn(|_| {
                let _done = AtEnd(|| {
                    done.fetch_add(1, Ordering::Relaxed);
                });
                begun.fetch_add(1, Ordering::Relaxed);
                if !in_pass() {
                    by_team(1, || while take(false) {});
                }
            });
        }
        while take(true) {}
        // Where the scope waited itself, it would run passes of others.
        while done.load(Ordering::Relaxed) < helpers {
            let here = begun.load(Ordering::Relaxed) < helpers;
            if !here || rayon::yield_local() != Some(rayon::Yield::Executed) {
                std::thread::yield_now();
            }
        }
    });
}

/// A range in pieces of so many.
pub(super) fn chunks(range: Range<usize>, count: usize) -> impl Iterator<Item = Range<usize>> {
    let Range { start, end } = range;
    (start..end)
        .step_by(count)
        .map(move |from| from..(from + count).min(end))
}

/// Bands of whole rows, at most so many of each frame; none reaches over two frames.
pub(super) fn bands<'a, W>(
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
                grid.row_start(to)
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
