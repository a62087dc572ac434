use super::{check, sound, with_border};
use crate::error::{Error, Result};
use crate::ops::bands::Threads;
use crate::ops::buffer::Buffer;
use crate::ops::conv::{Conv, ConvShape};
use crate::ops::conv_input::ConvTranspose;
use crate::ops::conv_weight::weight_gradient;
use crate::ops::grid::{Grid, Size, pixels};
use crate::ops::product::Epilogue;
use crate::ops::simd::Level;

/// Convolution of feature maps `(frames, time, height, width, inputs)` by weights
/// `(outputs, inputs / groups, time, height, width)`, to `(frames, time, height, width, outputs)`, f32,
/// row-major; with its gradients. The crate's README has an example.
#[derive(Debug, Clone, Copy)]
pub struct Convolution {
    shape: ConvShape,
    from: Grid,
    to: Grid,
}

impl Convolution {
    /// Of so many frames of such extents.
    ///
    /// # Errors
    /// Groups that do not share the channels evenly, a window that does not fit, an extent of 0.
    pub fn new(frames: usize, size: Size, shape: ConvShape) -> Result<Self> {
        let find = || {
            let from = Grid::tight(frames, size, shape.inputs);
            let divides =
                |channels: usize| shape.groups > 0 && channels.is_multiple_of(shape.groups);
            let fits = shape.outputs > 0 && divides(shape.inputs) && divides(shape.outputs);
            let window = shape.window.checked().filter(|_| fits && sound(&from))?;
            let to = Grid::tight(frames, window.output(size)?, shape.outputs);
            sound(&to).then_some(Self { shape, from, to })
        };
        find().ok_or_else(|| {
            let found = format_args!("{frames} frames of {size:?}, {shape:?}");
            let expected = "channels that the groups share evenly, and a window of a stride above 0 and less padding \
                            than its size, within the map";
            Error::input("convolution", found, expected)
        })
    }

    /// Time, height and width of what comes out.
    pub fn output(&self) -> Size {
        self.to.size
    }

    fn weights(&self) -> usize {
        self.shape.outputs * self.shape.group_inputs() * pixels(self.shape.window.size)
    }

    fn check(&self, x: &[f32], weight: &[f32]) -> Result<()> {
        check("x of a convolution", x, self.from.len())?;
        check("weights of a convolution", weight, self.weights())
    }

    /// The feature maps that come out.
    ///
    /// # Errors
    /// Slices that do not fit the shape.
    pub fn forward(&self, x: &[f32], weight: &[f32]) -> Result<Vec<f32>> {
        self.check(x, weight)?;
        let conv = Conv::pack(Level::detect(), self.shape, weight);
        let (padded, mut memory) = (self.from.padded(&self.shape.window), Buffer::default());
        let mut y = vec![0.0; self.to.len()];
        let source = (with_border(x, &padded, &mut memory), &padded);
        let target = (&mut y[..], &self.to);
        conv.apply(Threads::All, source, target, Epilogue::default());
        Ok(y)
    }

    /// The gradients of `x` and of the weights, from that of what came out.
    ///
    /// # Errors
    /// Slices that do not fit the shape.
    pub fn backward(&self, x: &[f32], weight: &[f32], gradient: &[f32]) -> Result<[Vec<f32>; 2]> {
        self.check(x, weight)?;
        check("gradient of a convolution", gradient, self.to.len())?;
        let (level, from, to) = (Level::detect(), &self.from, &self.to);
        let (padded, mut memory) = (from.padded(&self.shape.window), Buffer::default());
        let source = (with_border(x, &padded, &mut memory), &padded);
        let mut of_weight = vec![0.0; weight.len()];
        weight_gradient(level, &self.shape, source, (gradient, to), &mut of_weight);
        let transpose = ConvTranspose::pack(level, self.shape, weight);
        let layout = transpose.layout(from.frames, from.size, to.size);
        let mut of_x = vec![0.0; from.len()];
        let gradient = (with_border(gradient, &layout, &mut memory), &layout);
        transpose.apply(gradient, (&mut of_x, from), false);
        Ok([of_x, of_weight])
    }
}
