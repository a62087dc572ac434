//! Named random streams: every draw is fixed by (seed, purpose, index) and moves no other.
//!
//! A stream is ChaCha with eight rounds, the same bits on every machine; generators of the `rand`
//! family take it as it is.
//!
//! ```
//! use sps_base::streams::{RngCore, stream};
//!
//! let first = |seed, index| stream(seed, *b"example: noise of pixels", index).next_u32();
//! assert_eq!(first(1, 0), first(1, 0));
//! assert_ne!(first(1, 0), first(2, 0));
//! assert_ne!(first(1, 0), first(1, 1));
//! ```

pub use rand_chacha::ChaCha8Rng;
pub use rand_chacha::rand_core::{RngCore, SeedableRng};

/// The stream of `seed` and `purpose` that `index` names: the rerun, the split, the step.
///
/// `index` is ChaCha's own stream number, so streams of one purpose never overlap.
pub fn stream(seed: u64, purpose: [u8; 24], index: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::from_seed(key(seed, purpose));
    rng.set_stream(index);
    rng
}

/// The same, for a purpose whose name has any length.
pub fn named_stream(seed: u64, purpose: &str, index: u64) -> ChaCha8Rng {
    stream(seed, name(purpose), index)
}

/// The 24 bytes that stand for a name in [`named_stream`]: two hashes of it, and zeros.
pub fn name(purpose: &str) -> [u8; 24] {
    let mut name = [0; 24];
    name[..8].copy_from_slice(&fnv1a(purpose.bytes()).to_le_bytes());
    // A second hash of the name read backwards: two names share a key only if both agree.
    name[8..16].copy_from_slice(&fnv1a(purpose.bytes().rev()).to_le_bytes());
    name
}

/// FNV-1a, 64 bits.
fn fnv1a(bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The key of [`stream`], for other versions of the generator: the seed's eight bytes, the lowest
/// first, and those of the purpose.
pub fn key(seed: u64, purpose: [u8; 24]) -> [u8; 32] {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8..].copy_from_slice(&purpose);
    key
}

/// The stream whose key is BLAKE3's key derivation in `context` from all `parts`, joined.
///
/// Nothing is put between the parts: let all but one have a fixed length.
#[cfg(feature = "hashed-streams")]
pub fn hashed_stream<const N: usize>(context: &str, parts: [&[u8]; N]) -> ChaCha8Rng {
    let mut hasher = blake3::Hasher::new_derive_key(context);
    for part in parts {
        hasher.update(part);
    }
    ChaCha8Rng::from_seed(hasher.finalize().into())
}

/// Uniform in `0..bound`, from 64 bits; 0 where `bound` is 0.
///
/// The high half of a product; where its low half is one of the few that would favour some values,
/// it is drawn again (Lemire, "Fast random integer generation in an interval", ACM Transactions on
/// Modeling and Computer Simulation 29(1), 2019).
#[inline]
pub fn below(stream: &mut impl RngCore, bound: u64) -> u64 {
    let mut product = u128::from(stream.next_u64()) * u128::from(bound);
    if (product as u64) < bound {
        let threshold = bound.wrapping_neg() % bound;
        while (product as u64) < threshold {
            product = u128::from(stream.next_u64()) * u128::from(bound);
        }
    }
    (product >> 64) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn each_part_of_the_name_changes_the_stream() {
        let mut first = HashSet::new();
        for seed in [0, 1, u64::MAX] {
            for purpose in ["", "order", "init/fRS/generator.value.weight"] {
                for index in [0, 1, u64::MAX] {
                    assert!(first.insert(named_stream(seed, purpose, index).next_u64()));
                }
            }
        }
    }

    /// As drawn from the first version on: results depend on them.
    #[test]
    fn a_named_stream_draws_what_it_always_drew() {
        let mut rng = named_stream(7, "labels", 3);
        let expected = [0x51ee_9add_294a_46e9, 0x9eaf_6d37_713f_b980];
        assert_eq!([rng.next_u64(), rng.next_u64()], expected);
    }

    #[test]
    fn fnv1a_matches_its_published_vectors() {
        // http://www.isthe.com/chongo/tech/comp/fnv/ (test vectors of 64-bit FNV-1a)
        assert_eq!(fnv1a("".bytes()), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv1a("a".bytes()), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(fnv1a("foobar".bytes()), 0x8594_4171_f739_67e8);
    }
}
