//! Where the pixels of a feature map lie in memory, channels last, with room for padding.

use std::ops::Range;

use sps_base::parallel;

use super::buffer::LINE;
use super::words::Word;

/// Time, height, width. A still image has one time step.
pub type Size = [usize; 3];

/// Pixels of one image.
pub(crate) fn pixels(size: Size) -> usize {
    size.iter().product()
}

/// Where each of `count` rows of `len` numbers begins.
pub(crate) fn starts(count: usize, len: usize) -> Vec<usize> {
    (0..count).map(|row| row * len).collect()
}

/// The largest extent and stride of a window.
const LARGEST: usize = 1024;

/// A window that slides over a feature map, for a convolution or for pooling.
///
/// Each axis is time, height or width; a still image has one time step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Pixels under the window, 1 to 1024 along each axis.
    pub size: [usize; 3],
    /// Pixels from one place of the window to the next, 1 to 1024.
    pub stride: [usize; 3],
    /// Padding at the lower end of each axis, less than the window's size.
    pub before: [usize; 3],
    /// Padding at the upper end of each axis, less than the window's size.
    pub after: [usize; 3],
}

impl Window {
    /// A square window over images, padded alike on all sides.
    pub const fn square(size: usize, stride: usize, padding: usize) -> Self {
        Self {
            size: [1, size, size],
            stride: [1, stride, stride],
            before: [0, padding, padding],
            after: [0, padding, padding],
        }
    }

    /// A window over time, height and width of one size, padded so that the output has the
    /// input's extents over the stride, rounded up: the rule called 'same', with the odd pixel
    /// of padding at the upper end.
    pub fn same(size: [usize; 3], stride: [usize; 3], input: [usize; 3]) -> Self {
        let (mut before, mut after) = ([0; 3], [0; 3]);
        for axis in 0..3 {
            // Of a stride of 0, which operators refuse, as of 1.
            let stride = stride[axis].max(1);
            let last = (input[axis].div_ceil(stride).max(1) - 1) * stride;
            let padding = last.saturating_add(size[axis]).saturating_sub(input[axis]);
            before[axis] = padding / 2;
            after[axis] = padding - padding / 2;
        }
        Self {
            size,
            stride,
            before,
            after,
        }
    }

    /// Itself, where its extents are as its fields say.
    pub(crate) fn checked(self) -> Option<Self> {
        let sound = |axis: usize| {
            let (size, extents) = (self.size[axis], 1..=LARGEST);
            extents.contains(&size)
                && extents.contains(&self.stride[axis])
                && self.before[axis].max(self.after[axis]) < size
        };
        (0..3).all(sound).then_some(self)
    }

    /// How often the window fits if its last place may hang over the upper end; at least once.
    pub(crate) fn output_ceil(&self, input: Size) -> Size {
        std::array::from_fn(|axis| {
            // Saturating, as an extent without elements may be any.
            let begins = input[axis].saturating_add(self.before[axis]);
            let room = begins.saturating_add(self.after[axis]);
            let last = room
                .saturating_sub(self.size[axis])
                .div_ceil(self.stride[axis]);
            // The last place must begin before the padding does.
            last.min(begins.saturating_sub(1) / self.stride[axis]) + 1
        })
    }

    /// How often the window fits; `None` where it does not, or no number holds the padded extent.
    pub(crate) fn output(&self, input: Size) -> Option<Size> {
        let mut output = [0; 3];
        for axis in 0..3 {
            let padding = self.before[axis] + self.after[axis];
            let room = input[axis].checked_add(padding)?;
            output[axis] = room.checked_sub(self.size[axis])? / self.stride[axis] + 1;
        }
        Some(output)
    }
}

/// The numbers of a pixel whose memory begins here.
#[inline(always)]
pub(super) fn pixel<W: Word>(memory: &[W], channels: usize) -> &[W::Number] {
    &W::each(&memory[..W::words(channels)])[..channels]
}

/// The same, to be written.
#[inline(always)]
pub(super) fn pixel_mut<W: Word>(memory: &mut [W], channels: usize) -> &mut [W::Number] {
    &mut W::each_mut(&mut memory[..W::words(channels)])[..channels]
}

/// The pixels of a feature map without a border, `pitch` words from one to the next.
#[inline(always)]
pub(super) fn rows<W: Word>(
    memory: &[W],
    pitch: usize,
    channels: usize,
) -> impl Iterator<Item = &[W::Number]> {
    // Never shorter than its channels, which the compiler then need not check for each pixel.
    let pixels = memory.chunks_exact(pitch.max(W::words(channels)));
    pixels.map(move |memory| pixel(memory, channels))
}

/// The same, to be written.
#[inline(always)]
pub(super) fn rows_mut<W: Word>(
    memory: &mut [W],
    pitch: usize,
    channels: usize,
) -> impl Iterator<Item = &mut [W::Number]> {
    let pixels = memory.chunks_exact_mut(pitch.max(W::words(channels)));
    pixels.map(move |memory| pixel_mut(memory, channels))
}

/// Words after which addresses fall on few sets of a first-level cache.
const SAME_SETS: usize = 512;

/// A feature map: frames, each of `size` pixels with a border, each of `channels` numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Grid {
    pub(crate) frames: usize,
    pub(crate) size: Size,
    pub(crate) channels: usize,
    /// Words of memory that a pixel's channels take.
    pub(crate) words: usize,
    /// Words from one pixel to the next.
    pub(crate) pitch: usize,
    /// The border, which stands for zero where it serves as padding.
    pub(crate) before: Size,
    pub(crate) after: Size,
}

