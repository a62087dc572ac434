//! Matrix tiles written plainly, as Intel's manual has them: what the processor's own are held to, bit by bit.

use super::super::tiles::{HEIGHT, Tiles, WORDS};
use super::super::words::{Bf16Pair, Bytes, Word};

/// Eight tiles in memory, whose vectors have any number of lanes.
pub(in super::super) struct Software {
    depth: usize,
    lanes: usize,
    tiles: [[[u32; WORDS]; HEIGHT]; 8],
}

impl Software {
    pub(in super::super) fn new(depth: usize, lanes: usize) -> Self {
        Self {
            depth,
            lanes,
            tiles: [[[0; WORDS]; HEIGHT]; 8],
        }
    }
}

impl<W: Word> Tiles<W> for Software {
    fn zero<const TILE: usize>(&mut self) {
        self.tiles[TILE] = Default::default();
    }

    fn load<const TILE: usize>(&mut self, from: &[W], step: usize) {
        let (rows, words) = match TILE {
            4 | 5 => (HEIGHT, self.depth),
            _ => (self.depth, self.lanes),
        };
        let from: &[u32] = bytemuck::cast_slice(from);
        for (i, row) in self.tiles[TILE][..rows].iter_mut().enumerate() {
            row[..words].copy_from_slice(&from[i * step..][..words]);
        }
    }

    fn multiply_add<const SUM: usize, const LEFT: usize, const RIGHT: usize>(&mut self) {
        let (left, right) = (self.tiles[LEFT], self.tiles[RIGHT]);
        for (sums, left) in self.tiles[SUM].iter_mut().zip(&left) {
            for (column, sum) in sums[..self.lanes].iter_mut().enumerate() {
                let pairs = left[..self.depth].iter().zip(&right);
                let pairs = pairs.map(|(left, right)| (*left, right[column]));
                *sum = if W::WHOLE {
                    pairs.fold(*sum, |sum, (left, right)| {
                        let (left, right) = (left.to_le_bytes(), right.to_le_bytes());
                        let products = left.iter().zip(right);
                        let products = products.map(|(l, r)| i32::from(*l) * i32::from(r as i8));
                        sum.wrapping_add(products.sum::<i32>() as u32)
                    })
                } else {
                    let mut halves = [0.0_f32; 2];
                    for (left, right) in pairs {
                        let of = |word: u32| [word << 16, word & 0xffff_0000].map(normal);
                        for ((sum, l), r) in halves.iter_mut().zip(of(left)).zip(of(right)) {
                            *sum = normal(l.mul_add(r, *sum).to_bits());
                        }
                    }
                    let both = normal((halves[0] + halves[1]).to_bits());
                    normal((normal(*sum) + both).to_bits()).to_bits()
                };
            }
        }
    }

    fn store<const TILE: usize>(&mut self, to: &mut [f32], step: usize) {
        for (i, row) in self.tiles[TILE].iter().enumerate() {
            let bits: &[f32] = bytemuck::cast_slice(&row[..self.lanes]);
            to[i * step..][..self.lanes].copy_from_slice(bits);
        }
    }
}

/// A number, 0 where it is too small to be normal.
fn normal(bits: u32) -> f32 {
    let number = f32::from_bits(bits);
    if number.is_subnormal() {
        0.0_f32.copysign(number)
    } else {
        number
    }
}

/// Sums of two products of the same left and right tile.
#[cfg(target_arch = "x86_64")]
fn sums<W: Word>(
    tiles: &mut impl Tiles<W>,
    (left, step): (&[W], usize),
    (right, width): (&[W], usize),
) -> Vec<u32> {
    let mut sums = vec![0.0; HEIGHT * WORDS];
    tiles.zero::<3>();
    tiles.load::<5>(left, step);
    tiles.load::<7>(&right[WORDS..], width);
    tiles.multiply_add::<3, 5, 7>();
    tiles.multiply_add::<3, 5, 7>();
    tiles.store::<3>(&mut sums, WORDS);
    sums.into_iter().map(f32::to_bits).collect()
}

#[cfg(target_arch = "x86_64")]
fn check<W: Word>(amx: super::super::amx::Amx, depth: usize, bits: &[u32]) {
    let words: &[W] = bytemuck::cast_slice(bits);
    let (left, right) = words.split_at(HEIGHT * 20);
    let (left, right) = ((left, 20), (right, 2 * WORDS));
    let expected = sums::<W>(&mut Software::new(depth, WORDS), left, right);
    let found = sums::<W>(&mut amx.configured(depth), left, right);
    for (i, (found, expected)) in found.into_iter().zip(expected).enumerate() {
        let nan = |bits: u32| !W::WHOLE && f32::from_bits(bits).is_nan();
        let same = found == expected || nan(found) && nan(expected);
        assert!(
            same,
            "{depth} deep, number {i}: {found:x} instead of {expected:x}"
        );
    }
}

/// The same bits from the processor's own tiles, of numbers of any size.
#[cfg(target_arch = "x86_64")]
#[test]
fn the_processors_own() {
    let Some(amx) = super::super::amx::Amx::detect() else {
        println!("skipped: this machine has no matrix tiles");
        return;
    };
    let mut state = 1_u64;
    let mut bits = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 32) as u32
    };
    for depth in 1..=WORDS {
        let any: Vec<u32> = (0..HEIGHT * 20 + WORDS * 32).map(|_| bits()).collect();
        // Exponents around 1, so that sums round; and around the smallest, so that they vanish.
        let near = |to: u32| -> Vec<u32> {
            let numbers = any.iter();
            numbers
                .map(|x| x & 0x83ff_83ff | (to << 7 | to << 23))
                .collect()
        };
        for bits in [&any, &near(120), &near(56), &near(1)] {
            check::<Bf16Pair>(amx, depth, bits);
            check::<Bytes>(amx, depth, bits);
        }
    }
}
