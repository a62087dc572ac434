//! Threads share out the rows of a feature map or, where that is less to read, the columns of the
//! weights: the bits are those of one thread.

use super::noise;
use crate::ops::bands::{Threads, inside_pool};
use crate::ops::conv::{Conv, ConvShape};
use crate::ops::grid::{Grid, Window};
use crate::ops::product::{Activation, Columns, Epilogue};
use crate::ops::simd::Level;
use crate::ops::words::{Bf16Pair, Bytes, Word};

/// Whole numbers, so that words of any kind hold them.
fn whole(len: usize, seed: u64, scale: f64) -> Vec<f32> {
    let numbers = noise(len, seed).into_iter();
    numbers.map(|x| (scale * x).round() as f32).collect()
}

/// What so many threads write onto a map that is there, with numbers of each frame's own.
fn onto<W: Word>(threads: usize, outputs: usize, extent: usize) -> Vec<W> {
    let (frames, inputs) = (2, 64);
    let window = Window::square(3, 1, 1);
    let shape = ConvShape {
        window,
        inputs,
        outputs,
        groups: 1,
    };
    let conv = Conv::<W>::pack(
        Level::detect(),
        shape,
        &whole(outputs * inputs * 9, 1, 90.0),
    );
    let map = |channels| Grid::tight(frames, [1, extent, extent], channels).of::<W>();
    let (from, to) = (map(inputs).padded(&window), map(outputs).staggered());
    let words = |len: usize, seed| -> Vec<W> {
        let numbers = whole(len * W::NUMBERS, seed, 127.0);
        let words = numbers.chunks(W::NUMBERS);
        words.map(|some| W::of(|i| some[i].abs())).collect()
    };
    let (source, mut target) = (words(from.len(), 2), words(to.len(), 3));
    let (scale, shift) = (noise(frames * outputs, 4), noise(frames * outputs, 5));
    let scale: Vec<f32> = scale.iter().map(|&x| 1e-3 * x as f32).collect();
    let shift: Vec<f32> = shift.iter().map(|&x| 100.0 * x as f32).collect();
    let epilogue = Epilogue {
        scale: Some(Columns::per_frame(&scale, outputs)),
        shift: Some(Columns::per_frame(&shift, outputs)),
        accumulate: Some(0.5),
        limits: Activation::Relu.limits(),
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build().unwrap().install(|| {
        inside_pool(|| {
            let target = (&mut target[..], &to);
            conv.apply(Threads::All, (&source, &from), target, epilogue);
        });
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

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    same_bits::<f32>();
    same_bits::<Bf16Pair>();
    same_bits::<Bytes>();
}
