//! The vector instructions a kernel runs on, chosen when the program runs.
//!
//! A kernel is written once, against [`Lanes`]; [`Level::run`] compiles it for each instruction
//! set and calls the one the machine has. The unsafe side of that lies in pulp.

use std::cell::Cell;
use std::sync::OnceLock;

use bytemuck::{cast_slice, cast_slice_mut};
#[cfg(target_arch = "aarch64")]
use pulp::aarch64::Neon;
use pulp::{NullaryFnOnce, Scalar128b, Simd};
#[cfg(target_arch = "x86_64")]
use pulp::{
    cast,
    x86::{V3, V4},
};

#[cfg(target_arch = "x86_64")]
use super::amx::Amx;
use super::words::byte;
use crate::precision::Precision;

thread_local! {
    static FORCED: Cell<Option<Level>> = const { Cell::new(None) };
}

/// A set of vector instructions that this machine has.
#[derive(Debug, Clone, Copy)]
pub enum Level {
    /// Four lanes without any instruction named: what the compiler makes of arrays.
    Portable,
    /// 256-bit vectors with fused multiply-add.
    #[cfg(target_arch = "x86_64")]
    Avx2(V3),
    /// 512-bit vectors.
    #[cfg(target_arch = "x86_64")]
    Avx512(V4),
    /// 512-bit vectors, and matrix tiles for products of bf16 and of bytes.
    #[cfg(target_arch = "x86_64")]
    Amx(Amx),
    /// Portable, with tiles written plainly: what holds the walk over tiles to its tests on every machine.
    #[cfg(test)]
    Tiles,
    /// 128-bit vectors of ARM.
    #[cfg(target_arch = "aarch64")]
    Neon(Neon),
}

impl Level {
    /// The widest that this machine has, or the one that `SPS_INSTRUCTIONS` names: `portable`, `avx2`, `avx512`, `amx` or
    /// `neon`.
    /// Where the machine has none of that name, portable.
    pub fn detect() -> Self {
        static ASKED_FOR: OnceLock<Option<Level>> = OnceLock::new();
        let asked_for = ASKED_FOR.get_or_init(|| {
            let name = std::env::var("SPS_INSTRUCTIONS").ok()?;
            let found = Self::all().into_iter().find(|level| level.name() == name);
            Some(found.unwrap_or(Self::Portable))
        });
        let widest = || Self::all().pop().unwrap_or(Self::Portable);
        FORCED.get().or(*asked_for).unwrap_or_else(widest)
    }

    /// Those that this machine has, the widest last.
    pub fn all() -> Vec<Self> {
        let mut levels = vec![Self::Portable];
        #[cfg(test)]
        levels.push(Self::Tiles);
        #[cfg(target_arch = "x86_64")]
        levels.extend(V3::try_new().map(Self::Avx2));
        #[cfg(target_arch = "x86_64")]
        levels.extend(V4::try_new().map(Self::Avx512));
        #[cfg(target_arch = "x86_64")]
        levels.extend(Amx::detect().map(Self::Amx));
        #[cfg(target_arch = "aarch64")]
        levels.extend(Neon::try_new().map(Self::Neon));
        levels
    }

