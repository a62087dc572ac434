//! Streams differ by every part of their name, and draws have no favourites.

use sps_base::streams::{ChaCha8Rng, RngCore, SeedableRng, below, below_u32, stream};

#[test]
fn each_part_of_the_name_changes_the_stream() {
    let first = |seed, purpose, index| stream(seed, [purpose; 24], index).next_u64();
    let base = first(1, 0, 0);
    assert_eq!(base, first(1, 0, 0));
    for other in [first(2, 0, 0), first(1, 1, 0), first(1, 0, 1)] {
        assert_ne!(base, other);
    }
}

/// Of 2^32 (2^64) numbers and this bound, multiples of three would come from two each and the
/// rest from one, if none were drawn again.
#[test]
fn no_residue_is_favoured() {
    const DRAWS: usize = 20_000;
    let mut stream = ChaCha8Rng::from_seed([7; 32]);
    let mut share = |multiple: &mut dyn FnMut(&mut ChaCha8Rng) -> bool| {
        let found = (0..DRAWS).filter(|_| multiple(&mut stream)).count();
        assert!(
            (found as f64 / DRAWS as f64 - 1.0 / 3.0).abs() < 0.015,
            "{found}"
        );
    };
    share(&mut |stream| below_u32(stream, 3 << 30).is_multiple_of(3));
    share(&mut |stream| below(stream, 3 << 62).is_multiple_of(3));
}

#[test]
fn nothing_is_below_one_but_zero() {
    let mut stream = stream(1, [0; 24], 0);
    for bound in [0, 1] {
        assert_eq!(below(&mut stream, bound), 0);
        assert_eq!(below_u32(&mut stream, bound as u32), 0);
    }
}