impl Grid {
    /// Without a border: the layout of a contiguous `(frames, time, height, width, channels)`.
    pub(crate) const fn tight(frames: usize, size: Size, channels: usize) -> Self {
        Self {
            frames,
            size,
            channels,
            words: channels,
            pitch: channels,
            before: [0; 3],
            after: [0; 3],
        }
    }

    /// In memory of such words.
    pub(crate) fn of<W: Word>(mut self) -> Self {
        self.words = W::words(self.channels);
        self.pitch = self.words;
        self
    }

    /// With pixels a cache line further from each other where they would lie at multiples of [`SAME_SETS`]: those that
    /// a tile reads side by side would take each other's place in the first-level cache.
    pub(crate) const fn staggered(mut self) -> Self {
        if self.pitch > 0 && self.pitch.is_multiple_of(SAME_SETS) {
            self.pitch += LINE;
        }
        self
    }

    /// With the border that a window pads.
    pub(crate) const fn padded(mut self, window: &Window) -> Self {
        self.before = window.before;
        self.after = window.after;
        self
    }

    pub(crate) const fn bare(mut self) -> Self {
        self.before = [0; 3];
        self.after = [0; 3];
        self
    }

    /// With a border no smaller than a window pads.
    pub(crate) fn enclosing(mut self, window: &Window) -> Self {
        for axis in 0..3 {
            self.before[axis] = self.before[axis].max(window.before[axis]);
            self.after[axis] = self.after[axis].max(window.after[axis]);
        }
        self
    }

    /// Extent of an axis with its border.
    pub(crate) fn extent(&self, axis: usize) -> usize {
        self.before[axis] + self.size[axis] + self.after[axis]
    }

    /// Words of one frame.
    pub(crate) fn frame_len(&self) -> usize {
        (0..3).map(|axis| self.extent(axis)).product::<usize>() * self.pitch
    }

    pub(crate) fn len(&self) -> usize {
        self.frames * self.frame_len()
    }

    /// The index of a place's first channel, counted with the border.
    pub(crate) fn index(&self, frame: usize, place: Size) -> usize {
        let [t, y, x] = place;
        let row = (t * self.extent(1) + y) * self.extent(2) + x;
        frame * self.frame_len() + row * self.pitch
    }

    /// The index of a row's first pixel, rows counted over all frames.
    pub(crate) fn row_start(&self, row: usize) -> usize {
        let ([time, height, _], before) = (self.size, self.before);
        let (frame, row) = (row / (time * height), row % (time * height));
        let place = [
            before[0] + row / height,
            before[1] + row % height,
            before[2],
        ];
        self.index(frame, place)
    }

    pub(crate) fn rows(&self) -> Range<usize> {
        0..self.frames * self.size[0] * self.size[1]
    }

    /// The index of each pixel's first channel, frame by frame, row by row.
    pub(crate) fn places(&self) -> Vec<usize> {
        self.places_of(self.rows())
    }

    /// The same of some rows, counted over all frames.
    pub(crate) fn places_of(&self, rows: Range<usize>) -> Vec<usize> {
        self.steps(rows, self.before, self.size, [1; 3])
    }

    /// The index of `count` places from `from` in steps of `stride`, in every frame: of some rows of them.
    pub(crate) fn steps(
        &self,
        rows: Range<usize>,
        from: Size,
        [time, height, width]: Size,
        stride: Size,
    ) -> Vec<usize> {
        let mut steps = Vec::with_capacity(rows.len() * width);
        let step = stride[2] * self.pitch;
        let mut row = rows.start;
        while row < rows.end {
            // The rows of one time step at once.
            let (frame, t, y) = (row / height / time, row / height % time, row % height);
            let count = (height - y).min(rows.end - row);
            for y in y..y + count {
                let first = [from[0] + t * stride[0], from[1] + y * stride[1], from[2]];
                let mut at = self.index(frame, first);
                // Added up, which takes less time than a product for each.
                steps.extend((0..width).map(|_| {
                    at += step;
                    at - step
                }));
            }
            row += count;
        }
        steps
    }

    /// Fills the border with a word.
    pub(crate) fn fill_border<W: Word>(&self, memory: &mut [W], word: W) {
        let [time, height, width] = [0, 1, 2].map(|axis| self.extent(axis));
        let inside = |axis: usize, at: usize| {
            (self.before[axis]..self.before[axis] + self.size[axis]).contains(&at)
        };
        let row_len = width * self.pitch;
        if row_len == 0 || (self.before, self.after) == ([0; 3], [0; 3]) {
            return;
        }
        for (row, memory) in memory.chunks_exact_mut(row_len).enumerate() {
            if inside(0, row / height % time) && inside(1, row % height) {
                let (left, rest) = memory.split_at_mut(self.before[2] * self.pitch);
                left.fill(word);
                rest[self.size[2] * self.pitch..].fill(word);
            } else {
                memory.fill(word);
            }
        }
    }

    /// The same, on all threads.
    pub(crate) fn fill_borders<W: Word>(&self, memory: &mut [W], word: W) {
        let frames = memory.chunks_exact_mut(self.frame_len().max(1));
        parallel::each(frames, |frame| self.fill_border(frame, word));
    }

    /// How far from a window's beginning its pixels lie, in steps of one pixel.
    pub(crate) fn taps(&self, size: Size) -> Vec<usize> {
        self.steps(0..size[0] * size[1], [0; 3], size, [1; 3])
    }
}
