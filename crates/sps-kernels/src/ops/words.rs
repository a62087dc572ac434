//! What memory is made of, and how a kernel computes with it.
//!
//! A word has 32 bits: one f32, two bf16, or four bytes. Sums are f32 with the first two, and i32 of
//! bytes.

use std::borrow::Cow;
use std::marker::PhantomData;

use bytemuck::{Pod, Zeroable};
use half::bf16;
use sps_base::parallel;

use super::simd::{Kernel, Lanes, Level};

/// What feature maps and matrices are made of: 32 bits that hold one f32, two bf16 or four bytes.
pub(crate) trait Word: Pod + Default + Send + Sync + std::fmt::Debug {
    /// One of a word's numbers as it lies in memory.
    type Number: Pod + PartialEq + Send + Sync;

    /// Numbers of a word.
    const NUMBERS: usize;

    /// Whether they are whole, so that a map and a matrix must be scaled to what a word holds.
    const WHOLE: bool = false;

    /// Words that hold so many numbers; the last one's upper half may be free.
    #[inline(always)]
    fn words(numbers: usize) -> usize {
        numbers.div_ceil(Self::NUMBERS)
    }

    /// A word of `number(0)` and, where it holds several, the next ones, rounded.
    #[inline(always)]
    fn of(number: impl Fn(usize) -> f32) -> Self {
        Self::gathered(|i| Self::narrowed(number(i)))
    }

    /// A word of numbers as they lie in memory.
    fn gathered(number: impl Fn(usize) -> Self::Number) -> Self;

    /// A matrix's numbers, rounded, one after the other.
    fn of_weights(level: Level, weights: &[f32]) -> Cow<'_, [Self]>;

    /// What a number is as f32.
    fn widened(number: Self::Number) -> f32;

    /// A number as it lies in memory, rounded; whole ones are within 0 to 255.
    fn narrowed(number: f32) -> Self::Number;

    /// The numbers of words as they lie in memory.
    #[inline(always)]
    fn each(words: &[Self]) -> &[Self::Number] {
        bytemuck::cast_slice(words)
    }

    /// The same, to be written.
    #[inline(always)]
    fn each_mut(words: &mut [Self]) -> &mut [Self::Number] {
        bytemuck::cast_slice_mut(words)
    }

    /// The numbers of words.
    #[inline(always)]
    fn numbers(words: &[Self]) -> impl Iterator<Item = f32> {
        let numbers = Self::each(words).iter();
        numbers.map(|&number| Self::widened(number))
    }

    /// Of each number of two vectors of words the larger one; NaN where one is NaN.
    fn larger<S: Lanes>(lanes: S, x: S::f32s, y: S::f32s) -> S::f32s;

    /// What [`Arithmetic::multiply_add`] does without instructions for these words.
    fn multiply_add<S: Lanes>(lanes: S, x: S::f32s, y: S::f32s, sum: S::f32s) -> S::f32s;

    /// Runs a kernel by the machine's own instructions for these words where it has some.
    #[inline]
    fn run<K: WordKernel<Self>>(level: Level, kernel: K) -> K::Output {
        level.run(Plainly(kernel, Plain::<Self>(PhantomData)))
    }
}

/// Words of numbers that stand for themselves: what networks train in.
pub(crate) trait Real: Word {
    /// Where the vectors of [`Real::columns`] have a column.
    fn place(column: usize, lanes: usize) -> usize;

    /// Vectors of some columns of as many rows of `memory` as a word has numbers; a row that is not there
    /// counts as 0. Each lane has a word of one column's numbers; [`Real::place`] knows of which.
    fn columns<S: Lanes, const NV: usize, const WHOLE: bool>(
        lanes: S,
        memory: &[Self],
        rows: &[usize],
        columns: usize,
    ) -> [S::f32s; NV];
}

impl Word for f32 {
    type Number = Self;

    const NUMBERS: usize = 1;

    #[inline(always)]
    fn gathered(number: impl Fn(usize) -> f32) -> Self {
        number(0)
    }

