//! Matrix tiles of Intel's processors (AMX), for which Rust has no intrinsics yet.
//!
//! Unsafe code rests on two facts. An [`Amx`] exists only where the processor has the instructions, the system saves
//! their registers, and it has let this process use them. Compiled code never touches a tile register by itself, so that
//! what one instruction leaves in it is there for the next, as long as no other [`Configured`] is alive on the thread.

#![allow(unsafe_code)]

use std::arch::asm;
use std::arch::x86_64::{__cpuid, __cpuid_count, _xgetbv};
use std::marker::PhantomData;
use std::sync::OnceLock;

use pulp::x86::V4;

use super::native::{bf16, vnni};
use super::tiles::{HEIGHT, Tiles, WORDS};
use super::words::Word;

/// A processor with matrix tiles for bf16 and bytes, and AVX-512.
#[derive(Debug, Clone, Copy)]
pub struct Amx(V4);

impl Amx {
    /// `None` where the processor or the system has no tiles, or does not let this process use them; or the processor
    /// has no vectors for the same numbers, which all with tiles have.
    pub(super) fn detect() -> Option<Self> {
        static FOUND: OnceLock<bool> = OnceLock::new();
        let simd = V4::try_new()?;
        bf16::Native::detect(simd)?;
        vnni::Native::detect(simd)?;
        FOUND.get_or_init(permitted).then_some(Self(simd))
    }

    /// The vectors beside the tiles.
    pub(super) fn vectors(self) -> V4 {
        self.0
    }

    /// The tiles of this thread, for left operands of so many words in a row.
    // That there is one says that there are tiles.
    #[allow(clippy::unused_self)]
    pub(super) fn configured(self, depth: usize) -> Configured {
        assert!((1..=WORDS).contains(&depth), "{depth}");
        let mut shapes = Shapes([0; 64]);
        shapes.0[0] = 1;
        for tile in 0..8 {
            let (rows, words) = match tile {
                0..4 => (HEIGHT, WORDS),
                4..6 => (HEIGHT, depth),
                _ => (depth, WORDS),
            };
            shapes.0[16 + 2 * tile] = (4 * words) as u8;
            shapes.0[48 + tile] = rows as u8;
        }
        // SAFETY: the instruction is there, and the shapes are of at most 16 rows of 64 bytes.
        unsafe { asm!("ldtilecfg [{}]", in(reg) &raw const shapes, options(nostack, readonly)) };
        Configured {
            depth,
            thread: PhantomData,
        }
    }
}

#[repr(C, align(64))]
struct Shapes([u8; 64]);

/// Whether this process may use tiles; asks Linux for them.
fn permitted() -> bool {
    let found = __cpuid(0).eax >= 7 && {
        let (features, state) = (__cpuid_count(7, 0).edx, __cpuid(1).ecx);
        let tiles = [22, 24, 25].iter().all(|bit| features >> bit & 1 == 1);
        // Whether the instruction that reads the enabled state is.
        tiles && state >> 27 & 1 == 1
    };
    // SAFETY: the instruction is enabled.
    let enabled = found && unsafe { _xgetbv(0) } >> 17 & 3 == 3;
    enabled && ask()
}

/// Asks the system for the tiles' state, once for the process.
#[cfg(target_os = "linux")]
fn ask() -> bool {
    const ARCH_PRCTL: i64 = 158;
    const REQUEST: i64 = 0x1023;
    const TILE_DATA: i64 = 18;
    let outcome: i64;
    // SAFETY: the call changes nothing but what this process may use.
    unsafe {
        asm!(
            "syscall",
            inlateout("rax") ARCH_PRCTL => outcome,
            in("rdi") REQUEST,
            in("rsi") TILE_DATA,
            out("rcx") _,
            out("r11") _,
            options(nostack),
        );
    }
    outcome == 0
}

#[cfg(not(target_os = "linux"))]
fn ask() -> bool {
    false
}

/// The tiles of this thread in their shapes, until it is dropped.
pub(super) struct Configured {
    depth: usize,
    /// Registers are a thread's own.
    thread: PhantomData<*mut ()>,
}

impl Drop for Configured {
    fn drop(&mut self) {
        // SAFETY: the instruction is there, as there are tiles.
        unsafe { asm!("tilerelease", options(nostack, nomem)) };
    }
}

impl<W: Word> Tiles<W> for Configured {
    #[inline(always)]
    fn zero<const TILE: usize>(&mut self) {
        // SAFETY: tiles are configured.
        unsafe { asm!("tilezero tmm{t}", t = const TILE, options(nostack, nomem)) };
    }

    #[inline(always)]
    fn load<const TILE: usize>(&mut self, from: &[W], step: usize) {
        let (rows, words) = match TILE {
            4 | 5 => (HEIGHT, self.depth),
            _ => (self.depth, WORDS),
        };
        assert!((rows - 1) * step + words <= from.len());
        // SAFETY: all rows lie within the slice.
        unsafe {
            asm!(
                "tileloadd tmm{t}, [{from} + {step}]",
                t = const TILE,
                from = in(reg) from.as_ptr(),
                step = in(reg) 4 * step,
                options(nostack, readonly),
            );
        }
    }

    #[inline(always)]
    fn multiply_add<const SUM: usize, const LEFT: usize, const RIGHT: usize>(&mut self) {
        // SAFETY: tiles are configured in shapes that fit each other.
        unsafe {
            if W::WHOLE {
                asm!(
                    "tdpbusd tmm{sum}, tmm{left}, tmm{right}",
                    sum = const SUM, left = const LEFT, right = const RIGHT, options(nostack, nomem),
                );
            } else {
                asm!(
                    "tdpbf16ps tmm{sum}, tmm{left}, tmm{right}",
                    sum = const SUM, left = const LEFT, right = const RIGHT, options(nostack, nomem),
                );
            }
        }
    }

    #[inline(always)]
    fn store<const TILE: usize>(&mut self, to: &mut [f32], step: usize) {
        assert!((HEIGHT - 1) * step + WORDS <= to.len());
        // SAFETY: all rows lie within the slice.
        unsafe {
            asm!(
                "tilestored [{to} + {step}], tmm{t}",
                t = const TILE,
                to = in(reg) to.as_mut_ptr(),
                step = in(reg) 4 * step,
                options(nostack),
            );
        }
    }
}
