use candle_core::Tensor;

use super::{check, distance, noise, numbers, shape, tensor};
use crate::ops::conv;
use crate::ops::conv::ConvShape;
use crate::ops::grid::{Window, pixels};

#[derive(Clone, Copy)]
pub(super) struct Case {
    pub(super) frames: usize,
    pub(super) size: [usize; 3],
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    pub(super) groups: usize,
    pub(super) window: Window,
}

impl Case {
    pub(super) const fn shape(&self) -> ConvShape {
        shape(self.window, self.inputs, self.outputs, self.groups)
    }

    pub(super) fn x_dims(&self) -> Vec<usize> {
        let [t, h, w] = self.size;
        vec![self.frames, t, h, w, self.inputs]
    }

    pub(super) fn weight_dims(&self) -> Vec<usize> {
        let [t, h, w] = self.window.size;
        vec![self.outputs, self.inputs / self.groups, t, h, w]
    }

    fn inputs(&self) -> Vec<(Vec<f64>, Vec<usize>)> {
        [(self.x_dims(), 1), (self.weight_dims(), 2)]
            .into_iter()
            .map(|(dims, seed)| (noise(dims.iter().product(), seed), dims))
            .collect()
    }

    /// Convolution by its definition.
    pub(super) fn reference(&self, x: &[f64], weight: &[f64]) -> Vec<f64> {
        let to = self.window.output(self.size).unwrap();
        let (inputs, outputs) = (self.inputs / self.groups, self.outputs / self.groups);
        let taps = pixels(self.window.size);
        let mut y = vec![0.0; self.frames * pixels(to) * self.outputs];
        for [pixel, tap, from] in self.pairs() {
            for output in 0..self.outputs {
                let x = &x[from * self.inputs + output / outputs * inputs..][..inputs];
                for (input, x) in x.iter().enumerate() {
                    let weight = weight[(output * inputs + input) * taps + tap];
                    y[pixel * self.outputs + output] += x * weight;
                }
            }
        }
        y
    }

    /// The gradient of the weights by its definition; of one group.
    pub(super) fn weight_gradient(&self, x: &[f64], cotangent: &[f64]) -> Vec<f64> {
        let taps = pixels(self.window.size);
        let mut gradient = vec![0.0; self.outputs * self.inputs * taps];
        for [pixel, tap, from] in self.pairs() {
            for (i, gradient) in gradient.iter_mut().skip(tap).step_by(taps).enumerate() {
                let (output, input) = (i / self.inputs, i % self.inputs);
                *gradient +=
                    cotangent[pixel * self.outputs + output] * x[from * self.inputs + input];
            }
        }
        gradient
    }

    /// Each pixel of the output with each tap of the window and the pixel of the input under it,
    /// pixels counted over all frames.
    pub(super) fn pairs(&self) -> Vec<[usize; 3]> {
        let to = self.window.output(self.size).unwrap();
        let mut pairs = Vec::new();
        for pixel in 0..self.frames * pixels(to) {
            let (frame, place) = (pixel / pixels(to), unflatten(pixel % pixels(to), to));
            for tap in 0..pixels(self.window.size) {
                let under = unflatten(tap, self.window.size);
                if let Some(from) = self.source(place, under) {
                    pairs.push([pixel, tap, frame * pixels(self.size) + from]);
                }
            }
        }
        pairs
    }

    /// The pixel under the window, `None` in the padding.
    fn source(&self, place: [usize; 3], under: [usize; 3]) -> Option<usize> {
        let mut flat = 0;
        for axis in 0..3 {
            let at = place[axis] * self.window.stride[axis] + under[axis];
            let at = at.checked_sub(self.window.before[axis])?;
            if at >= self.size[axis] {
                return None;
            }
            flat = flat * self.size[axis] + at;
        }
        Some(flat)
    }

    fn check(&self, name: &str) {
        let operator = |t: &[Tensor]| conv(&t[0], &t[1], self.window, self.groups).unwrap();
        check(name, &self.inputs(), &operator, &|x| {
            self.reference(&x[0], &x[1])
        });
    }
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
    let case = |frames, size, inputs, outputs, groups, window| Case {
        frames,
        size,
        inputs,
        outputs,
        groups,
        window,
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
        let case = Case {
            frames: 2,
            size: image(37, 41),
            inputs: 16,
            outputs: 48,
            groups: 1,
            window,
        };
        let inputs = case.inputs();
        let (x, w) = (&inputs[0].0, &inputs[1].0);
        let weight = candle_core::Var::from_tensor(&tensor(w, &inputs[1].1)).unwrap();
        let y = conv(&tensor(x, &inputs[0].1), &weight, window, 1).unwrap();
        assert!(distance(&numbers(&y), &case.reference(x, w)) < 3e-6);
        let cotangent = noise(y.elem_count(), 3);
        let loss = (&y * tensor(&cotangent, y.dims())).unwrap();
        let gradients = loss.sum_all().unwrap().backward().unwrap();
        let found = numbers(gradients.get(&weight).unwrap());
        assert!(distance(&found, &case.weight_gradient(x, &cotangent)) < 2e-6);
    }
}

#[test]
fn inputs_that_do_not_lie_in_order() {
    let case = Case {
        frames: 2,
        size: image(4, 3),
        inputs: 5,
        outputs: 6,
        groups: 1,
        window: Window::square(3, 1, 1),
    };
    let inputs = [
        (noise(2 * 5 * 4 * 3, 1), vec![2, 5, 4, 3]),
        (noise(6 * 5 * 9, 2), vec![3, 3, 5, 6]),
    ];
    let operator = |t: &[Tensor]| {
        let x = t[0].permute((0, 2, 3, 1)).unwrap();
        let weight = t[1].permute((3, 2, 0, 1)).unwrap();
        conv(&x, &weight, case.window, 1).unwrap()
    };
    let reference = |x: &[Vec<f64>]| {
        let at = |i: usize| {
            let (c, w, h, n) = (i % 5, i / 5 % 3, i / 15 % 4, i / 60);
            x[0][((n * 5 + c) * 4 + h) * 3 + w]
        };
        let weight_at = |i: usize| {
            let (kx, ky, c, o) = (i % 3, i / 3 % 3, i / 9 % 5, i / 45);
            x[1][((ky * 3 + kx) * 5 + c) * 6 + o]
        };
        let ordered: Vec<f64> = (0..x[0].len()).map(at).collect();
        let weight: Vec<f64> = (0..x[1].len()).map(weight_at).collect();
        case.reference(&ordered, &weight)
    };
    check("permuted", &inputs, &operator, &reference);
}

#[test]
fn shapes_that_do_not_fit_are_refused() {
    let x = tensor(&noise(2 * 4 * 4 * 6, 1), &[2, 4, 4, 6]);
    let weight = tensor(&noise(8 * 3 * 9, 2), &[8, 3, 3, 3]);
    let window = Window::square(3, 1, 1);
    assert!(conv(&x, &weight, window, 2).is_ok());
    for (window, groups) in [
        (window, 1),
        (window, 3),
        (window, 0),
        (Window::square(1, 1, 0), 2),
    ] {
        let error = conv(&x, &weight, window, groups).unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("convolution: found x [2, 4, 4, 6]")
        );
    }
    let small = tensor(&noise(2 * 6, 1), &[1, 1, 2, 6]);
    assert!(conv(&small, &weight, Window::square(3, 1, 0), 2).is_err());
}