    fn of_weights(_: Level, weights: &[f32]) -> Cow<'_, [Self]> {
        Cow::Borrowed(weights)
    }

    #[inline(always)]
    fn widened(number: Self) -> f32 {
        number
    }

    #[inline(always)]
    fn narrowed(number: f32) -> Self {
        number
    }

    #[inline(always)]
    fn larger<S: Lanes>(lanes: S, x: S::f32s, y: S::f32s) -> S::f32s {
        // `x` where one of them is NaN.
        let largest = lanes.at_least(y, x);
        lanes.select_f32s(lanes.equal_f32s(y, y), largest, y)
    }

    #[inline(always)]
    fn multiply_add<S: Lanes>(lanes: S, x: S::f32s, y: S::f32s, sum: S::f32s) -> S::f32s {
        lanes.fma(x, y, sum)
    }
}

impl Real for f32 {
    #[inline(always)]
    fn place(column: usize, _: usize) -> usize {
        column
    }

    #[inline(always)]
    fn columns<S: Lanes, const NV: usize, const WHOLE: bool>(
        lanes: S,
        memory: &[Self],
        rows: &[usize],
        columns: usize,
    ) -> [S::f32s; NV] {
        vectors::<S, NV, WHOLE>(lanes, &memory[rows[0]..rows[0] + columns])
    }
}

/// Two numbers of eight bits' precision and the range of f32, the first in the lower half.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C, align(4))]
pub(crate) struct Bf16Pair([bf16; 2]);

impl Word for Bf16Pair {
    type Number = bf16;

    const NUMBERS: usize = 2;

    #[inline(always)]
    fn gathered(number: impl Fn(usize) -> bf16) -> Self {
        Self([number(0), number(1)])
    }

    fn of_weights(level: Level, weights: &[f32]) -> Cow<'_, [Self]> {
        let mut words = vec![Self::default(); Self::words(weights.len())];
        let parts = Self::each_mut(&mut words).chunks_mut(ROUNDED);
        let parts = parts.zip(weights.chunks(ROUNDED));
        parallel::each(parts, |(words, numbers)| {
            level.run(
                #[inline(always)]
                move || {
                    for (to, number) in words.iter_mut().zip(numbers) {
                        *to = rounded(*number);
                    }
                },
            );
        });
        Cow::Owned(words)
    }

    /// As plain bits, so that a loop becomes one over vectors.
    #[inline(always)]
    fn widened(number: bf16) -> f32 {
        f32::from_bits(u32::from(number.to_bits()) << 16)
    }

    #[inline(always)]
    fn narrowed(number: f32) -> bf16 {
        rounded(number)
    }

    #[inline(always)]
    fn larger<S: Lanes>(lanes: S, x: S::f32s, y: S::f32s) -> S::f32s {
        let of_first = f32::larger(lanes, first(lanes, x), first(lanes, y));
        let of_second = f32::larger(lanes, second(lanes, x), second(lanes, y));
        let low = lanes.transmute_u32s_f32s(of_first);
        let low = lanes.wrapping_dyn_shr_u32s(low, lanes.splat_u32s(16));
        lanes.transmute_f32s_u32s(lanes.or_u32s(low, lanes.transmute_u32s_f32s(of_second)))
    }

    /// Each half becomes an f32.
    #[inline(always)]
    fn multiply_add<S: Lanes>(lanes: S, x: S::f32s, y: S::f32s, sum: S::f32s) -> S::f32s {
        let sum = lanes.fma(first(lanes, x), first(lanes, y), sum);
        lanes.fma(second(lanes, x), second(lanes, y), sum)
    }

    #[inline]
    fn run<K: WordKernel<Self>>(level: Level, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        if let Some(native) = level.bf16() {
            return native.run(kernel);
        }
        level.run(Plainly(kernel, Plain::<Self>(PhantomData)))
    }
}

/// A number rounded to bf16, to even where it lies between two. Without a branch, so that a loop becomes one over
/// vectors.
#[inline(always)]
pub(super) fn rounded(number: f32) -> bf16 {
    let bits = number.to_bits();
    let nearest = bits.wrapping_add(0x7fff + (bits >> 16 & 1)) >> 16;
    let quiet = bits >> 16 | 0x40;
    bf16::from_bits(if number.is_nan() { quiet } else { nearest } as u16)
}

/// Numbers that one thread rounds.
const ROUNDED: usize = 1 << 16;

