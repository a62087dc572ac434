use super::*;
use crate::{Convolution, MaxPooling};

#[derive(Clone, Copy)]
pub(super) struct Case {
    pub(super) frames: usize,
    pub(super) size: [usize; 3],
    pub(super) shape: ConvShape,
}

impl Case {
    pub(super) const fn new(
        frames: usize,
        size: [usize; 3],
        [inputs, outputs, groups]: [usize; 3],
        window: Window,
    ) -> Self {
        Self {
            frames,
            size,
            shape: shape(window, inputs, outputs, groups),
        }
    }

    /// A convolution of one image.
    pub(super) const fn of_image(shape: ConvShape, [height, width]: [usize; 2]) -> Self {
        Self {
            frames: 1,
            size: image(height, width),
            shape,
        }
    }

    /// The layout of the input, without padding.
    pub(super) fn from<W: Word>(&self) -> Grid {
        Grid::tight(self.frames, self.size, self.shape.inputs).of::<W>()
    }

    /// The same with the padding of its window.
    pub(super) fn padded<W: Word>(&self) -> Grid {
        self.from::<W>().padded(&self.shape.window)
    }

    /// The layout of the output.
    pub(super) fn to<W: Word>(&self) -> Grid {
        let size = self.shape.window.output(self.size).unwrap();
        Grid::tight(self.frames, size, self.shape.outputs).of::<W>()
    }

    /// How many numbers the input has.
    pub(super) fn numbers(&self) -> usize {
        self.from::<f32>().len()
    }

    /// How many weights there are.
    pub(super) fn weights(&self) -> usize {
        self.shape.outputs * self.shape.group_inputs() * pixels(self.shape.window.size)
    }

    fn inputs(&self) -> Vec<Vec<f64>> {
        vec![noise(self.numbers(), 1), noise(self.weights(), 2)]
    }

    fn convolution(&self) -> Convolution {
        Convolution::new(self.frames, self.size, self.shape).unwrap()
    }

    /// Convolution by its definition.
    pub(super) fn reference(&self, x: &[f64], weight: &[f64]) -> Vec<f64> {
        self.padded_by(0.0, x, weight)
    }

    /// The same of a map around which lies `padding`.
    pub(super) fn padded_by(&self, padding: f64, x: &[f64], weight: &[f64]) -> Vec<f64> {
        let (inputs, outputs) = (self.shape.group_inputs(), self.shape.group_outputs());
        let taps = pixels(self.shape.window.size);
        let mut y = vec![0.0; self.to::<f32>().len()];
        for (pixel, tap, from) in self.taps() {
            for output in 0..self.shape.outputs {
                let first = output / outputs * inputs;
                for input in 0..inputs {
                    let x =
                        from.map_or(padding, |from| x[from * self.shape.inputs + first + input]);
                    let weight = weight[(output * inputs + input) * taps + tap];
                    y[pixel * self.shape.outputs + output] += x * weight;
                }
            }
        }
        y
    }

    /// The gradient of the weights by its definition; of one group.
    pub(super) fn weight_gradient(&self, x: &[f64], cotangent: &[f64]) -> Vec<f64> {
        let taps = pixels(self.shape.window.size);
        let mut gradient = vec![0.0; self.shape.outputs * self.shape.inputs * taps];
        for [pixel, tap, from] in self.pairs() {
            for (i, gradient) in gradient.iter_mut().skip(tap).step_by(taps).enumerate() {
                let (output, input) = (i / self.shape.inputs, i % self.shape.inputs);
                *gradient += cotangent[pixel * self.shape.outputs + output]
                    * x[from * self.shape.inputs + input];
            }
        }
        gradient
    }

    /// Those of [`Case::taps`] that are under no padding.
    pub(super) fn pairs(&self) -> impl Iterator<Item = [usize; 3]> {
        let taps = self.taps().into_iter();
        taps.filter_map(|(pixel, tap, from)| Some([pixel, tap, from?]))
    }

