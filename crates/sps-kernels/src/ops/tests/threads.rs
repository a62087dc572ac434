//! Threads share out the rows of a feature map or, where that is less to read, the columns of the
//! weights: the bits are those of one thread.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;
use crate::ops::bands::{SPIN, by_team, for_each_band, inside_pool, pass};

/// Numbers whose sums depend on their order, but where words hold whole ones alone.
fn numbers<W: Word>(len: usize, seed: u64, scale: f64) -> Vec<f32> {
    let numbers = noise(len, seed).into_iter().map(|x| scale * x);
    numbers
        .map(|x| if W::WHOLE { x.round() } else { x } as f32)
        .collect()
}

/// Words of such numbers, none of them negative.
fn words<W: Word>(len: usize, seed: u64, scale: f64) -> Vec<W> {
    let numbers = numbers::<W>(len * W::NUMBERS, seed, scale);
    let words = numbers.chunks(W::NUMBERS);
    words.map(|some| W::of(|i| some[i].abs())).collect()
}

/// A pass in a pool of so many threads.
fn pass_by<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    by(threads, || inside_pool(work))
}

/// What so many threads write onto a map that is there, with numbers of each frame's own.
fn onto<W: Word>(threads: usize, outputs: usize, extent: usize) -> Vec<W> {
    let (frames, inputs) = (2, 64);
    let window = Window::square(3, 1, 1);
    let shape = shape(window, inputs, outputs, 1);
    let weights = numbers::<W>(outputs * inputs * 9, 1, 90.0);
    let conv = Conv::<W>::pack(Level::detect(), shape, &weights);
    let map = |channels| Grid::tight(frames, [1, extent, extent], channels).of::<W>();
    let (from, to) = (map(inputs).padded(&window), map(outputs).staggered());
    let (source, mut target) = (words(from.len(), 2, 127.0), words(to.len(), 3, 127.0));
    let (scale, shift) = (noise(frames * outputs, 4), noise(frames * outputs, 5));
    let scale: Vec<f32> = scale.iter().map(|&x| 1e-3 * x as f32).collect();
    let shift: Vec<f32> = shift.iter().map(|&x| 100.0 * x as f32).collect();
    let epilogue = Epilogue {
        scale: Some(Columns::per_frame(&scale, outputs)),
        shift: Some(Columns::per_frame(&shift, outputs)),
        accumulate: Some(0.5),
        limits: Activation::Relu.limits(),
    };
    pass_by(threads, || {
        let target = (&mut target[..], &to);
        conv.apply(Threads::All, (&source, &from), target, epilogue);
    });
    target
}

fn same_bits<W: Word + PartialEq>() {
    // Columns on small maps, rows on large ones; panels that no three threads share evenly.
    for (outputs, extent) in [(264, 3), (160, 5), (64, 40)] {
        let expected = onto::<W>(1, outputs, extent);
        for threads in [2, 3, 16] {
            assert!(onto::<W>(threads, outputs, extent) == expected);
        }
    }
}

/// The gradients by so many threads.
fn gradients<W: Real>(
    threads: usize,
    [size, stride]: [usize; 2],
    channels: [usize; 3],
) -> [Vec<f64>; 2] {
    let window = Window::square(size, stride, size / 2);
    let case = Case::new(2, [1, 9, 9], channels, window);
    let weights = numbers::<W>(case.weights(), 1, 1.0);
    let map = |grid: &Grid, seed: u64| words::<W>(grid.len(), seed, 1.0);
    pass_by(threads, || {
        super::gradients(Level::detect(), &case, &weights, map)
    })
}

fn gradients_of_the_same_bits<W: Real>() {
    for window in [[1, 1], [3, 1], [3, 2], [1, 2]] {
        for channels in [[40, 24, 1], [40, 300, 1], [200; 3]] {
            let expected = gradients::<W>(1, window, channels);
            for threads in [2, 3, 16] {
                assert!(gradients::<W>(threads, window, channels) == expected);
            }
        }
    }
}

#[test]
fn any_number_of_threads_gives_gradients_of_the_same_bits() {
    gradients_of_the_same_bits::<f32>();
    gradients_of_the_same_bits::<Bf16Pair>();
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    same_bits::<f32>();
    same_bits::<Bf16Pair>();
    same_bits::<Bytes>();
}

/// The rows of the bands of a map of so many rows and columns, each as long as said, in order.
fn rows(threads: usize, frames: usize, extent: usize) -> Vec<usize> {
    let grid = Grid::tight(frames, [1, extent, extent], 1);
    let (mut map, bands) = (vec![0.0; grid.len()], Mutex::new(Vec::new()));
    pass_by(16, || {
        by_team(threads, || {
            for_each_band(Threads::All, &grid, &mut map, |band| {
                band.target.fill(1.0);
                bands.lock().unwrap().push(band.rows(&grid));
            });
        });
    });
    assert!(map.iter().all(|&x| x == 1.0));
    let mut bands = bands.into_inner().unwrap();
    bands.sort_by_key(|rows| rows.start);
    bands.into_iter().map(|rows| rows.len()).collect()
}

#[test]
fn rows_are_cut_for_the_team() {
    assert_eq!(rows(16, 1, 7), [1; 7]);
    assert_eq!(rows(16, 1, 112).len(), 32);
    assert!(rows(16, 1, 112).iter().all(|rows| (3..5).contains(rows)));
    assert_eq!(rows(2, 1, 8), [2; 4]);
    assert_eq!(rows(3, 3, 8), [4; 6]);
    assert_eq!(rows(1, 1, 8), [4; 2]);
}

thread_local! {
    /// Passes that run on this thread, one within the other.
    static DEPTH: Cell<usize> = const { Cell::new(0) };
}

/// Each pass ends on its thread before another begins there, although each has threads wait for others. How many
/// begin on other threads meanwhile depends on the machine: it is printed.
#[test]
fn passes_of_many_callers_do_not_nest() {
    let [deepest, begun, most] = [const { AtomicUsize::new(0) }; 3];
    let (grid, stack) = (Grid::tight(1, [1, 64, 64], 16), Mutex::new(Vec::new()));
    let one_pass = || {
        let before = begun.fetch_add(1, Ordering::Relaxed);
        DEPTH.set(DEPTH.get() + 1);
        deepest.fetch_max(DEPTH.get(), Ordering::Relaxed);
        let mut map = vec![0.0; grid.len()];
        for _ in 0..500 {
            for_each_band(Threads::All, &grid, &mut map, |band| {
                band.target.iter_mut().for_each(|x| *x += 1.0);
            });
        }
        assert!(map.iter().all(|&x| x == 500.0));
        let place = (rayon::current_thread_index(), (&raw const map).addr());
        stack.lock().unwrap().push(place);
        DEPTH.set(DEPTH.get() - 1);
        let meanwhile = begun.load(Ordering::Relaxed) - before - 1;
        most.fetch_max(meanwhile, Ordering::Relaxed);
    };
    std::thread::scope(|scope| {
        for _ in 0..64 {
            scope.spawn(|| (0..2).for_each(|_| pass(2, SPIN, one_pass)));
        }
    });
    assert_eq!(begun.into_inner(), 128);
    assert_eq!(deepest.into_inner(), 1);
    let mut ends = BTreeMap::new();
    for (thread, place) in stack.into_inner().unwrap() {
        let [low, high] = ends.entry(thread).or_insert([place; 2]);
        (*low, *high) = (place.min(*low), place.max(*high));
    }
    assert!(ends.values().all(|[low, high]| high - low < 16 << 10));
    println!("passes begun by others within one: {}", most.into_inner());
}
