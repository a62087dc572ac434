//! Convolutions of images against their definition: windows that begin within words, at every stride.

use super::*;
use crate::ops::bands::inside_pool;
use crate::ops::conv_weight::weight_gradient_of_images;
use crate::ops::image::{Layout, rows_of_words};

/// Two images or sequences; windows one to eleven pixels wide, whose places lie one to four pixels apart. A row under the
/// widest is of 17 pairs, which no tile divides.
pub(super) fn cases() -> Vec<Case> {
    let case = |size, window| Case::new(2, size, [3, 32, 1], window);
    let lopsided = Window {
        before: [0, 1, 2],
        after: [0, 0, 1],
        ..Window::square(3, 2, 1)
    };
    vec![
        case([1, 17, 21], Window::square(7, 2, 3)),
        case([1, 9, 8], Window::square(3, 1, 1)),
        case([1, 11, 13], Window::square(5, 3, 2)),
        case([1, 8, 12], Window::square(4, 4, 0)),
        case([1, 13, 15], Window::square(11, 4, 2)),
        case([1, 6, 5], Window::square(1, 1, 0)),
        case([1, 10, 11], lopsided),
        case([3, 7, 10], Window::same([3, 5, 5], [1, 2, 2], [3, 7, 10])),
    ]
}

/// Images in memory, around which lie zeros.
pub(super) fn images<W: Word>(case: &Case, values: &[f64]) -> (Vec<W>, Grid) {
    let grid = Grid::tight(case.frames, case.size, 3).padded(&case.shape.window);
    let rows = rows_of_words::<W>(&grid);
    let mut memory = vec![W::default(); rows.len()];
    let words = rows.size[2];
    for (row, start) in rows.places().into_iter().step_by(words).enumerate() {
        let pixels = &values[row * 3 * case.size[2]..][..3 * case.size[2]];
        let number = |i: usize| {
            let inside = i.checked_sub(3 * grid.before[2])?;
            pixels.get(inside).map(|&x| x as f32)
        };
        for (i, word) in memory[start..][..words].iter_mut().enumerate() {
            *word = W::of(|j| number(W::NUMBERS * i + j).unwrap_or_default());
        }
    }
    (memory, grid)
}

/// The same in cells of 2 x 2 pixels.
fn in_cells<W: Word>(case: &Case, values: &[f64]) -> (Vec<W>, Grid) {
    let grid = Grid::tight(case.frames, case.size, 3).padded(&case.shape.window);
    let cells = Layout::Cells.memory::<W>(&grid);
    let mut memory = vec![W::default(); cells.len()];
    let [time, height, width] = case.size;
    for (i, &value) in values.iter().enumerate() {
        let (channel, x, y) = (i % 3, i / 3 % width, i / 3 / width % height);
        let row = i / 3 / width / height;
        let (x, y) = (x + grid.before[2], y + grid.before[1]);
        let place = [row % time + grid.before[0], y / 2, x / 2];
        let number = (y % 2 * 2 + x % 2) * 3 + channel;
        let cell = &mut memory[cells.index(row / time, place)..][..cells.words];
        W::each_mut(cell)[number] = W::narrowed(value as f32);
    }
    (memory, grid)
}

fn weights(case: &Case) -> Vec<f64> {
    whole(case.weights(), 2, [-2.0, 1.0])
}

fn convolved<W: Word>(level: Level, case: &Case, threads: Threads) -> Vec<f64> {
    let weights = narrow(&weights(case));
    let values = whole(case.numbers(), 1, [0.0, 3.0]);
    let (source, from) = match Layout::of::<W>(level, case.shape.window.stride) {
        Layout::Rows => images::<W>(case, &values),
        Layout::Cells => in_cells::<W>(case, &values),
    };
    // The padding is known once an image is.
    let window = case.shape.window;
    let packed = Window {
        before: [0; 3],
        after: [0; 3],
        ..window
    };
    let shape = ConvShape {
        window: packed,
        ..case.shape
    };
    let conv = Conv::<W>::pack_for_images(level, shape, &weights);
    let to = case.to::<W>().padded(&Window::square(3, 1, 1));
    let mut target = vec![W::default(); to.len()];
    let epilogue = Epilogue {
        limits: [0.0, 255.0],
        ..Epilogue::default()
    };
    let ends = ((&source[..], &from), (&mut target[..], &to));
    conv.apply_by(&window, threads, ends.0, ends.1, epilogue);
    inside(&target, &to)
}

/// Sums of whole numbers, which are exact: of bf16 until they are stored.
#[test]
fn sums_are_those_of_the_definition() {
    for case in cases() {
        let x = whole(case.numbers(), 1, [0.0, 3.0]);
        let expected = case.reference(&x, &weights(&case));
        Level::on_each(|level| {
            for threads in [Threads::One, Threads::All] {
                let run = || {
                    let exact = [
                        convolved::<f32>(level, &case, threads),
                        convolved::<Bytes>(level, &case, threads),
                    ];
                    (exact, convolved::<Bf16Pair>(level, &case, threads))
                };
                let (exact, rounded) = inside_pool(run);
                for (i, sum) in expected.iter().enumerate() {
                    let sum = sum.clamp(0.0, 255.0);
                    let what = format!("{level:?}, {:?}, number {i}", case.shape.window);
                    assert_eq!(exact[0][i], sum, "{what}");
                    assert_eq!(exact[1][i], sum, "{what}");
                    assert!((rounded[i] - sum).abs() <= sum / 256.0, "{what}");
                }
            }
        });
    }
}

#[test]
fn the_gradient_of_the_weights_is_that_of_the_definition() {
    fn gradient<W: Real>(level: Level, case: &Case, x: &[f64], cotangent: &[f64]) -> Vec<f64> {
        let (source, from) = images::<W>(case, x);
        let to = case.to::<W>();
        let gradient = laid_out::<W>(cotangent, &to, 0.0);
        let mut target = vec![1.0; case.weights()];
        let ends = ((&source[..], &from), (&gradient[..], &to));
        weight_gradient_of_images(level, &case.shape, ends.0, ends.1, &mut target);
        wide(&target)
    }
    for case in cases() {
        let x = whole(case.numbers(), 1, [0.0, 3.0]);
        let cotangent = whole(case.to::<f32>().len(), 3, [-2.0, 1.0]);
        let expected = case.weight_gradient(&x, &cotangent);
        Level::on_each(|level| {
            for found in [
                gradient::<f32>(level, &case, &x, &cotangent),
                gradient::<Bf16Pair>(level, &case, &x, &cotangent),
            ] {
                let error = distance(&found, &expected);
                assert_eq!(error, 0.0, "{level:?}, {:?}", case.shape.window);
            }
        });
    }
}