    /// As `SPS_INSTRUCTIONS` has it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => "avx2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => "avx512",
            #[cfg(target_arch = "x86_64")]
            Self::Amx(_) => "amx",
            #[cfg(test)]
            Self::Tiles => "tiles",
            #[cfg(target_arch = "aarch64")]
            Self::Neon(_) => "neon",
        }
    }

    /// Runs `work` on each level of this machine, which [`Level::detect`] then says on this thread: what is
    /// compared level by level.
    pub fn on_each(work: impl Fn(Self)) {
        for level in Self::all() {
            let before = FORCED.replace(Some(level));
            work(level);
            FORCED.set(before);
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn avx512(self) -> Option<V4> {
        match self {
            Self::Avx512(simd) => Some(simd),
            Self::Amx(amx) => Some(amx.vectors()),
            _ => None,
        }
    }

    /// The machine's own instructions for bf16, which round otherwise than those for f32.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn bf16(self) -> Option<super::native::bf16::Native> {
        super::native::bf16::Native::detect(self.avx512()?)
    }

    /// The machine's own instructions for bytes.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn vnni(self) -> Option<super::native::vnni::Native> {
        super::native::vnni::Native::detect(self.avx512()?)
    }

    /// The machine's matrix tiles.
    pub(super) fn tiles(self) -> Option<TileKind> {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Amx(amx) => Some(TileKind::Amx(amx)),
            #[cfg(test)]
            Self::Tiles => Some(TileKind::Software),
            _ => None,
        }
    }

    /// What the last bits of sums depend on beside the order of their terms, in words; nothing for
    /// f32 by fused multiply-add.
    pub fn rounding(self, precision: Precision) -> Option<&'static str> {
        if matches!(self, Self::Portable) && !FUSED {
            return Some("products rounded");
        }
        let bf16 = precision == Precision::Bf16;
        if (bf16 || precision == Precision::Bf16x2) && self.tiles().is_some() {
            return Some("tiles");
        }
        #[cfg(target_arch = "x86_64")]
        if self.bf16().is_some() {
            return None;
        }
        bf16.then_some("pairs widened")
    }

    /// Numbers in one vector.
    pub const fn lanes(self) -> usize {
        match self {
            Self::Portable => Scalar128b::F32_LANES,
            #[cfg(test)]
            Self::Tiles => Scalar128b::F32_LANES,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => V3::F32_LANES,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) | Self::Amx(_) => V4::F32_LANES,
            #[cfg(target_arch = "aarch64")]
            Self::Neon(_) => Neon::F32_LANES,
        }
    }

    /// Runs a kernel, compiled for this level.
    // What is inlined is compiled once more in every part of the crate that calls it, with all its kernels.
    #[inline(never)]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Portable => kernel.run(Scalar128b),
            // A second `kernel.run(Scalar128b)` would be inlined, thus compiled, a second time.
            #[cfg(test)]
            Self::Tiles => Self::Portable.run(kernel),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(simd) => simd.vectorize(Call(kernel, simd)),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(simd) => simd.vectorize(Call(kernel, simd)),
            #[cfg(target_arch = "x86_64")]
            Self::Amx(amx) => Self::Avx512(amx.vectors()).run(kernel),
            #[cfg(target_arch = "aarch64")]
            Self::Neon(simd) => simd.vectorize(Call(kernel, simd)),
        }
    }
}

/// What stands behind matrix tiles.
#[derive(Debug, Clone, Copy)]
pub(super) enum TileKind {
    /// The processor's own.
    #[cfg(target_arch = "x86_64")]
    Amx(Amx),
    /// Arrays.
    #[cfg(test)]
    Software,
}

/// A piece of work written against [`Lanes`].
///
/// `run` must be `#[inline(always)]`, and so must everything that it calls with `lanes`: only
/// then is it compiled with the level's instructions.
pub trait Kernel {
    /// What comes of it.
    type Output;

    /// Does it.
    fn run<S: Lanes>(self, lanes: S) -> Self::Output;
}

/// A closure, which must be `#[inline(always)]` as `run` must. It is handed no lanes: it has them already, or the
/// compiler makes vectors of its loops. It is called by `FnMut`: by `FnOnce` the compiler may call a function around
/// it, which is not inlined.
impl<T, F: FnMut() -> T> Kernel for F {
    type Output = T;

    #[inline(always)]
    fn run<S: Lanes>(mut self, _: S) -> T {
        self()
    }
}

/// A kernel and its lanes, as pulp runs them.
pub(super) struct Call<K, S>(pub(super) K, pub(super) S);

impl<K: Kernel, S: Lanes> NullaryFnOnce for Call<K, S> {
    type Output = K::Output;

    #[inline(always)]
    fn call(self) -> K::Output {
        self.0.run(self.1)
    }
}