impl Real for Bf16Pair {
    // Of two vectors, even columns are in the first, odd ones in the second.
    #[inline(always)]
    fn place(column: usize, lanes: usize) -> usize {
        let within = column % (2 * lanes);
        column - within + within % 2 * lanes + within / 2
    }

    #[inline(always)]
    fn columns<S: Lanes, const NV: usize, const WHOLE: bool>(
        lanes: S,
        memory: &[Self],
        rows: &[usize],
        columns: usize,
    ) -> [S::f32s; NV] {
        let words = Self::words(columns);
        let first = bits::<S, WHOLE>(lanes, &memory[rows[0]..rows[0] + words]);
        let second = match rows {
            [_, row, ..] => bits::<S, WHOLE>(lanes, &memory[*row..row + words]),
            _ => lanes.splat_u32s(0),
        };
        let (low, high) = (lanes.splat_u32s(0xffff), lanes.splat_u32s(0xffff_0000));
        let half = lanes.splat_u32s(16);
        let upper = lanes.wrapping_dyn_shl_u32s(second, half);
        let lower = lanes.wrapping_dyn_shr_u32s(first, half);
        let even = lanes.or_u32s(lanes.and_u32s(first, low), upper);
        let odd = lanes.or_u32s(lower, lanes.and_u32s(second, high));
        let even = lanes.transmute_f32s_u32s(even);
        let odd = lanes.transmute_f32s_u32s(odd);
        std::array::from_fn(|v| [even, odd][v % 2])
    }
}

/// Four whole numbers, the first in the lowest byte: a map's are 0 to 255, a matrix's -127 to 127. A
/// sum of their products is exact in i32 as long as there are no more than [`Bytes::LONGEST_SUM`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C, align(4))]
pub(crate) struct Bytes([u8; 4]);

impl Bytes {
    /// Products whose sum an i32 holds whatever they are: 66,311. The longest sum of a network here is
    /// of 512 channels under a window of 3 x 3, 4,608.
    pub(crate) const LONGEST_SUM: usize = i32::MAX as usize / (255 * 127);
}

/// 1.5 * 2²³: added to a number of less than 2²², leaves it, rounded to even, in the lowest bits.
const ROUNDER: f32 = 12_582_912.0;

/// The lowest byte of a number rounded to even, which lies between -2²² and 2²².
#[inline(always)]
pub(super) fn byte(number: f32) -> u8 {
    (number + ROUNDER).to_bits() as u8
}

impl Word for Bytes {
    type Number = u8;

    const NUMBERS: usize = 4;

    const WHOLE: bool = true;

    // `clamp` would let through what is no number; of `max` it becomes 0.
    #[allow(clippy::manual_clamp)]
    #[inline(always)]
    fn of(number: impl Fn(usize) -> f32) -> Self {
        Self([0, 1, 2, 3].map(|i| byte(number(i).max(0.0).min(255.0))))
    }

    #[inline(always)]
    fn gathered(number: impl Fn(usize) -> u8) -> Self {
        Self([0, 1, 2, 3].map(number))
    }

    fn of_weights(_: Level, weights: &[f32]) -> Cow<'_, [Self]> {
        let mut words = vec![Self::default(); Self::words(weights.len())];
        for (number, &weight) in Self::each_mut(&mut words).iter_mut().zip(weights) {
            *number = byte(weight);
        }
        Cow::Owned(words)
    }

    #[inline(always)]
    fn widened(number: u8) -> f32 {
        f32::from(number)
    }

    #[inline(always)]
    fn narrowed(number: f32) -> u8 {
        byte(number)
    }

    #[inline(always)]
    fn larger<S: Lanes>(lanes: S, x: S::f32s, y: S::f32s) -> S::f32s {
        lanes.larger_bytes(x, y)
    }

    #[inline(always)]
    fn multiply_add<S: Lanes>(lanes: S, x: S::f32s, y: S::f32s, sum: S::f32s) -> S::f32s {
        lanes.dot(x, y, sum)
    }

    #[inline]
    fn run<K: WordKernel<Self>>(level: Level, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        if let Some(native) = level.vnni() {
            return native.run(kernel);
        }
        level.run(Plainly(kernel, Plain::<Self>(PhantomData)))
    }
}

