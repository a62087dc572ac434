//! Memory for kernels.

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytemuck::{Pod, Zeroable};

use super::words::Word;

/// One cache line: what a vector load must not straddle.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([f32; LINE]);

/// Words of a cache line.
pub(super) const LINE: usize = 16;

/// Words that begin at a cache line.
#[derive(Debug, Clone, Default)]
pub(crate) struct Buffer<W = f32> {
    lines: Vec<Line>,
    len: usize,
    words: PhantomData<W>,
}

impl<W: Word> Buffer<W> {
    pub(crate) fn zeros(len: usize) -> Self {
        Self {
            lines: vec![Line([0.0; LINE]); len.div_ceil(LINE)],
            len,
            words: PhantomData,
        }
    }

    /// Makes it `len` long, whatever it then holds. Memory once taken is kept.
    pub(crate) fn resize(&mut self, len: usize) {
        let lines = len.div_ceil(LINE);
        if self.lines.len() < lines {
            self.lines.resize(lines, Line([0.0; LINE]));
        }
        self.len = len;
    }

    /// Of memory, whatever its length.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.lines[..])
    }
}

impl<W: Word> Deref for Buffer<W> {
    type Target = [W];

    fn deref(&self) -> &[W] {
        &bytemuck::cast_slice(&self.lines)[..self.len]
    }
}

impl<W: Word> DerefMut for Buffer<W> {
    fn deref_mut(&mut self) -> &mut [W] {
        &mut bytemuck::cast_slice_mut(&mut self.lines)[..self.len]
    }
}

/// Memory that is handed out again when it comes back: a training step takes and frees the same
/// sizes over and over, and fresh memory is slow.
#[derive(Debug, Default)]
pub(crate) struct Recycler(Mutex<Vec<Vec<Line>>>);

impl Recycler {
    fn free(&self) -> MutexGuard<'_, Vec<Vec<Line>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Gives back to the system what is not on loan.
    pub(crate) fn shrink(&self) {
        self.free().clear();
    }

    /// `len` words of any value.
    pub(crate) fn take<W: Word>(self: &Arc<Self>, len: usize) -> Scratch<W> {
        let wanted = len.div_ceil(LINE);
        let mut free = self.free();
        let fits = |lines: &&Vec<Line>| (wanted..=2 * wanted).contains(&lines.len());
        let best = free.iter().filter(fits).map(Vec::len).min();
        let found = best.and_then(|best| free.iter().position(|lines| lines.len() == best));
        let lines = found.map_or_else(Vec::default, |index| free.swap_remove(index));
        drop(free);
        let mut buffer = Buffer {
            lines,
            len: 0,
            words: PhantomData,
        };
        buffer.resize(len);
        Scratch {
            buffer,
            home: Arc::clone(self),
        }
    }
}

/// Memory on loan from a [`Recycler`].
#[derive(Debug)]
pub(crate) struct Scratch<W: Word = f32> {
    buffer: Buffer<W>,
    home: Arc<Recycler>,
}

impl<W: Word> Drop for Scratch<W> {
    fn drop(&mut self) {
        let lines = std::mem::take(&mut self.buffer.lines);
        self.home.free().push(lines);
    }
}

impl<W: Word> Deref for Scratch<W> {
    type Target = [W];

    fn deref(&self) -> &[W] {
        &self.buffer
    }
}

impl<W: Word> DerefMut for Scratch<W> {
    fn deref_mut(&mut self) -> &mut [W] {
        &mut self.buffer
    }
}