/// What kernels need beside pulp's operations.
pub trait Lanes: Simd {
    /// `a * b + c`, in one rounding where the machine can.
    fn fma(self, a: Self::f32s, b: Self::f32s, c: Self::f32s) -> Self::f32s;

    /// Runs a closure, which is `#[inline(always)]`, compiled with the same instructions, in a function of its own where
    /// there is much of it: compiling one function takes a time that grows with the square of its size.
    #[inline(always)]
    fn apart(self, work: impl FnMut()) {
        self.vectorize(Call(work, self));
    }

    /// The larger of `x` and `floor`, which is no NaN; where `x` is NaN, NaN.
    fn at_least(self, floor: Self::f32s, x: Self::f32s) -> Self::f32s;

    /// The smaller of `x` and `ceiling`, which is no NaN; where `x` is NaN, NaN.
    fn at_most(self, ceiling: Self::f32s, x: Self::f32s) -> Self::f32s;

    /// `x`, but no less than the first limit and no more than the second.
    #[inline(always)]
    fn within(self, [least, most]: [Self::f32s; 2], x: Self::f32s) -> Self::f32s {
        self.at_most(most, self.at_least(least, x))
    }

    /// For words that hold `N` numbers each, in `N` vectors, of which this is `v`: in each run of `G` lanes that
    /// group's word `index`. Where `N` is 1, that is the run's lane `index`.
    ///
    /// `G` is 4, or 8 where there are 16 lanes; `N` 1, 2 or 4.
    fn spread<const G: usize, const N: usize>(
        self,
        x: Self::f32s,
        v: usize,
        index: usize,
    ) -> Self::f32s;

    /// In each lane, whose bits are an i32, `sum` and the products of the four bytes of `x`, which are
    /// u8, with those of `y`, which are i8.
    #[inline(always)]
    fn dot(self, x: Self::f32s, y: Self::f32s, sum: Self::f32s) -> Self::f32s {
        let (x, y, mut sums) = ([x], [y], [sum]);
        let (x, y): (&[u8], &[i8]) = (cast_slice(&x), cast_slice(&y));
        let of_lanes = x.chunks_exact(4).zip(y.chunks_exact(4));
        for (sum, (x, y)) in cast_slice_mut::<_, i32>(&mut sums).iter_mut().zip(of_lanes) {
            for (&x, &y) in x.iter().zip(y) {
                *sum += i32::from(x) * i32::from(y);
            }
        }
        sums[0]
    }

    /// The larger of each two bytes.
    #[inline(always)]
    fn larger_bytes(self, x: Self::f32s, y: Self::f32s) -> Self::f32s {
        let mut larger = [x];
        let pairs = cast_slice_mut::<_, u8>(&mut larger).iter_mut();
        for (x, &y) in pairs.zip(cast_slice::<_, u8>(&[y])) {
            *x = y.max(*x);
        }
        larger[0]
    }

    /// Numbers of lanes whose bits are an i32.
    #[inline(always)]
    fn of_integers(self, x: Self::f32s) -> Self::f32s {
        let mut numbers = [x];
        for number in cast_slice_mut::<_, f32>(&mut numbers) {
            *number = number.to_bits() as i32 as f32;
        }
        numbers[0]
    }

    /// Of four rows of bytes, a word for each byte's place: the four bytes there. Where which stands,
    /// `channel_of` says.
    #[inline(always)]
    fn interleave(self, rows: [Self::f32s; 4]) -> [Self::f32s; 4] {
        let mut words = rows;
        let out: &mut [u8] = cast_slice_mut(&mut words);
        for (row, from) in rows.iter().enumerate() {
            let from: &[u8] = cast_slice(std::slice::from_ref(from));
            for (i, out) in out.iter_mut().skip(row).step_by(4).enumerate() {
                *out = from[channel_of(i / Self::F32_LANES, i % Self::F32_LANES)];
            }
        }
        words
    }

