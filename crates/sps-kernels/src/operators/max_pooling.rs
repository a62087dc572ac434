use super::{check, sound, with_border, without_border};
use crate::error::{Error, Result};
use crate::ops::bands::Threads;
use crate::ops::buffer::Buffer;
use crate::ops::grid::{Grid, Size, Window};
use crate::ops::pool::{max_pool, max_pool_backward};
use crate::ops::simd::Level;

/// Max pooling of feature maps `(frames, time, height, width, channels)`, f32, row-major, with its gradient.
///
/// The window's padding holds zeros, which take part. With `ceil`, a last window may hang over
/// the upper end of an axis, as with PyTorch's `ceil_mode`, and sees only what there is; an
/// extent smaller than the window is pooled to 1 then.
///
/// The gradient of a window goes to the first of its largest values.
#[derive(Debug, Clone, Copy)]
pub struct MaxPooling {
    window: Window,
    /// With the window's padding.
    from: Grid,
    to: Grid,
}

impl MaxPooling {
    /// Of so many frames of such extents and channels.
    ///
    /// # Errors
    /// A window that does not fit, an extent of 0.
    pub fn new(
        frames: usize,
        size: Size,
        channels: usize,
        window: Window,
        ceil: bool,
    ) -> Result<Self> {
        let find = || {
            let from = Grid::tight(frames, size, channels);
            let window = window.checked().filter(|_| sound(&from))?;
            let output = if ceil {
                window.output_ceil(size)
            } else {
                window.output(size)?
            };
            Some(Self {
                window,
                from: from.padded(&window),
                to: Grid::tight(frames, output, channels),
            })
        };
        find().ok_or_else(|| {
            let found = format_args!("{frames} frames of {size:?}, {channels} channels, under {window:?}");
            let expected = "maps no smaller than the window, which has a stride above 0 and less padding than its size";
            Error::input("max pooling", found, expected)
        })
    }

    /// Time, height and width of what comes out.
    pub fn output(&self) -> Size {
        self.to.size
    }

    /// The feature maps that come out.
    ///
    /// # Errors
    /// A slice that does not fit.
    pub fn forward(&self, x: &[f32]) -> Result<Vec<f32>> {
        check("x of max pooling", x, self.from.bare().len())?;
        let mut y = vec![0.0; self.to.len()];
        let mut memory = Buffer::default();
        let source = (with_border(x, &self.from, &mut memory), &self.from);
        let target = (&mut y[..], &self.to);
        max_pool(Threads::All, Level::detect(), &self.window, source, target);
        Ok(y)
    }

    /// The gradient of `x`, from what came out, `y`, and its gradient.
    ///
    /// # Errors
    /// Slices that do not fit.
    pub fn backward(&self, x: &[f32], y: &[f32], gradient: &[f32]) -> Result<Vec<f32>> {
        check("x of max pooling", x, self.from.bare().len())?;
        check("y of max pooling", y, self.to.len())?;
        check("gradient of max pooling", gradient, self.to.len())?;
        let mut of_x = vec![0.0; self.from.len()];
        let mut memory = Buffer::default();
        let source = (with_border(x, &self.from, &mut memory), &self.from);
        let (level, y) = (Level::detect(), (y, &self.to));
        max_pool_backward(level, &self.window, source, y, gradient, &mut of_x);
        Ok(without_border(&of_x, &self.from))
    }
}