/// Vectors of f32; `WHOLE` if the numbers fill them, else what they lack is 0.
#[inline(always)]
pub(super) fn vectors<S: Lanes, const NV: usize, const WHOLE: bool>(
    lanes: S,
    from: &[f32],
) -> [S::f32s; NV] {
    let mut vectors = [lanes.splat_f32s(0.0); NV];
    // No closure: one that is not inlined is compiled without the instructions, and returns through memory.
    for (v, vector) in vectors.iter_mut().enumerate() {
        *vector = if WHOLE {
            S::as_simd_f32s(from).0[v]
        } else {
            let from = &from[(v * S::F32_LANES).min(from.len())..];
            lanes.partial_load_f32s(&from[..from.len().min(S::F32_LANES)])
        };
    }
    vectors
}

/// The bits of words as the lanes of vectors hold them.
#[inline(always)]
pub(super) fn lanes_of<W: Word>(words: &[W]) -> &[f32] {
    bytemuck::cast_slice(words)
}

/// How a kernel computes with words on one set of vector instructions; without those for the words where nothing else
/// is said.
pub(crate) trait Arithmetic<S: Lanes>: Copy {
    /// What memory is made of; vectors hold its bits.
    type Word: Word;

    /// Whether the processors that have these instructions may have matrix tiles.
    const BESIDE_TILES: bool = false;

    /// Whether [`Arithmetic::store`] brings numbers that an i32 holds within 0 to 255.
    const CUTS: bool = false;

    /// As [`Lanes::apart`], with the instructions of this arithmetic.
    #[inline(always)]
    fn apart(self, lanes: S, work: impl FnMut()) {
        lanes.apart(work);
    }

    /// `sum` and, in each lane, the products of the numbers of `x`, a map's, with those of `y`, a
    /// matrix's.
    #[inline(always)]
    fn multiply_add(self, lanes: S, x: S::f32s, y: S::f32s, sum: S::f32s) -> S::f32s {
        Self::Word::multiply_add(lanes, x, y, sum)
    }

    /// Sums of [`Arithmetic::multiply_add`] as numbers.
    #[inline(always)]
    fn numbers(self, lanes: S, sum: S::f32s) -> S::f32s {
        if Self::Word::WHOLE {
            lanes.of_integers(sum)
        } else {
            sum
        }
    }

    /// `x * scale + y`, of numbers. Of maps of bytes in one rounding everywhere.
    #[inline(always)]
    fn scale_add(self, lanes: S, x: S::f32s, scale: S::f32s, y: S::f32s) -> S::f32s {
        if Self::Word::WHOLE {
            lanes.mul_add_f32s(x, scale, y)
        } else {
            lanes.fma(x, scale, y)
        }
    }

    /// For vector `v` of the outputs, a word of each group's part of `x`, the one with `index`,
    /// everywhere in the group. Groups have `G` numbers.
    #[inline(always)]
    fn spread<const G: usize>(self, lanes: S, x: S::f32s, v: usize, index: usize) -> S::f32s {
        match Self::Word::NUMBERS {
            1 => lanes.spread::<G, 1>(x, v, index),
            2 => lanes.spread::<G, 2>(x, v, index),
            _ => lanes.spread::<G, 4>(x, v, index),
        }
    }

    /// Reads `NV` vectors of numbers.
    #[inline(always)]
    fn load<const NV: usize>(self, _: S, from: &[Self::Word]) -> [S::f32s; NV] {
        if Self::Word::NUMBERS == 1 {
            let (from, _) = S::as_simd_f32s(lanes_of(from));
            return std::array::from_fn(|v| from[v]);
        }
        let mut values = [Zeroable::zeroed(); NV];
        let numbers: &mut [f32] = bytemuck::cast_slice_mut(&mut values);
        for (number, widened) in numbers.iter_mut().zip(Self::Word::numbers(from)) {
            *number = widened;
        }
        values
    }

