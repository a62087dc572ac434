//! Convolutions of images, whose pixels of three numbers lie side by side whatever a word holds.
//!
//! A row of an image begins at a word and has the padding of its only reader in it. A row under the window is one run
//! of numbers, which may begin within a word: how far within, repeats along a row of the output. Pixels that have it in
//! common are a phase, whose weights lie as far within their words.
//!
//! Where matrix tiles multiply bytes, they would be all but empty. For windows of stride 2 images then lie in [cells] of
//! 2 x 2 pixels, a map like any other, over which a window of half the size moves cell by cell.
//!
//! [cells]: Layout::Cells

use bytemuck::Zeroable;

use super::conv::ConvShape;
use super::grid::{Grid, Size, Window, pixels};
use super::panels::Panels;
use super::phases::{Lattice, Packed};
use super::simd::Level;
use super::words::Word;

/// Numbers of a pixel.
pub(crate) const PIXEL: usize = 3;

/// Pixels along each side of a cell.
pub(crate) const CELL: usize = 2;

/// How images lie in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Layout {
    /// Row by row.
    Rows,
    /// In cells of 2 x 2 pixels, row by row in each; the padding is in them.
    Cells,
}

impl Layout {
    /// For inference by a window that moves in such steps.
    pub(crate) fn of<W: Word>(level: Level, [_, down, right]: Size) -> Self {
        if W::WHOLE && level.tiles().is_some() && [down, right] == [CELL; 2] {
            Self::Cells
        } else {
            Self::Rows
        }
    }

    /// Images as a map, of words or of cells.
    pub(crate) fn memory<W: Word>(self, images: &Grid) -> Grid {
        if self == Self::Rows {
            return rows_of_words::<W>(images);
        }
        let [height, width] = [1, 2].map(|axis| images.extent(axis).div_ceil(CELL));
        let cells = Grid::tight(
            images.frames,
            [images.size[0], height, width],
            CELL * CELL * PIXEL,
        );
        Grid {
            before: [images.before[0], 0, 0],
            after: [images.after[0], 0, 0],
            ..cells.of::<W>()
        }
    }
}

/// A window of stride 2 over images as one over their cells.
pub(super) fn cell_window(window: &Window) -> Window {
    let [time, height, width] = window.size;
    Window {
        size: [time, height.div_ceil(CELL), width.div_ceil(CELL)],
        stride: [window.stride[0], 1, 1],
        before: [window.before[0], 0, 0],
        after: [window.after[0], 0, 0],
    }
}

/// A convolution of images of stride 2 and its weights as one of their cells.
pub(super) fn of_cells(shape: &ConvShape, weights: &[f32]) -> (ConvShape, Vec<f32>) {
    let [time, height, width] = shape.window.size;
    let cells = ConvShape {
        window: cell_window(&shape.window),
        inputs: CELL * CELL * PIXEL,
        ..*shape
    };
    let [_, rows, columns] = cells.window.size;
    let mut of_cells = vec![0.0; shape.outputs * cells.inputs * pixels(cells.window.size)];
    for (i, &weight) in weights.iter().enumerate() {
        let (x, y, rest) = (i % width, i / width % height, i / width / height);
        let (t, channel, output) = (rest % time, rest / time % PIXEL, rest / time / PIXEL);
        let number = (y % CELL * CELL + x % CELL) * PIXEL + channel;
        let plane = (output * cells.inputs + number) * time + t;
        of_cells[(plane * rows + y / CELL) * columns + x / CELL] = weight;
    }
    (cells, of_cells)
}

/// The rows of images of such a layout, as a map whose pixels are words.
pub(crate) fn rows_of_words<W: Word>(images: &Grid) -> Grid {
    let ([time, height, _], [before, above, _], [after, below, _]) =
        (images.size, images.before, images.after);
    Grid {
        size: [time, height, W::words(PIXEL * images.extent(2))],
        before: [before, above, 0],
        after: [after, below, 0],
        ..Grid::tight(images.frames, images.size, 1)
    }
}

/// Pixels of a row of the output that lie as far from each other as the first and the next whose window begins as
/// far within a word.
#[derive(Debug, Clone, Copy)]
pub(super) struct Phase {
    first: usize,
    /// How many phases there are.
    step: usize,
    /// The word at which the first window begins, and words from one to the next.
    word: usize,
    words: usize,
    /// Numbers of the first word before the window.
    pub(super) offset: usize,
}

impl Phase {
    /// All phases of a window.
    pub(super) fn all<W: Word>(window: &Window) -> impl Iterator<Item = Self> {
        let numbers = PIXEL * window.stride[2];
        let whole = |step: &usize| (numbers * step).is_multiple_of(W::NUMBERS);
        let step = (1..W::NUMBERS).find(whole).unwrap_or(W::NUMBERS);
        (0..step).map(move |first| Self {
            first,
            step,
            word: numbers * first / W::NUMBERS,
            words: numbers * step / W::NUMBERS,
            offset: numbers * first % W::NUMBERS,
        })
    }

    /// Words of a run.
    pub(super) fn run<W: Word>(&self, window: &Window) -> usize {
        W::words(self.offset + PIXEL * window.size[2])
    }

    /// Of images with as much padding along their rows as the window wants, as rows of words.
    pub(super) fn lattice(&self, window: &Window, images: &Grid) -> Lattice {
        debug_assert_eq!(images.before[2], window.before[2]);
        let [before, above] = [0, 1].map(|axis| images.before[axis] - window.before[axis]);
        Lattice {
            first: [0, 0, self.first],
            step: [1, 1, self.step],
            start: [before, above, self.word],
            stride: [window.stride[0], window.stride[1], self.words],
        }
    }
}

/// Where the runs of a window begin, from its own beginning.
pub(super) fn taps<W: Word>(window: &Window, images: &Grid) -> Vec<usize> {
    let [time, height, _] = window.size;
    rows_of_words::<W>(images).taps([time, height, 1])
}

/// Packs the weights of a convolution of images, `(outputs, 3, time, height, width)`, for each phase.
pub(super) fn pack<W: Word>(
    level: Level,
    shape: &ConvShape,
    weights: &[f32],
) -> Vec<(Phase, Packed<W>)> {
    let words = W::of_weights(level, weights);
    let numbers = W::each(&words);
    let phases = panels(level, shape, 1, |_, weight| numbers[weight]).into_iter();
    let packed = phases.map(|(phase, panels)| (phase, Packed::Matrices(vec![panels])));
    packed.collect()
}

/// The same as panels of so many runs for each row under the window: of `number(run, index of the weight)`.
pub(super) fn panels<W: Word>(
    level: Level,
    shape: &ConvShape,
    runs: usize,
    number: impl Fn(usize, usize) -> W::Number + Sync,
) -> Vec<(Phase, Panels<W>)> {
    let [time, height, width] = shape.window.size;
    let rows = time * height;
    let panels = |phase: Phase| {
        let words = phase.run::<W>(&shape.window);
        let panels = Panels::pack(
            level,
            [runs * rows, words],
            shape.outputs,
            |n, word, output| {
                W::gathered(|i| {
                    let place = (W::NUMBERS * word + i).wrapping_sub(phase.offset);
                    let (pixel, channel) = (place / PIXEL, place % PIXEL);
                    if pixel >= width {
                        return W::Number::zeroed();
                    }
                    let row = (output * PIXEL + channel) * rows + n / runs;
                    number(n % runs, row * width + pixel)
                })
            },
        );
        (phase, panels)
    };
    Phase::all::<W>(&shape.window).map(panels).collect()
}
