//! Instructions that pulp does not offer: AVX512-BF16, AVX512-VNNI, and prefetching.
//!
//! The only unsafe code of this crate beside `amx`.

#![allow(unsafe_code)]

use super::words::Word;

/// Words of a cache line.
const LINE: usize = 16;

/// Has memory brought near, as far as the processor cares to: into the first-level cache if `now`,
/// else into the second.
#[inline(always)]
pub(super) fn prefetch<W: Word>(memory: &[W], now: bool) {
    #[cfg(target_arch = "x86_64")]
    for line in memory.chunks(LINE) {
        use std::arch::x86_64::{_MM_HINT_T0, _MM_HINT_T1, _mm_prefetch};
        // SAFETY: every x86-64 processor has the instruction, which reads nothing that a program
        // can see.
        unsafe {
            if now {
                _mm_prefetch::<_MM_HINT_T0>(line.as_ptr().cast());
            } else {
                _mm_prefetch::<_MM_HINT_T1>(line.as_ptr().cast());
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (memory, now);
}

/// Arithmetic on words by instructions beyond AVX-512's own. All of it rests on one fact: a `Native`
/// exists only where the processor was found to have the instructions.
#[cfg(target_arch = "x86_64")]
macro_rules! native {
    ($feature:tt, $word:ty) => {
        use std::arch::x86_64::*;

        use pulp::x86::V4;
        use pulp::{NullaryFnOnce, Simd, cast, f32x16};

        use crate::ops::words::{Arithmetic, WordKernel};

        /// A processor with AVX-512 and the instructions of this module.
        #[derive(Debug, Clone, Copy)]
        pub(crate) struct Native(V4);

        impl Native {
            /// `None` where the processor lacks the instructions.
            #[inline]
            pub(crate) fn detect(simd: V4) -> Option<Self> {
                std::arch::is_x86_feature_detected!($feature).then_some(Self(simd))
            }

            /// Runs a kernel compiled with the instructions.
            #[inline]
            pub(crate) fn run<K: WordKernel<$word>>(self, kernel: K) -> K::Output {
                // SAFETY: `self` says that the processor has the instructions, and `V4` the rest.
                unsafe { with_instructions(Call(kernel, self)) }
            }
        }

        struct Call<K>(K, Native);

        impl<K: WordKernel<$word>> NullaryFnOnce for Call<K> {
            type Output = K::Output;

            #[inline(always)]
            fn call(self) -> K::Output {
                self.0.run(self.1.0, self.1)
            }
        }

        #[inline(never)]
        #[target_feature(enable = $feature)]
        #[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl")]
        #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
        fn with_instructions<F: NullaryFnOnce>(work: F) -> F::Output {
            work.call()
        }
    };
}

/// What [`Arithmetic`](super::words::Arithmetic) says of every `Native`.
#[cfg(target_arch = "x86_64")]
macro_rules! beside_tiles {
    () => {
        const BESIDE_TILES: bool = true;

        #[inline(always)]
        fn apart(self, lanes: V4, work: impl FnMut()) {
            // SAFETY: `self` says that the processor has the instructions, and `V4` the rest.
            unsafe { with_instructions(crate::ops::simd::Call(work, lanes)) }
        }

        // A row shorter than its vectors is no longer than a vector of words.
        #[inline(always)]
        fn load_part<const NV: usize>(self, lanes: V4, from: &[Self::Word]) -> [f32x16; NV] {
            let words = [lanes.partial_load_f32s(bytemuck::cast_slice(from))];
            self.load(lanes, bytemuck::cast_slice(&words))
        }

        #[inline(always)]
        fn store_part<const NV: usize>(
            self,
            lanes: V4,
            values: [f32x16; NV],
            to: &mut [Self::Word],
        ) {
            let mut words = [lanes.splat_f32s(0.0)];
            self.store(lanes, values, bytemuck::cast_slice_mut(&mut words));
            lanes.partial_store_f32s(bytemuck::cast_slice_mut(to), words[0]);
        }
    };
}

#[cfg(target_arch = "x86_64")]
pub(super) mod bf16 {
    //! AVX512-BF16.

    use crate::ops::words::Bf16Pair;

    native!("avx512bf16", Bf16Pair);

    /// The same bits as 32 numbers of bf16.
    #[inline(always)]
    fn pairs(x: f32x16) -> __m512bh {
        // SAFETY: both are 512 bits of which every pattern is a value.
        unsafe { std::mem::transmute::<f32x16, __m512bh>(x) }
    }

    impl Arithmetic<V4> for Native {
        type Word = Bf16Pair;

        beside_tiles!();

        #[inline(always)]
        fn multiply_add(self, _: V4, x: f32x16, y: f32x16, sum: f32x16) -> f32x16 {
            // SAFETY: `self` says that the processor has AVX512-BF16.
            cast(unsafe { _mm512_dpbf16_ps(cast(sum), pairs(x), pairs(y)) })
        }

        #[inline(always)]
        fn load<const NV: usize>(self, lanes: V4, from: &[Bf16Pair]) -> [f32x16; NV] {
            let (from, _) = from.as_chunks::<8>();
            let mut all = [lanes.splat_f32s(0.0); NV];
            // No closure: one that is not inlined is compiled without the instructions. Over a number of
            // vectors that is known, or they would pass through memory.
            for (numbers, words) in all.iter_mut().zip(&from[..NV]) {
                // SAFETY: `V4` stands for AVX-512F.
                *numbers =
                    cast(unsafe { _mm512_slli_epi32::<16>(_mm512_cvtepu16_epi32(cast(*words))) });
            }
            all
        }

        #[inline(always)]
        fn store<const NV: usize>(self, _: V4, values: [f32x16; NV], to: &mut [Bf16Pair]) {
            for (values, to) in values.chunks(2).zip(to.chunks_mut(16)) {
                let first = cast(values[0]);
                // SAFETY: `self` says that the processor has AVX512-BF16, and the types are the same
                // bits.
                unsafe {
                    if let ([_, second], Some(to)) = (values, to.first_chunk_mut::<16>()) {
                        let words = _mm512_cvtne2ps_pbh(cast(*second), first);
                        *to = std::mem::transmute::<__m512bh, [Bf16Pair; 16]>(words);
                    } else if let Some(to) = to.first_chunk_mut::<8>() {
                        let words = _mm512_cvtneps_pbh(first);
                        *to = std::mem::transmute::<__m256bh, [Bf16Pair; 8]>(words);
                    }
                }
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod vnni {
    //! AVX512-VNNI.

    use crate::ops::words::Bytes;

    native!("avx512vnni", Bytes);

    impl Arithmetic<V4> for Native {
        type Word = Bytes;

        const CUTS: bool = true;

        beside_tiles!();

        #[inline(always)]
        fn multiply_add(self, _: V4, x: f32x16, y: f32x16, sum: f32x16) -> f32x16 {
            // SAFETY: `self` says that the processor has AVX512-VNNI.
            cast(unsafe { _mm512_dpbusd_epi32(cast(sum), cast(x), cast(y)) })
        }

        #[inline(always)]
        fn load<const NV: usize>(self, lanes: V4, from: &[Bytes]) -> [f32x16; NV] {
            let (from, _) = from.as_chunks::<4>();
            let mut all = [lanes.splat_f32s(0.0); NV];
            // No closure: one that is not inlined is compiled without the instructions. Over a number of
            // vectors that is known, or they would pass through memory.
            for (numbers, words) in all.iter_mut().zip(&from[..NV]) {
                // SAFETY: `V4` stands for AVX-512F.
                *numbers = cast(unsafe { _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(cast(*words))) });
            }
            all
        }

        #[inline(always)]
        fn store<const NV: usize>(self, _: V4, values: [f32x16; NV], to: &mut [Bytes]) {
            if let (&[first, second], Some(to)) = (&values[..], to.first_chunk_mut::<8>()) {
                // SAFETY: `V4` stands for AVX-512BW.
                *to = cast(unsafe {
                    let (first, second) = (cast(first), cast(second));
                    let halves =
                        _mm512_packs_epi32(_mm512_cvtps_epi32(first), _mm512_cvtps_epi32(second));
                    let bytes = _mm512_packus_epi16(halves, halves);
                    // Both instructions keep to lanes of four words.
                    let order = _mm512_castsi256_si512(_mm256_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13));
                    _mm512_castsi512_si256(_mm512_permutexvar_epi32(order, bytes))
                });
                return;
            }
            let (to, _) = to.as_chunks_mut::<4>();
            for (values, to) in values.into_iter().zip(&mut to[..NV]) {
                // SAFETY: `V4` stands for AVX-512F.
                *to = cast(unsafe {
                    let whole = _mm512_cvtps_epi32(cast(values));
                    _mm512_cvtusepi32_epi8(_mm512_max_epi32(whole, _mm512_setzero_si512()))
                });
            }
        }
    }
}