    /// Of 16 rows of words that lie `step` apart, a row for each lane's column, `pitch` apart.
    #[inline(always)]
    fn transpose(self, (from, step): (&[f32], usize), (to, pitch): (&mut [f32], usize)) {
        for (i, row) in from.chunks(step).enumerate().take(16) {
            for (column, word) in row[..Self::F32_LANES].iter().enumerate() {
                to[column * pitch + i] = *word;
            }
        }
    }

    /// Numbers of 0 to 255, rounded to even, as bytes: each where a row has it whose word stands as
    /// [`Lanes::interleave`] puts it.
    #[inline(always)]
    fn join(self, numbers: [Self::f32s; 4]) -> Self::f32s {
        let mut joined = [numbers[0]];
        let out: &mut [u8] = cast_slice_mut(&mut joined);
        for (i, &number) in cast_slice::<_, f32>(&numbers).iter().enumerate() {
            out[channel_of(i / Self::F32_LANES, i % Self::F32_LANES)] = byte(number);
        }
        joined[0]
    }
}

/// The place in a row of the byte whose word [`Lanes::interleave`] puts into a lane of a vector.
#[inline(always)]
pub(crate) const fn channel_of(vector: usize, lane: usize) -> usize {
    lane / 4 * 16 + 4 * vector + lane % 4
}

/// The word that [`Lanes::spread`] puts into a lane.
#[inline(always)]
const fn word_of<const G: usize, const N: usize>(
    lanes: usize,
    v: usize,
    index: usize,
    lane: usize,
) -> usize {
    (v * lanes + lane) / G * (G / N) + index
}

/// Reads up to a vector; lanes beyond the slice are zero.
#[inline(always)]
pub(crate) fn load<S: Lanes>(lanes: S, from: &[f32]) -> S::f32s {
    match S::as_simd_f32s(from).0 {
        [whole, ..] => *whole,
        [] => lanes.partial_load_f32s(from),
    }
}

/// What is an instruction of every set.
macro_rules! by_instructions {
    () => {
        #[inline(always)]
        fn fma(self, a: Self::f32s, b: Self::f32s, c: Self::f32s) -> Self::f32s {
            self.mul_add_e_f32s(a, b, c)
        }

        #[inline(always)]
        fn at_least(self, floor: Self::f32s, x: Self::f32s) -> Self::f32s {
            // The instruction returns its second operand where one is NaN.
            self.max_f32s(floor, x)
        }

        #[inline(always)]
        fn at_most(self, ceiling: Self::f32s, x: Self::f32s) -> Self::f32s {
            self.min_f32s(ceiling, x)
        }
    };
}

/// Kernels of bytes by instructions that both widths have.
#[cfg(target_arch = "x86_64")]
macro_rules! of_bytes {
    (
        $float:ident, $all:ident, $rounded:ident;
        $whole:ident, $and:ident, $add:ident;
        $integers:ident, $right:ident, $left:ident, $right_signed:ident, $madd:ident, $max:ident;
        [$low8:ident, $high8:ident, $low16:ident, $high16:ident];
        [$pack32:ident, $pack16:ident]
    ) => {
        #[inline(always)]
        fn dot(self, x: Self::f32s, y: Self::f32s, sum: Self::f32s) -> Self::f32s {
            let (f, w, i) = (self.$float, self.$whole, self.$integers);
            let (x, y) = (cast(x), cast(y));
            // Two products of a byte with a byte could be too large for 16 bits, which `maddubs` sums in.
            let even = w.$and(x, f.$all(0xff));
            let odd = i.$right::<8>(x);
            let even_weights = i.$right_signed::<8>(i.$left::<8>(y));
            let odd_weights = i.$right_signed::<8>(y);
            let products = w.$add(i.$madd(even, even_weights), i.$madd(odd, odd_weights));
            cast(w.$add(cast(sum), products))
        }

        #[inline(always)]
        fn larger_bytes(self, x: Self::f32s, y: Self::f32s) -> Self::f32s {
            cast(self.$integers.$max(cast(x), cast(y)))
        }

        #[inline(always)]
        fn interleave(self, [a, b, c, d]: [Self::f32s; 4]) -> [Self::f32s; 4] {
            let i = self.$integers;
            let (a, b, c, d) = (cast(a), cast(b), cast(c), cast(d));
            let [low, high] = [i.$low8(a, b), i.$high8(a, b)];
            let [low2, high2] = [i.$low8(c, d), i.$high8(c, d)];
            [
                cast(i.$low16(low, low2)),
                cast(i.$high16(low, low2)),
                cast(i.$low16(high, high2)),
                cast(i.$high16(high, high2)),
            ]
        }

        #[inline(always)]
        fn join(self, [a, b, c, d]: [Self::f32s; 4]) -> Self::f32s {
            let (f, i) = (self.$float, self.$integers);
            let [a, b] = [f.$rounded(cast(a)), f.$rounded(cast(b))];
            let [c, d] = [f.$rounded(cast(c)), f.$rounded(cast(d))];
            cast(i.$pack16(i.$pack32(a, b), i.$pack32(c, d)))
        }
    };
}