    /// As [`taps`].
    fn taps(&self) -> Vec<(usize, usize, Option<usize>)> {
        let to = self.to::<f32>().size;
        taps(self.frames, self.size, &self.shape.window, to)
    }

    fn check(&self, name: &str) {
        let convolution = self.convolution();
        let operator = |inputs: &[Vec<f32>], gradient: &[f32]| {
            let [x, weight] = inputs else { unreachable!() };
            let gradients = convolution.backward(x, weight, gradient).unwrap();
            (convolution.forward(x, weight).unwrap(), gradients.to_vec())
        };
        check(name, &self.inputs(), &operator, &|x| {
            self.reference(&x[0], &x[1])
        });
    }
}

/// Convolutions of one image which together reach every kernel: those of them whose channels fill the words.
pub(super) fn cases<W: Word>() -> Vec<Case> {
    let point = Window::square(1, 1, 0);
    let [square, jumping] = [1, 2].map(|stride| Window::square(3, stride, 1));
    let case = |window, channels, [height, width]: [usize; 2]| {
        Case::new(1, image(height, width), channels, window)
    };
    let mut cases = vec![
        case(point, [64, 48, 1], [5, 7]),
        case(point, [300, 32, 1], [1, 1]),
        case(Window::square(1, 2, 0), [32, 64, 1], [7, 5]),
        case(Window::square(1, 2, 0), [24, 64, 1], [7, 5]),
        case(Window::square(7, 2, 3), [4, 64, 1], [15, 13]),
        case(square, [16, 80, 1], [6, 5]),
        case(square, [40, 80, 1], [6, 17]),
        case(jumping, [40, 24, 1], [23, 20]),
        // By fewer products in inference.
        case(square, [32, 48, 1], [11, 10]),
        case(square, [64, 32, 1], [11, 10]),
        // Columns that fill no vector, channels that fill no word.
        case(point, [8, 12, 1], [3, 3]),
        case(point, [6, 10, 1], [3, 3]),
        case(point, [7, 10, 1], [3, 3]),
        case(point, [300, 34, 1], [1, 1]),
        case(square, [40; 3], [7, 6]),
        case(Window::square(5, 2, 2), [96; 3], [9, 11]),
    ];
    for window in [square, jumping] {
        cases.extend([32, 16, 8, 4].map(|groups| case(window, [128, 128, groups], [9, 6])));
        cases.extend([
            case(window, [64, 64, 8], [6, 9]),
            case(window, [64, 64, 4], [5, 5]),
            case(window, [64, 64, 2], [4, 3]),
            case(window, [64, 64, 2], [5, 5]),
            case(window, [64; 3], [5, 5]),
        ]);
        let wide = Window::same([1, 5, 5], window.stride, [1, 7, 10]);
        for channels in [4, 24, 64, 144] {
            cases.push(case(window, [channels; 3], [6, 9]));
            cases.push(case(wide, [channels; 3], [7, 10]));
        }
    }
    cases.retain(|Case { shape, .. }| {
        let channels = [shape.group_inputs(), shape.group_outputs()];
        shape.depthwise() || channels.iter().all(|n| n.is_multiple_of(W::NUMBERS))
    });
    cases
}

/// Each pixel of an output with each tap of the window and the pixel of the input under it, `None` in the padding;
/// pixels are counted over all frames. Taps beyond the padding are left out.
pub(super) fn taps(
    frames: usize,
    size: [usize; 3],
    window: &Window,
    to: [usize; 3],
) -> Vec<(usize, usize, Option<usize>)> {
    let mut taps = Vec::new();
    for pixel in 0..frames * pixels(to) {
        let (frame, place) = (pixel / pixels(to), unflatten(pixel % pixels(to), to));
        for tap in 0..pixels(window.size) {
            let under = unflatten(tap, window.size);
            let at = [0, 1, 2].map(|axis| place[axis] * window.stride[axis] + under[axis]);
            let padded = |axis: usize| window.before[axis] + size[axis] + window.after[axis];
            if (0..3).all(|axis| at[axis] < padded(axis)) {
                let from = (0..3).try_fold(frame, |flat, axis| {
                    let at = at[axis].checked_sub(window.before[axis])?;
                    (at < size[axis]).then_some(flat * size[axis] + at)
                });
                taps.push((pixel, tap, from));
            }
        }
    }
    taps
}

