//! Convolution, pooling and mean of feature maps of bytes, against whole numbers in f64, to the bit on every
//! level.

use proptest::prelude::*;

use super::conv::cases;
use super::*;
use crate::ops::simd::{Kernel, Lanes};

/// A convolution of bytes is that of whole numbers, scaled in one rounding and rounded to even.
fn check(case: &Case, seed: u64) {
    let shape = case.shape;
    let values = whole(case.numbers(), seed, [0.0, 255.0]);
    let mut weights = whole(case.weights(), seed + 1, [-127.0, 127.0]);
    // A channel of nothing but zeros.
    weights[..case.weights() / shape.outputs].fill(0.0);
    let padding = 77.0;
    let sums = case.padded_by(padding, &values, &weights);
    let largest = sums.iter().fold(1.0, |m: f64, sum| m.max(sum.abs())) as f32;
    let each_of = |seed: u64| noise(shape.outputs, seed).into_iter().map(|x| x as f32);
    let factors: Vec<f32> = each_of(seed + 2).map(|x| 180.0 * x / largest).collect();
    let shifts: Vec<f32> = each_of(seed + 3).map(|x| 99.0 + 90.0 * x).collect();
    let weights = narrow(&weights);

    Level::on_each(|level| {
        let conv = Conv::<Bytes>::pack(level, shape, &weights);
        // A border wider than the window's, as another reader may need it.
        let wider = Window::square(9, 1, 4);
        let from = case.from::<Bytes>().enclosing(&shape.window);
        let (from, to) = (from.enclosing(&wider), case.to::<Bytes>());
        let before = whole(sums.len(), seed + 4, [0.0, 255.0]);
        for (accumulate, limits) in [(None, [0.0, 255.0]), (Some(0.37), [13.0, 201.5])] {
            let epilogue = Epilogue {
                scale: Some(Columns::shared(&factors)),
                shift: Some(Columns::shared(&shifts)),
                accumulate,
                limits,
            };
            let source = (&values[..], &from, padding);
            let found = convolved((&conv, Threads::One), source, (&before, &to), epilogue);
            for (i, found) in found.into_iter().enumerate() {
                let channel = i % shape.outputs;
                let y = (sums[i] as f32).mul_add(factors[channel], shifts[channel]);
                let y = accumulate.map_or(y, |factor| (before[i] as f32).mul_add(factor, y));
                let expected = y.clamp(limits[0], limits[1]).round_ties_even();
                let what = format!("{level:?} {shape:?} {:?} number {i}: {y}", case.size);
                assert_eq!(found, f64::from(expected), "{what}");
            }
        }
    });
}

#[test]
fn convolutions() {
    for (case, seed) in cases::<Bytes>().iter().zip(1..) {
        check(case, seed);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn convolutions_of_any_extent(
        size in [1_usize..12, 1_usize..12],
        (kernel, stride) in (1_usize..6, 1_usize..4),
        quads in [1_usize..20, 1_usize..20],
        depthwise: bool,
        seed in 0_u64..1000,
    ) {
        let window = Window::same([1, kernel, kernel], [1, stride, stride], [1, size[0], size[1]]);
        let [inputs, outputs] = quads.map(|quads| 4 * quads);
        let shape = if depthwise {
            shape(window, inputs, inputs, inputs)
        } else {
            shape(window, inputs, outputs, 1)
        };
        check(&Case::of_image(shape, size), seed);
    }
}

/// The longest sum of a network, all of its products as large as they can be.
#[test]
fn the_largest_sum_does_not_overflow() {
    let window = Window::square(3, 1, 0);
    let shape = shape(window, 512, 4, 1);
    let taps = 512 * 9;
    assert!(taps <= Bytes::LONGEST_SUM);
    let grid = Grid::tight(1, [1, 3, 3], 512).of::<Bytes>();
    let to = Grid::tight(1, [1; 3], 4).of::<Bytes>();
    let source = vec![Bytes::of(|_| 255.0); grid.len()];
    Level::on_each(|level| {
        for sign in [1.0, -1.0] {
            let conv = Conv::pack(level, shape, &vec![127.0 * sign; 4 * taps]);
            let mut target = [Bytes::default()];
            let scale = [sign / (127 * 255) as f32; 4];
            let shift = [200.0 - taps as f32; 4];
            let epilogue = Epilogue {
                scale: Some(Columns::shared(&scale)),
                shift: Some(Columns::shared(&shift)),
                limits: [0.0, 255.0],
                ..Epilogue::default()
            };
            conv.apply(Threads::One, (&source, &grid), (&mut target, &to), epilogue);
            assert_eq!(inside(&target, &to), [200.0; 4], "{level:?}");
        }
    });
    // In 16 bits, as `maddubs` adds two products, it does.
    assert!(2 * 255 * 127 > i32::from(i16::MAX));
}

/// Without instructions for it, the sum is the same.
#[test]
fn a_sum_without_instructions_for_bytes() {
    struct Dot<'a>(&'a [f64], &'a [f64]);
    impl Kernel for Dot<'_> {
        type Output = Vec<i32>;

        #[inline(always)]
        fn run<S: Lanes>(self, lanes: S) -> Vec<i32> {
            let x: Vec<u8> = self.0.iter().map(|&x| x as u8).collect();
            let y: Vec<u8> = self.1.iter().map(|&y| y as i8 as u8).collect();
            let chunks = |bytes: &[u8]| -> Vec<f32> {
                let words = bytes.as_chunks::<4>().0.iter();
                words.map(|word| f32::from_le_bytes(*word)).collect()
            };
            let (x, y) = (chunks(&x), chunks(&y));
            let vectors = S::as_simd_f32s(&x).0.iter().zip(S::as_simd_f32s(&y).0);
            let sums = vectors.map(|(x, y)| lanes.dot(*x, *y, lanes.splat_f32s(0.0)));
            sums.flat_map(|sum| bytemuck::cast_slice::<_, i32>(&[sum]).to_vec())
                .collect()
        }
    }
    let (mut x, mut y) = (whole(256, 1, [0.0, 255.0]), whole(256, 2, [-128.0, 127.0]));
    x[..8].fill(255.0);
    y[..4].fill(127.0);
    y[4..8].fill(-128.0);
    let products: Vec<f64> = x.iter().zip(&y).map(|(x, y)| x * y).collect();
    let expected: Vec<f64> = products.chunks(4).map(|four| four.iter().sum()).collect();
    Level::on_each(|level: Level| {
        let found = level.run(Dot(&x, &y)).into_iter().map(f64::from);
        assert_eq!(found.collect::<Vec<_>>(), expected, "{level:?}");
    });
}

/// Neither rounds.
#[test]
fn pooling_and_means() {
    let values = whole(7 * 6 * 32, 5, [0.0, 255.0]);
    check_pooling_and_means::<Bytes>(&values, |found, mean| found == mean as f32);
}

/// What leaves the range of a byte ends at its ends, and what is no number at the lower one.
#[test]
fn numbers_become_bytes() {
    let rounded = |x: f32| Bytes::numbers(&[Bytes::of(|_| x)]).next().unwrap();
    let (most, nan) = (f32::INFINITY, f32::NAN);
    let given = [-1e9, -0.5, 0.5, 1.5, 254.5, 255.4, 1e9, most, -most, nan];
    let expected = [0.0, 0.0, 0.0, 2.0, 254.0, 255.0, 255.0, 255.0, 0.0, 0.0];
    assert_eq!(given.map(rounded), expected);
}
