//! Convolutions by fewer products, against their definition and the same bits whatever is beside.

use super::*;
use crate::ops::bands::inside_pool;

/// Two frames; as many channels as either size of tiles serves, extents that tiles fill and that they do not.
fn cases() -> Vec<Case> {
    let case = |size, inputs, outputs, window| Case::new(2, size, [inputs, outputs, 1], window);
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

/// What a convolution for inference writes onto what is there.
fn written(case: &Case, threads: Threads, epilogue: Epilogue<'_>) -> Vec<f64> {
    let (x, to) = (noise(case.numbers(), 1), case.to::<f32>());
    let before = noise(to.len(), 3);
    written_from(case, threads, &x, (&before, &to.staggered()), epilogue)
}

/// The same of a map that is given.
fn written_from(
    case: &Case,
    threads: Threads,
    x: &[f64],
    target: (&[f64], &Grid),
    epilogue: Epilogue<'_>,
) -> Vec<f64> {
    let weights = narrow(&noise(case.weights(), 2));
    let conv = Conv::<f32>::pack_for_inference(Level::detect(), case.shape, &weights);
    let source = (x, &case.padded::<f32>(), 0.0);
    convolved((&conv, threads), source, target, epilogue)
}

#[test]
fn sums_are_those_of_the_definition() {
    for case in cases() {
        let x = noise(case.numbers(), 1);
        let expected = case.reference(&x, &noise(case.weights(), 2));
        Level::on_each(|level| {
            let found = written(&case, Threads::All, Epilogue::default());
            let error = distance(&found, &expected);
            let what = (case.shape.inputs, case.shape.outputs, case.size);
            assert!(error < 2e-6, "{what:?}, {level:?}: {error:.1e}");
        });
    }
}

#[test]
fn what_follows_a_sum_is_done_to_it() {
    for case in cases() {
        let outputs = case.shape.outputs;
        let (scale, shift) = (noise(2 * outputs, 4), noise(2 * outputs, 5));
        let (scale, shift) = (narrow(&scale), narrow(&shift));
        let epilogue = Epilogue {
            scale: Some(Columns::per_frame(&scale, outputs)),
            shift: Some(Columns::per_frame(&shift, outputs)),
            accumulate: Some(0.5),
            limits: Activation::Relu6.limits(),
        };
        let plain = written(&case, Threads::One, Epilogue::default());
        let stored = noise(plain.len(), 3);
        let per_frame = plain.len() / 2;
        let pairs = plain.iter().zip(&stored).enumerate();
        let expected = pairs.map(|(i, (sum, stored))| {
            let column = i / per_frame * outputs + i % outputs;
            let y = sum * f64::from(scale[column]) + f64::from(shift[column]);
            (y + 0.5 * stored).clamp(0.0, 6.0)
        });
        let found = written(&case, Threads::One, epilogue);
        let error = distance(&found, &expected.collect::<Vec<_>>());
        assert!(error < 1e-6, "{:?}: {error:.1e}", case.size);
    }
}

#[test]
fn threads_and_frames_beside_change_no_bit() {
    for case in cases() {
        let run = |threads: usize| {
            let epilogue = Epilogue {
                accumulate: Some(1.0),
                ..Epilogue::default()
            };
            let run = || written(&case, Threads::All, epilogue);
            by(threads, || inside_pool(run))
        };
        let expected = run(1);
        for threads in [2, 3, 16] {
            let same = run(threads) == expected;
            assert!(same, "{:?}, {threads} threads", case.size);
        }
        for threads in [Threads::One, Threads::All] {
            let none = Case { frames: 0, ..case };
            assert!(written(&none, threads, Epilogue::default()).is_empty());
        }
        let both = written(&case, Threads::One, Epilogue::default());
        let one = Case { frames: 1, ..case };
        let one = written(&one, Threads::One, Epilogue::default());
        assert!(both[..one.len()] == one, "{:?}", case.size);
    }
}

/// Written twice: onto what was there, then added to itself.
#[test]
fn the_gradient_of_the_input_is_that_of_the_definition() {
    for case in cases() {
        let weights = noise(case.weights(), 2);
        let output = case.to::<f32>();
        let cotangent = noise(output.len(), 6);
        let mut expected = vec![0.0; case.numbers()];
        for [pixel, tap, from] in case.pairs() {
            for out in 0..case.shape.outputs {
                let slope = cotangent[pixel * case.shape.outputs + out];
                for input in 0..case.shape.inputs {
                    let weight =
                        (out * case.shape.inputs + input) * pixels(case.shape.window.size) + tap;
                    expected[from * case.shape.inputs + input] += slope * weights[weight];
                }
            }
        }
        Level::on_each(|level| {
            let transpose = ConvTranspose::<f32>::pack(level, case.shape, &narrow(&weights));
            let layout = transpose.layout(case.frames, case.size, output.size);
            let gradient = laid_out(&cotangent, &layout, 0.0);
            let to = case.from::<f32>();
            let mut target = vec![1.0; to.len()];
            for accumulate in [false, true] {
                transpose.apply((&gradient, &layout), (&mut target, &to), accumulate);
            }
            let twice: Vec<f64> = expected.iter().map(|x| 2.0 * x).collect();
            let error = distance(&wide(&target), &twice);
            assert!(error < 2e-6, "{:?}, {level:?}: {error:.1e}", case.size);
        });
    }
}

#[test]
fn the_gradient_of_the_weights_is_that_of_the_definition() {
    for case in cases() {
        let x = noise(case.numbers(), 1);
        let cotangent = noise(case.to::<f32>().len(), 6);
        let expected = case.weight_gradient(&x, &cotangent);
        let from = case.padded::<f32>();
        let to = Grid {
            before: [0, 1, 2],
            ..case.to::<f32>()
        };
        let source = laid_out::<f32>(&x, &from, 0.0);
        let gradient = laid_out::<f32>(&cotangent, &to, 0.0);
        let found = |level| {
            let mut target = vec![1.0; expected.len()];
            let ends = ((&source[..], &from), (&gradient[..], &to));
            weight_gradient(level, &case.shape, ends.0, ends.1, &mut target);
            target
        };
        let once = found(Level::detect());
        for threads in [1, 3, 16] {
            let again = by(threads, || found(Level::detect()));
            assert!(again == once, "{:?}, {threads} threads", case.size);
        }
        Level::on_each(|level| {
            let target = found(level);
            let error = distance(&wide(&target), &expected);
            assert!(error < 2e-6, "{:?}, {level:?}: {error:.1e}", case.size);
        });
    }
}

/// A tile shares sums among its outputs: what rounds beside a bright pixel rounds as that, and nothing further off.
#[test]
fn a_bright_pixel_is_felt_in_its_tiles_alone() {
    for case in cases() {
        let (to, dark) = (case.to::<f32>(), noise(case.numbers(), 1));
        let epilogue = Epilogue::default();
        let run = |x: &[f64]| written_from(&case, Threads::All, x, (&[], &to), epilogue);
        let mut bright = dark.clone();
        bright[..case.shape.inputs].fill(1e8);
        let (dark, bright) = (run(&dark), run(&bright));
        let far = |pixel: usize| {
            let [_, height, width] = to.size;
            let (row, column) = (pixel / width % height, pixel % width);
            row >= 6 || column >= 6
        };
        let [dark, bright] = [&dark, &bright].map(|map| map.chunks_exact(to.channels));
        for (pixel, (dark, bright)) in dark.zip(bright).enumerate() {
            assert!(bright.iter().all(|value| value.is_finite()));
            let same = !far(pixel) || dark == bright;
            assert!(same, "{:?}, pixel {pixel}", case.size);
        }
    }
}
