//! Named random streams.
//!
//! Every draw of this crate comes from a ChaCha stream keyed by (seed, purpose, index), so that a
//! draw added in one place moves none elsewhere.

use sps_base::streams::{self, ChaCha8Rng};

/// The stream for one purpose and index.
pub(crate) fn stream(seed: u64, purpose: &str, index: u64) -> ChaCha8Rng {
    streams::stream(seed, name(purpose), index)
}

/// The same stream for packages that still take rand 0.8 (linfa).
#[cfg(feature = "clusters")]
pub(crate) fn stream_for_linfa(seed: u64, purpose: &str, index: u64) -> rand_chacha_03::ChaCha8Rng {
    use rand_chacha_03::rand_core::SeedableRng as _;
    let mut rng = rand_chacha_03::ChaCha8Rng::from_seed(streams::key(seed, name(purpose)));
    rng.set_stream(index);
    rng
}

fn name(purpose: &str) -> [u8; 24] {
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngCore;
    use std::collections::HashSet;

    #[test]
    fn each_part_of_the_name_changes_the_stream() {
        let mut first = HashSet::new();
        for seed in [0, 1, u64::MAX] {
            for purpose in ["", "order", "init/fRS/generator.value.weight"] {
                for index in [0, 1, u64::MAX] {
                    assert!(first.insert(stream(seed, purpose, index).next_u64()));
                }
            }
        }
    }

    #[cfg(feature = "clusters")]
    #[test]
    fn a_stream_repeats_and_is_the_same_for_both_versions_of_rand() {
        use rand_chacha_03::rand_core::RngCore as _;
        let mut new = stream(7, "labels", 3);
        let mut again = stream(7, "labels", 3);
        let mut old = stream_for_linfa(7, "labels", 3);
        for _ in 0..100 {
            let draw = new.next_u64();
            assert_eq!(draw, again.next_u64());
            assert_eq!(draw, old.next_u64());
        }
    }

    /// As drawn before this crate shared its streams with others: a result depends on them.
    #[test]
    fn a_stream_draws_what_it_always_drew() {
        let mut rng = stream(7, "labels", 3);
        assert_eq!(
            [rng.next_u64(), rng.next_u64()],
            [0x51ee_9add_294a_46e9, 0x9eaf_6d37_713f_b980]
        );
    }

    #[test]
    fn fnv1a_matches_its_published_vectors() {
        // http://www.isthe.com/chongo/tech/comp/fnv/ (test vectors of 64-bit FNV-1a)
        assert_eq!(fnv1a("".bytes()), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv1a("a".bytes()), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(fnv1a("foobar".bytes()), 0x8594_4171_f739_67e8);
    }
}
