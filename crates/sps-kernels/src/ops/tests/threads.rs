//! Threads share out the rows of a feature map or, where that is less to read, the columns of the
//! weights: the bits are those of one thread.

use super::{noise, shape};
use crate::ops::bands::{Threads, inside_pool};
use crate::ops::conv::Conv;
use crate::ops::conv_input::ConvTranspose;
use crate::ops::conv_weight::weight_gradient;
use crate::ops::grid::{Grid, Window};
use crate::ops::product::{Activation, Columns, Epilogue};
use crate::ops::simd::Level;
use crate::ops::words::{Bf16Pair, Bytes, Real, Word};

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

/// Works in a pool of so many threads.
fn by<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build().unwrap().install(|| inside_pool(work))
}

/// What so many threads write onto a map that is there, with numbers of each frame's own.
fn onto<W: Word>(threads: usize, outputs: usize, extent: usize) -> Vec<W> {
    let (frames, inputs) = (2, 64);
    let window = Window::square(3, 1, 1);
    let shape = shape(window, inputs, outputs, 1);
    let conv = Conv::<W>::pack(
        Level::detect(),
        shape,
        &numbers::<W>(outputs * inputs * 9, 1, 90.0),
    );
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
    by(threads, || {
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

/// The gradients of a convolution's weights and input, the latter added to what is there.
fn gradients<W: Real>(
    threads: usize,
    size: usize,
    stride: usize,
    outputs: usize,
) -> (Vec<f32>, Vec<W>) {
    let (frames, inputs, input) = (2, 40, [1, 9, 9]);
    let window = Window::square(size, stride, size / 2);
    let shape = shape(window, inputs, outputs, 1);
    let weights = numbers::<W>(outputs * inputs * size * size, 1, 1.0);
    let from = Grid::tight(frames, input, inputs).of::<W>();
    let from = from.padded(&window);
    let output = window.output(input).unwrap();
    let transpose = ConvTranspose::<W>::pack(Level::detect(), shape, &weights);
    let layout = transpose.layout(frames, input, output);
    let (source, gradient) = (words(from.len(), 2, 1.0), words(layout.len(), 3, 1.0));
    let (mut of_weights, to) = (vec![0.0; weights.len()], from.bare());
    let mut of_input = words(to.len(), 4, 1.0);
    by(threads, || {
        let gradient = (&gradient[..], &layout);
        let source = (&source[..], &from);
        weight_gradient(Level::detect(), &shape, source, gradient, &mut of_weights);
        transpose.apply(gradient, (&mut of_input, &to), true);
    });
    (of_weights, of_input)
}

fn gradients_of_the_same_bits<W: Real + PartialEq>() {
    for (size, stride) in [(1, 1), (3, 1), (3, 2), (1, 2)] {
        for outputs in [24, 300] {
            let expected = gradients::<W>(1, size, stride, outputs);
            for threads in [2, 3, 16] {
                assert!(gradients::<W>(threads, size, stride, outputs) == expected);
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