/// Spreading where a vector has four lanes.
macro_rules! of_four_lanes {
    () => {
        #[inline(always)]
        fn spread<const G: usize, const N: usize>(
            self,
            x: Self::f32s,
            v: usize,
            index: usize,
        ) -> Self::f32s {
            let words = [x.0, x.1, x.2, x.3];
            let word = |lane| words[word_of::<G, N>(4, v, index, lane) % 4];
            pulp::f32x4(word(0), word(1), word(2), word(3))
        }
    };
}

#[cfg(target_arch = "x86_64")]
impl Lanes for V4 {
    by_instructions!();

    // A function that is called in one place alone would be inlined there: tiles of fourteen heights into one.
    #[inline(never)]
    fn apart(self, work: impl FnMut()) {
        self.vectorize(Call(work, self));
    }

    of_bytes!(
        avx512f, _mm512_set1_epi16, _mm512_cvtps_epi32;
        avx512f, _mm512_and_si512, _mm512_add_epi32;
        avx512bw, _mm512_srli_epi16, _mm512_slli_epi16, _mm512_srai_epi16, _mm512_madd_epi16, _mm512_max_epu8;
        [_mm512_unpacklo_epi8, _mm512_unpackhi_epi8, _mm512_unpacklo_epi16, _mm512_unpackhi_epi16];
        [_mm512_packs_epi32, _mm512_packus_epi16]
    );

    #[inline(always)]
    fn spread<const G: usize, const N: usize>(
        self,
        x: Self::f32s,
        v: usize,
        index: usize,
    ) -> Self::f32s {
        let lanes: [i32; 16] =
            std::array::from_fn(|lane| word_of::<G, N>(16, v, index, lane) as i32);
        cast(self.avx512f._mm512_permutexvar_ps(cast(lanes), cast(x)))
    }

    #[inline(always)]
    fn of_integers(self, x: Self::f32s) -> Self::f32s {
        cast(self.avx512f._mm512_cvtepi32_ps(cast(x)))
    }