fn unflatten(index: usize, size: [usize; 3]) -> [usize; 3] {
    [
        index / (size[1] * size[2]),
        index / size[2] % size[1],
        index % size[2],
    ]
}

const fn image(height: usize, width: usize) -> [usize; 3] {
    [1, height, width]
}

#[test]
fn convolutions_of_many_shapes() {
    let square = Window::square;
    let case = |frames, size, inputs, outputs, groups, window| {
        Case::new(frames, size, [inputs, outputs, groups], window)
    };
    case(2, image(5, 3), 7, 33, 1, square(1, 1, 0)).check("1x1, odd sizes");
    case(1, image(5, 6), 6, 5, 1, square(1, 2, 0)).check("1x1, stride 2");
    case(1, image(1, 1), 3, 4, 1, square(1, 1, 0)).check("one pixel");
    case(1, image(1, 1), 2, 3, 1, square(3, 1, 1)).check("one pixel in padding");
    case(1, image(4, 5), 1, 1, 1, square(3, 1, 1)).check("one channel");
    case(2, image(6, 5), 3, 5, 1, square(3, 1, 1)).check("3x3");
    case(1, image(9, 11), 3, 6, 1, square(7, 2, 3)).check("7x7 stem");
    case(1, image(8, 7), 3, 6, 1, square(7, 2, 0)).check("7x7 without padding");
    case(2, image(5, 7), 16, 16, 4, square(3, 1, 1)).check("groups of 4");
    case(1, image(5, 6), 16, 16, 4, square(3, 2, 1)).check("groups of 4, stride 2");
    case(1, image(4, 5), 16, 16, 2, square(3, 1, 1)).check("groups of 8");
    case(1, image(5, 4), 32, 32, 4, square(3, 2, 1)).check("groups of 8, stride 2");
    case(1, image(3, 4), 32, 32, 2, square(3, 1, 1)).check("groups of 16");
    case(2, image(3, 3), 6, 9, 3, square(3, 2, 1)).check("groups of 2 to 3");
    case(1, image(1, 9), 5, 5, 5, square(3, 1, 1)).check("each channel its own group");
    case(1, image(6, 5), 40, 40, 40, square(3, 1, 1)).check("depth-wise");
    case(2, image(5, 4), 24, 24, 24, square(5, 2, 2)).check("depth-wise, stride 2");
    case(2, image(3, 17), 40, 40, 40, square(3, 1, 1)).check("depth-wise, wide");
    case(1, image(3, 16), 40, 40, 40, square(5, 1, 2)).check("depth-wise, wider window");
    case(1, image(4, 31), 40, 40, 40, square(5, 2, 2)).check("depth-wise, wide, stride 2");
    case(1, image(2, 3), 4, 3, 1, square(3, 5, 2)).check("stride beyond the window");
    let cube = Window::same([3, 3, 3], [1, 2, 1], [4, 5, 3]);
    case(2, [4, 5, 3], 4, 6, 2, cube).check("three dimensions");
    let stem = Window::same([5, 3, 3], [2, 2, 2], [6, 5, 4]);
    case(1, [6, 5, 4], 3, 5, 1, stem).check("three dimensions, 'same' padding");
}

