//! How the numbers of a feature map lie in memory, and how a kernel computes with them.
//!
//! Memory is made of 32-bit words, held as `f32`. A word is one f32, or two bf16, the first of
//! them in its lower half. Sums are f32 in either format.

use half::bf16;

use super::simd::{Kernel, Lanes, Level};

/// What a 32-bit word of memory holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Format {
    /// One f32.
    #[default]
    F32,
    /// Two bf16: numbers of eight bits' precision and the range of f32.
    Bf16,
}

impl Format {
    /// Words that hold so many numbers; the last one's upper half may be free.
    pub(crate) const fn words(self, numbers: usize) -> usize {
        match self {
            Self::F32 => numbers,
            Self::Bf16 => numbers.div_ceil(2),
        }
    }

    /// Numbers of a word.
    pub(crate) const fn numbers(self) -> usize {
        match self {
            Self::F32 => 1,
            Self::Bf16 => 2,
        }
    }
}

/// Two numbers, rounded, as one word.
pub(crate) fn pair(first: f32, second: f32) -> f32 {
    let bits = |x| u32::from(bf16::from_f32(x).to_bits());
    f32::from_bits(bits(first) | bits(second) << 16)
}

/// How a kernel computes with words on one set of vector instructions.
pub(super) trait Words<S: Lanes>: Copy {
    /// What the words hold.
    const FORMAT: Format;

    /// `sum` and, in each lane, the products of the numbers of `x` with those of `y`.
    fn multiply_add(self, lanes: S, x: S::f32s, y: S::f32s, sum: S::f32s) -> S::f32s;

    /// For vector `v` of the outputs, a word of each group's part of `x`, the one with `index`,
    /// everywhere in the group. Groups have `G` numbers.
    fn spread<const G: usize>(self, lanes: S, x: S::f32s, v: usize, index: usize) -> S::f32s;

    /// Reads `NV` vectors of numbers.
    fn load<const NV: usize>(self, lanes: S, from: &[f32]) -> [S::f32s; NV];

    /// Writes `NV` vectors of numbers, rounded to the format.
    fn store<const NV: usize>(self, lanes: S, values: [S::f32s; NV], to: &mut [f32]);

    /// As [`Words::load`], of a row shorter than its vectors; numbers beyond it are 0.
    #[inline(always)]
    fn load_part<const NV: usize>(self, lanes: S, from: &[f32]) -> [S::f32s; NV] {
        let mut whole = [0.0; LONGEST];
        whole[..from.len()].copy_from_slice(from);
        self.load(lanes, &whole[..Self::FORMAT.words(NV * S::F32_LANES)])
    }

    /// As [`Words::store`], of a row shorter than its vectors.
    #[inline(always)]
    fn store_part<const NV: usize>(self, lanes: S, values: [S::f32s; NV], to: &mut [f32]) {
        let mut whole = [0.0; LONGEST];
        self.store(
            lanes,
            values,
            &mut whole[..Self::FORMAT.words(NV * S::F32_LANES)],
        );
        to.copy_from_slice(&whole[..to.len()]);
    }
}

/// Words of the longest row that is loaded or stored at once.
const LONGEST: usize = 32;

/// Words of one f32.
#[derive(Debug, Clone, Copy)]
struct Singles;

impl<S: Lanes> Words<S> for Singles {
    const FORMAT: Format = Format::F32;

    #[inline(always)]
    fn multiply_add(self, lanes: S, x: S::f32s, y: S::f32s, sum: S::f32s) -> S::f32s {
        lanes.fma(x, y, sum)
    }

    #[inline(always)]
    fn spread<const G: usize>(self, lanes: S, x: S::f32s, _: usize, index: usize) -> S::f32s {
        lanes.spread::<G>(x, index)
    }

    #[inline(always)]
    fn load<const NV: usize>(self, _: S, from: &[f32]) -> [S::f32s; NV] {
        let (from, _) = S::as_simd_f32s(from);
        std::array::from_fn(|v| from[v])
    }

    #[inline(always)]
    fn store<const NV: usize>(self, _: S, values: [S::f32s; NV], to: &mut [f32]) {
        let (to, _) = S::as_mut_simd_f32s(to);
        to[..NV].copy_from_slice(&values);
    }
}

/// Words of two bf16, without instructions for them: each half becomes an f32.
#[derive(Debug, Clone, Copy)]
struct Pairs;

impl<S: Lanes> Words<S> for Pairs {
    const FORMAT: Format = Format::Bf16;

    #[inline(always)]
    fn multiply_add(self, lanes: S, x: S::f32s, y: S::f32s, sum: S::f32s) -> S::f32s {
        let sum = lanes.fma(first(lanes, x), first(lanes, y), sum);
        lanes.fma(second(lanes, x), second(lanes, y), sum)
    }

    #[inline(always)]
    fn spread<const G: usize>(self, lanes: S, x: S::f32s, v: usize, index: usize) -> S::f32s {
        lanes.spread_pairs::<G>(x, v, index)
    }

    #[inline(always)]
    fn load<const NV: usize>(self, _: S, from: &[f32]) -> [S::f32s; NV] {
        let mut values = [bytemuck::Zeroable::zeroed(); NV];
        let numbers: &mut [f32] = bytemuck::cast_slice_mut(&mut values);
        let from: &[bf16] = bytemuck::cast_slice(from);
        for (number, from) in numbers.iter_mut().zip(from) {
            *number = from.to_f32();
        }
        values
    }

    #[inline(always)]
    fn store<const NV: usize>(self, _: S, values: [S::f32s; NV], to: &mut [f32]) {
        let numbers: &[f32] = bytemuck::cast_slice(&values);
        for (to, numbers) in to.iter_mut().zip(numbers.chunks_exact(2)) {
            *to = pair(numbers[0], numbers[1]);
        }
    }
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

/// A piece of work written against [`Words`] and [`Lanes`]; see [`Kernel`].
pub(super) trait WordKernel {
    type Output;

    fn run<S: Lanes, W: Words<S>>(self, lanes: S, words: W) -> Self::Output;
}

impl Level {
    /// Runs a kernel on words of a format, by the machine's own instructions for it where it has
    /// some.
    #[inline]
    pub(super) fn run_on<K: WordKernel>(self, format: Format, kernel: K) -> K::Output {
        match format {
            Format::F32 => self.run(With {
                kernel,
                words: Singles,
            }),
            Format::Bf16 => {
                #[cfg(target_arch = "x86_64")]
                if let Self::Avx512(simd) = self
                    && let Some(native) = super::native::bf16::Native::detect(simd)
                {
                    return native.run(kernel);
                }
                self.run(With {
                    kernel,
                    words: Pairs,
                })
            }
        }
    }
}

struct With<K, W> {
    kernel: K,
    words: W,
}

impl<K: WordKernel> Kernel for With<K, Singles> {
    type Output = K::Output;

    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) -> K::Output {
        self.kernel.run(lanes, self.words)
    }
}

impl<K: WordKernel> Kernel for With<K, Pairs> {
    type Output = K::Output;

    #[inline(always)]
    fn run<S: Lanes>(self, lanes: S) -> K::Output {
        self.kernel.run(lanes, self.words)
    }
}
