//! Convolutions by fewer products, against their definition and the same bits whatever is beside.

use super::conv::Case;
use super::{distance, noise};
use crate::ops::bands::{Threads, inside_pool};
use crate::ops::conv::Conv;
use crate::ops::conv_input::ConvTranspose;
use crate::ops::conv_weight::weight_gradient;
use crate::ops::grid::{Grid, Window, pixels};
use crate::ops::product::{Activation, Columns, Epilogue};
use crate::ops::simd::Level;

/// Two frames; as many channels as either size of tiles serves, extents that tiles fill and that they do not.
fn cases() -> Vec<Case> {
    let case = |size, inputs, outputs, window| Case {
        frames: 2,
        size,
        inputs,
        outputs,
        groups: 1,
        window,
    };
    let square = Window::square(3, 1, 1);
    let cube = Window::same([3, 3, 3], [1; 3], [3, 11, 10]);
    let lower = Window {
        before: [0, 2, 0],
        after: [0, 0, 1],
        ..square
    };
    vec![
        case([1, 12, 12], 64, 32, square),
        case([1, 13, 11], 32, 48, square),
        case([1, 10, 21], 144, 128, square),
        case([1, 15, 9], 128, 144, square),
        case([3, 11, 10], 32, 32, cube),
        case([1, 14, 13], 32, 32, Window::square(3, 1, 0)),
        case([1, 12, 11], 48, 32, lower),
    ]
}

fn singles(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&x| x as f32).collect()
}

fn doubles(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&x| f64::from(x)).collect()
}

/// Pixels of a grid without its border.
fn inside(memory: &[f32], grid: &Grid) -> Vec<f32> {
    let pixel = |place: usize| &memory[place..place + grid.channels];
    grid.places().into_iter().flat_map(pixel).copied().collect()
}

/// A map in memory of such a layout.
fn laid_out(values: &[f32], grid: &Grid) -> Vec<f32> {
    let mut memory = vec![0.0; grid.len()];
    let pixels = values.chunks_exact(grid.channels);
    for (place, pixel) in grid.places().into_iter().zip(pixels) {
        memory[place..place + grid.channels].copy_from_slice(pixel);
    }
    memory
}

/// What a convolution writes onto what is there.
fn convolved(case: &Case, threads: Threads, epilogue: Epilogue<'_>) -> Vec<f32> {
    let weights = singles(&noise(case.weights(), 2));
    let conv = Conv::<f32>::pack_for_inference(Level::detect(), case.shape(), &weights);
    let from = Grid::tight(case.frames, case.size, case.inputs).padded(&case.window);
    let output = case.window.output(case.size).unwrap();
    let to = Grid::tight(case.frames, output, case.outputs).staggered();
    let source = laid_out(&singles(&noise(case.numbers(), 1)), &from);
    let mut target = laid_out(
        &singles(&noise(to.frames * pixels(output) * to.channels, 3)),
        &to,
    );
    conv.apply(threads, (&source, &from), (&mut target, &to), epilogue);
    inside(&target, &to)
}

#[test]
fn sums_are_those_of_the_definition() {
    for case in cases() {
        let x = noise(case.numbers(), 1);
        let expected = case.reference(&x, &noise(case.weights(), 2));
        Level::on_each(|level| {
            let found = convolved(&case, Threads::All, Epilogue::default());
            let error = distance(&doubles(&found), &expected);
            let what = (case.inputs, case.outputs, case.size);
            assert!(error < 2e-6, "{what:?}, {level:?}: {error:.1e}");
        });
    }
}

#[test]
fn what_follows_a_sum_is_done_to_it() {
    for case in cases() {
        let outputs = case.outputs;
        let (scale, shift) = (noise(2 * outputs, 4), noise(2 * outputs, 5));
        let (scale, shift) = (singles(&scale), singles(&shift));
        let epilogue = Epilogue {
            scale: Some(Columns::per_frame(&scale, outputs)),
            shift: Some(Columns::per_frame(&shift, outputs)),
            accumulate: Some(0.5),
            limits: Activation::Relu6.limits(),
        };
        let plain = convolved(&case, Threads::One, Epilogue::default());
        let stored = singles(&noise(plain.len(), 3));
        let per_frame = plain.len() / 2;
        let expected = plain
            .iter()
            .zip(&stored)
            .enumerate()
            .map(|(i, (sum, stored))| {
                let column = i / per_frame * outputs + i % outputs;
                let y = f64::from(*sum) * f64::from(scale[column]) + f64::from(shift[column]);
                (y + 0.5 * f64::from(*stored)).clamp(0.0, 6.0)
            });
        let found = convolved(&case, Threads::One, epilogue);
        let error = distance(&doubles(&found), &expected.collect::<Vec<_>>());
        assert!(error < 1e-6, "{:?}: {error:.1e}", case.size);
    }
}

