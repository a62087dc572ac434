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

const LINE: usize = 16;

/// Words that begin at a cache line.
#[derive(Debug, Clone, Default)]
pub(crate) struct Buffer<W = f32> {
    lines: Vec<Line>,
    len: usize,
    words: PhantomData<W>,
}

impl<W: Word> Buffer<W> {
    /// `len` zeros.
    pub(crate) fn zeros(len: usize) -> Self {
        Self {
            lines: vec![Line([0.0; LINE]); len.div_ceil(LINE)],
            len,
            words: PhantomData,
        }
    }

    /// The length it can take without more memory.
    fn capacity(&self) -> usize {
        self.lines.len() * LINE
    }

    /// Makes it `len` long, whatever it then holds. Memory once taken is kept.
    pub(crate) fn resize(&mut self, len: usize) {
        let lines = len.div_ceil(LINE);
        if self.lines.len() < lines {
            self.lines.resize(lines, Line([0.0; LINE]));
        }
        self.len = len;
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
pub(crate) struct Recycler(Mutex<Vec<Buffer>>);

impl Recycler {
    fn buffers(&self) -> MutexGuard<'_, Vec<Buffer>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// `len` numbers of any value.
    pub(crate) fn take(self: &Arc<Self>, len: usize) -> Scratch {
        let mut free = self.buffers();
        let fits = |buffer: &&Buffer| buffer.capacity() >= len && buffer.capacity() <= 2 * len;
        let best = free.iter().filter(fits).map(Buffer::capacity).min();
        let found = best.and_then(|best| free.iter().position(|b| b.capacity() == best));
        let mut buffer = found.map_or_else(Buffer::default, |index| free.swap_remove(index));
        drop(free);
        buffer.resize(len);
        Scratch {
            buffer,
            home: Arc::clone(self),
        }
    }
}

/// Memory on loan from a [`Recycler`].
#[derive(Debug)]
pub(crate) struct Scratch {
    buffer: Buffer,
    home: Arc<Recycler>,
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let buffer = std::mem::take(&mut self.buffer);
        self.home.buffers().push(buffer);
    }
}

impl Deref for Scratch {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.buffer
    }
}

impl DerefMut for Scratch {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.buffer
    }
}
