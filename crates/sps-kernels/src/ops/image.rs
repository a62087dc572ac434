//! Convolutions of images, whose pixels of three numbers lie side by side whatever a word holds.
//!
//! A row of an image begins at a word and has the padding of its only reader in it. A row under the window is one run
//! of numbers, which may begin within a word: how far within, repeats along a row of the output. Pixels that have it in
//! common are a phase, whose weights lie as far within their words.

use bytemuck::Zeroable;

use super::conv::ConvShape;
use super::grid::{Grid, Window};
use super::panels::Panels;
use super::phases::{Lattice, Packed};
use super::simd::Level;
use super::words::Word;

/// Numbers of a pixel.
pub(super) const PIXEL: usize = 3;

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