#[test]
fn threads_and_frames_beside_change_no_bit() {
    for case in cases() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().unwrap();
            let epilogue = Epilogue {
                accumulate: Some(1.0),
                ..Epilogue::default()
            };
            pool.install(|| inside_pool(|| convolved(&case, Threads::All, epilogue)))
        };
        let expected = run(1);
        for threads in [2, 3, 16] {
            assert!(
                run(threads) == expected,
                "{:?}, {threads} threads",
                case.size
            );
        }
        for threads in [Threads::One, Threads::All] {
            let none = Case { frames: 0, ..case };
            assert!(convolved(&none, threads, Epilogue::default()).is_empty());
        }
        let both = convolved(&case, Threads::One, Epilogue::default());
        let one = Case { frames: 1, ..case };
        let one = convolved(&one, Threads::One, Epilogue::default());
        assert!(both[..one.len()] == one, "{:?}", case.size);
    }
}

/// Written twice: onto what was there, then added to itself.
#[test]
fn the_gradient_of_the_input_is_that_of_the_definition() {
    for case in cases() {
        let weights = noise(case.weights(), 2);
        let output = case.window.output(case.size).unwrap();
        let cotangent = noise(case.frames * pixels(output) * case.outputs, 6);
        let mut expected = vec![0.0; case.numbers()];
        for [pixel, tap, from] in case.pairs() {
            for out in 0..case.outputs {
                let slope = cotangent[pixel * case.outputs + out];
                for input in 0..case.inputs {
                    let weight = (out * case.inputs + input) * pixels(case.window.size) + tap;
                    expected[from * case.inputs + input] += slope * weights[weight];
                }
            }
        }
        Level::on_each(|level| {
            let transpose = ConvTranspose::<f32>::pack(level, case.shape(), &singles(&weights));
            let layout = transpose.layout(case.frames, case.size, output);
            let gradient = laid_out(&singles(&cotangent), &layout);
            let to = Grid::tight(case.frames, case.size, case.inputs);
            let mut target = vec![1.0; to.len()];
            for accumulate in [false, true] {
                transpose.apply((&gradient, &layout), (&mut target, &to), accumulate);
            }
            let twice: Vec<f64> = expected.iter().map(|x| 2.0 * x).collect();
            let error = distance(&doubles(&target), &twice);
            assert!(error < 2e-6, "{:?}, {level:?}: {error:.1e}", case.size);
        });
    }
}

#[test]
fn the_gradient_of_the_weights_is_that_of_the_definition() {
    for case in cases() {
        let x = noise(case.numbers(), 1);
        let output = case.window.output(case.size).unwrap();
        let cotangent = noise(case.frames * pixels(output) * case.outputs, 6);
        let expected = case.weight_gradient(&x, &cotangent);
        let from = Grid::tight(case.frames, case.size, case.inputs).padded(&case.window);
        let to = Grid::tight(case.frames, output, case.outputs);
        let to = Grid {
            before: [0, 1, 2],
            ..to
        };
        let source = laid_out(&singles(&x), &from);
        let gradient = laid_out(&singles(&cotangent), &to);
        let found = |level| {
            let mut target = vec![1.0; expected.len()];
            let gradient = (&gradient[..], &to);
            weight_gradient(
                level,
                &case.shape(),
                (&source, &from),
                gradient,
                &mut target,
            );
            target
        };
        let once = found(Level::detect());
        for threads in [1, 3, 16] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let again = pool.build().unwrap().install(|| found(Level::detect()));
            assert!(again == once, "{:?}, {threads} threads", case.size);
        }
        Level::on_each(|level| {
            let target = found(level);
            let error = distance(&doubles(&target), &expected);
            assert!(error < 2e-6, "{:?}, {level:?}: {error:.1e}", case.size);
        });
    }
}

/// A tile shares sums among its outputs: what rounds beside a bright pixel rounds as that, and nothing further off.
#[test]
fn a_bright_pixel_is_felt_in_its_tiles_alone() {
    for case in cases() {
        let from = Grid::tight(case.frames, case.size, case.inputs).padded(&case.window);
        let output = case.window.output(case.size).unwrap();
        let to = Grid::tight(case.frames, output, case.outputs);
        let weights = singles(&noise(case.weights(), 2));
        let conv = Conv::<f32>::pack_for_inference(Level::detect(), case.shape(), &weights);
        let dark = singles(&noise(case.numbers(), 1));
        let run = |values: &[f32]| {
            let mut target = vec![0.0; to.len()];
            let source = laid_out(values, &from);
            let target_of = (&mut target[..], &to);
            conv.apply(
                Threads::All,
                (&source, &from),
                target_of,
                Epilogue::default(),
            );
            target
        };
        let mut bright = dark.clone();
        bright[..case.inputs].fill(1e8);
        let (dark, bright) = (run(&dark), run(&bright));
        let far = |pixel: usize| {
            let (row, column) = (pixel / output[2] % output[1], pixel % output[2]);
            row >= 6 || column >= 6
        };
        let rows = dark
            .chunks_exact(to.channels)
            .zip(bright.chunks_exact(to.channels));
        for (pixel, (dark, bright)) in rows.enumerate() {
            assert!(bright.iter().all(|value| value.is_finite()));
            assert!(
                !far(pixel) || dark == bright,
                "{:?}, pixel {pixel}",
                case.size
            );
        }
    }
}