    #[inline(always)]
    fn transpose(self, (from, step): (&[f32], usize), (to, pitch): (&mut [f32], usize)) {
        let f = self.avx512f;
        let mut rows = [f._mm512_setzero_si512(); 16];
        // Loops over numbers that are known, or vectors would pass through memory.
        for (i, row) in rows.iter_mut().enumerate() {
            *row = cast(load(self, &from[i * step..][..16]));
        }
        // Of each four rows, within each quarter of a vector, column by column.
        for four in rows.as_chunks_mut::<4>().0 {
            let [a, b, c, d] = *four;
            let [low, high] = [f._mm512_unpacklo_epi32(a, b), f._mm512_unpackhi_epi32(a, b)];
            let [low2, high2] = [f._mm512_unpacklo_epi32(c, d), f._mm512_unpackhi_epi32(c, d)];
            *four = [
                f._mm512_unpacklo_epi64(low, low2),
                f._mm512_unpackhi_epi64(low, low2),
                f._mm512_unpacklo_epi64(high, high2),
                f._mm512_unpackhi_epi64(high, high2),
            ];
        }
        for column in 0..4 {
            let [a, b, c, d] = [0, 4, 8, 12].map(|four| rows[four + column]);
            let even = [
                f._mm512_shuffle_i32x4::<0x88>(a, b),
                f._mm512_shuffle_i32x4::<0x88>(c, d),
            ];
            let odd = [
                f._mm512_shuffle_i32x4::<0xdd>(a, b),
                f._mm512_shuffle_i32x4::<0xdd>(c, d),
            ];
            let columns = [
                f._mm512_shuffle_i32x4::<0x88>(even[0], even[1]),
                f._mm512_shuffle_i32x4::<0x88>(odd[0], odd[1]),
                f._mm512_shuffle_i32x4::<0xdd>(even[0], even[1]),
                f._mm512_shuffle_i32x4::<0xdd>(odd[0], odd[1]),
            ];
            for (quarter, words) in columns.into_iter().enumerate() {
                let to = &mut to[(4 * quarter + column) * pitch..][..16];
                Self::as_mut_simd_f32s(to).0[0] = cast(words);
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
impl Lanes for V3 {
    by_instructions!();

    of_bytes!(
        avx, _mm256_set1_epi16, _mm256_cvtps_epi32;
        avx2, _mm256_and_si256, _mm256_add_epi32;
        avx2, _mm256_srli_epi16, _mm256_slli_epi16, _mm256_srai_epi16, _mm256_madd_epi16, _mm256_max_epu8;
        [_mm256_unpacklo_epi8, _mm256_unpackhi_epi8, _mm256_unpacklo_epi16, _mm256_unpackhi_epi16];
        [_mm256_packs_epi32, _mm256_packus_epi16]
    );

    #[inline(always)]
    fn spread<const G: usize, const N: usize>(
        self,
        x: Self::f32s,
        v: usize,
        index: usize,
    ) -> Self::f32s {
        let lanes: [i32; 8] = std::array::from_fn(|lane| word_of::<G, N>(8, v, index, lane) as i32);
        cast(self.avx2._mm256_permutevar8x32_ps(cast(x), cast(lanes)))
    }
}

#[cfg(target_arch = "aarch64")]
impl Lanes for Neon {
    by_instructions!();

    of_four_lanes!();
}

/// Whether a fused multiply-add is an instruction without any named.
const FUSED: bool = cfg!(any(target_feature = "fma", target_arch = "aarch64"));

impl Lanes for Scalar128b {
    #[inline(never)]
    fn apart(self, mut work: impl FnMut()) {
        work();
    }

    #[inline(always)]
    fn fma(self, a: Self::f32s, b: Self::f32s, c: Self::f32s) -> Self::f32s {
        if FUSED {
            self.mul_add_e_f32s(a, b, c)
        } else {
            // Without the instruction a fused product is a call into software.
            self.add_f32s(self.mul_f32s(a, b), c)
        }
    }

    #[inline(always)]
    fn at_least(self, floor: Self::f32s, x: Self::f32s) -> Self::f32s {
        each(floor, x, |floor, x| if x < floor { floor } else { x })
    }

    #[inline(always)]
    fn at_most(self, ceiling: Self::f32s, x: Self::f32s) -> Self::f32s {
        each(ceiling, x, |most, x| if x > most { most } else { x })
    }

    of_four_lanes!();
}

/// Four numbers, each of two.
#[inline(always)]
fn each(a: pulp::f32x4, b: pulp::f32x4, of: impl Fn(f32, f32) -> f32) -> pulp::f32x4 {
    pulp::f32x4(of(a.0, b.0), of(a.1, b.1), of(a.2, b.2), of(a.3, b.3))
}
