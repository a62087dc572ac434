//! One operator by itself, on slices, with its gradients.

mod convolution;
mod max_pooling;

pub use convolution::Convolution;
pub use max_pooling::MaxPooling;

use crate::error::{Error, Result};
use crate::ops::buffer::Buffer;
use crate::ops::grid::Grid;

/// Refuses numbers that are not as many as a tensor has.
fn check(what: &'static str, values: &[f32], expected: usize) -> Result<()> {
    if values.len() == expected {
        return Ok(());
    }
    let found = format_args!("{} numbers", values.len());
    Err(Error::input(what, found, expected))
}

/// Whether memory can hold a feature map, which has no extent of 0.
fn sound(grid: &Grid) -> bool {
    let mut extents = [grid.frames, grid.channels].into_iter().chain(grid.size);
    let len = extents.try_fold(1_usize, usize::checked_mul);
    len.is_some_and(|len| (1..=isize::MAX as usize / size_of::<f32>()).contains(&len))
}

/// A feature map with a border of zeros, copied into memory at a cache line; itself where the border is empty.
fn with_border<'a>(values: &'a [f32], padded: &Grid, memory: &'a mut Buffer) -> &'a [f32] {
    if values.len() == padded.len() {
        return values;
    }
    *memory = Buffer::zeros(padded.len());
    for (row, first) in values.chunks_exact(row(padded)).zip(firsts(padded)) {
        memory[first..first + row.len()].copy_from_slice(row);
    }
    memory
}

/// A feature map without its border.
fn without_border(values: &[f32], padded: &Grid) -> Vec<f32> {
    let rows = firsts(padded).map(|first| &values[first..first + row(padded)]);
    rows.flatten().copied().collect()
}

/// Numbers in a row of pixels.
fn row(padded: &Grid) -> usize {
    padded.size[2] * padded.channels
}

/// Where the rows of pixels begin in memory.
fn firsts(padded: &Grid) -> impl Iterator<Item = usize> {
    padded.rows().map(|row| padded.row_start(row))
}