    /// Writes `NV` vectors of numbers, rounded to what a word holds; bytes are within 0 to 255 unless it
    /// [cuts](Arithmetic::CUTS) them.
    #[inline(always)]
    fn store<const NV: usize>(self, _: S, values: [S::f32s; NV], to: &mut [Self::Word]) {
        if Self::Word::NUMBERS == 1 {
            let (to, _) = S::as_mut_simd_f32s(bytemuck::cast_slice_mut(to));
            return to[..NV].copy_from_slice(&values);
        }
        let numbers: &[f32] = bytemuck::cast_slice(&values);
        for (to, &number) in Self::Word::each_mut(to).iter_mut().zip(numbers) {
            *to = Self::Word::narrowed(number);
        }
    }

    /// As [`Arithmetic::load`], of a row shorter than its vectors; numbers beyond it are 0.
    #[inline(always)]
    fn load_part<const NV: usize>(self, lanes: S, from: &[Self::Word]) -> [S::f32s; NV] {
        let mut whole = [Self::Word::zeroed(); LONGEST];
        whole[..from.len()].copy_from_slice(from);
        self.load(lanes, &whole[..Self::Word::words(NV * S::F32_LANES)])
    }

    /// Reads `NV` vectors of numbers; `WHOLE` if there are as many, else what they lack is 0.
    #[inline(always)]
    fn read<const NV: usize, const WHOLE: bool>(
        self,
        lanes: S,
        from: &[Self::Word],
    ) -> [S::f32s; NV] {
        if WHOLE {
            self.load(lanes, from)
        } else {
            self.load_part(lanes, from)
        }
    }

    /// As [`Arithmetic::store`], of a row shorter than its vectors.
    #[inline(always)]
    fn store_part<const NV: usize>(self, lanes: S, values: [S::f32s; NV], to: &mut [Self::Word]) {
        let mut whole = [Self::Word::zeroed(); LONGEST];
        let filled = &mut whole[..Self::Word::words(NV * S::F32_LANES)];
        self.store(lanes, values, filled);
        to.copy_from_slice(&whole[..to.len()]);
    }

    /// Writes `NV` vectors of numbers; `WHOLE` if there is room for as many, else those there is room for.
    #[inline(always)]
    fn write<const NV: usize, const WHOLE: bool>(
        self,
        lanes: S,
        values: [S::f32s; NV],
        to: &mut [Self::Word],
    ) {
        if WHOLE {
            self.store(lanes, values, to);
        } else {
            self.store_part(lanes, values, to);
        }
    }
}

/// Words of the longest row that is loaded or stored at once.
const LONGEST: usize = 32;

/// Without instructions for the words.
#[derive(Debug, Clone, Copy)]
struct Plain<W>(PhantomData<W>);

impl<S: Lanes, W: Word> Arithmetic<S> for Plain<W> {
    type Word = W;

    const BESIDE_TILES: bool = W::NUMBERS == 1 && S::F32_LANES == 16;
}

/// A vector of pairs as plain bits; `WHOLE` if they fill it.
#[inline(always)]
fn bits<S: Lanes, const WHOLE: bool>(lanes: S, from: &[Bf16Pair]) -> S::u32s {
    let [words] = vectors::<S, 1, WHOLE>(lanes, lanes_of(from));
    lanes.transmute_u32s_f32s(words)
}

/// The first numbers of the pairs.
#[inline(always)]
fn first<S: Lanes>(lanes: S, x: S::f32s) -> S::f32s {
    let bits = lanes.transmute_u32s_f32s(x);
    lanes.transmute_f32s_u32s(lanes.wrapping_dyn_shl_u32s(bits, lanes.splat_u32s(16)))
}

/// The second numbers of the pairs.
#[inline(always)]
fn second<S: Lanes>(lanes: S, x: S::f32s) -> S::f32s {
    let bits = lanes.transmute_u32s_f32s(x);
    lanes.transmute_f32s_u32s(lanes.and_u32s(bits, lanes.splat_u32s(0xffff_0000)))
}

/// A piece of work written against [`Arithmetic`] and [`Lanes`]; see [`Kernel`].
pub(crate) trait WordKernel<W: Word> {
    type Output;

    fn run<S: Lanes, A: Arithmetic<S, Word = W>>(self, lanes: S, arithmetic: A) -> Self::Output;
}

struct Plainly<W, K>(K, Plain<W>);

impl<W: Word, K: WordKernel<W>> Kernel for Plainly<W, K> {
    type Output = K::Output;

    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) -> K::Output {
        self.0.run(lanes, self.1)
    }
}