#[test]
fn more_rows_than_a_block_sums_to_the_last_digits() {
    // Long enough for several blocks of every kernel; gradients by the definition in f64.
    for window in [Window::square(1, 1, 0), Window::square(3, 1, 1)] {
        let case = Case::new(2, image(37, 41), [16, 48, 1], window);
        let inputs = case.inputs();
        let (x, w) = (narrow(&inputs[0]), narrow(&inputs[1]));
        let y = case.convolution().forward(&x, &w).unwrap();
        let expected = case.reference(&inputs[0], &inputs[1]);
        assert!(distance(&wide(&y), &expected) < 3e-6);
        let cotangent = noise(y.len(), 3);
        let gradients = case.convolution().backward(&x, &w, &narrow(&cotangent));
        let [_, found] = gradients.unwrap();
        let expected = case.weight_gradient(&inputs[0], &cotangent);
        assert!(distance(&wide(&found), &expected) < 2e-6);
    }
}

#[test]
fn shapes_that_do_not_fit_are_refused() {
    let window = Window::square(3, 1, 1);
    let new = |window, size, [inputs, outputs, groups]: [usize; 3]| {
        Convolution::new(2, size, shape(window, inputs, outputs, groups))
    };
    let convolution = new(window, image(4, 4), [6, 8, 2]).unwrap();
    let (x, weight) = ([0.0; 2 * 4 * 4 * 6], [0.0; 8 * 3 * 9]);
    let y = convolution.forward(&x, &weight).unwrap();
    for channels in [[6, 8, 3], [6, 8, 0], [6, 0, 2], [0, 8, 2], [5, 8, 2]] {
        let error = new(window, image(4, 4), channels).unwrap_err();
        let found = "convolution: found 2 frames of [1, 4, 4]";
        assert!(error.to_string().starts_with(found), "{error}");
    }
    assert!(new(Window::square(3, 1, 0), image(1, 2), [6, 8, 2]).is_err());
    assert!(new(window, [1, usize::MAX, 1 << 40], [6, 8, 2]).is_err());
    assert!(convolution.forward(&x[1..], &weight).is_err());
    assert!(convolution.forward(&x, &weight[1..]).is_err());
    assert!(convolution.backward(&x, &weight, &y[1..]).is_err());
}

#[test]
fn windows_without_extent_are_refused() {
    let conv = |window| Convolution::new(1, image(4, 4), shape(window, 2, 2, 1));
    let sound = Window::square(3, 1, 1);
    let with = |change: fn(&mut Window)| {
        let mut window = sound;
        change(&mut window);
        window
    };
    for window in [
        Window::square(3, 0, 1),
        with(|w| w.stride = [0, 1, 1]),
        with(|w| w.stride[1] = usize::MAX),
        with(|w| w.size[2] = 0),
        with(|w| w.size = [usize::MAX; 3]),
        with(|w| w.before[1] = usize::MAX),
        with(|w| w.after[2] = usize::MAX),
        with(|w| w.before[2] = 3),
        Window::same([1, 3, 3], [0; 3], [1, 4, 4]),
        Window::same([usize::MAX; 3], [1; 3], [4; 3]),
    ] {
        let error = conv(window).unwrap_err().to_string();
        let found = "convolution: found 1 frames of [1, 4, 4]";
        assert!(error.starts_with(found), "{error}");
        for ceil in [false, true] {
            let error = MaxPooling::new(1, image(4, 4), 2, window, ceil).unwrap_err();
            let found = "max pooling: found 1 frames of [1, 4, 4]";
            assert!(error.to_string().starts_with(found), "{error}");
        }
    }
    assert!(conv(sound).is_ok());
}

/// Two frames of 2.5 billion words each: the second begins where 32 bits no longer reach.
#[test]
fn feature_maps_beyond_32_bits() {
    let grid = Grid::tight(2, [1, 50_000, 50_000], 1);
    let starts = grid.steps(0..2, [0; 3], [1, 1, 3], [1, 1, 7]);
    let second = [2_500_000_000, 2_500_000_007, 2_500_000_014];
    assert_eq!(starts, [[0, 7, 14], second].concat());
    let far = Grid::tight(3, [1, 50_000, 50_000], 1).steps(0..3, [0; 3], [1; 3], [1; 3]);
    assert_eq!(far, [0, 2_500_000_000, 5_000_000_000]);
}
