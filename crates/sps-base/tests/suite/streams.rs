//! Draws have no favourites.

use sps_base::streams::{ChaCha8Rng, SeedableRng, below, stream};

/// Of 2^64 numbers and this bound, multiples of three would come from two each and the rest from one, if
/// none were drawn again.
#[test]
fn no_residue_is_favoured() {
    const DRAWS: usize = 20_000;
    let mut stream = ChaCha8Rng::from_seed([7; 32]);
    let draws = (0..DRAWS).filter(|_| below(&mut stream, 3 << 62).is_multiple_of(3));
    let share = draws.count() as f64 / DRAWS as f64;
    assert!((share - 1.0 / 3.0).abs() < 0.015, "{share}");
}

#[test]
fn nothing_is_below_one_but_zero() {
    let mut stream = stream(1, [0; 24], 0);
    for bound in [0, 1] {
        assert_eq!(below(&mut stream, bound), 0);
    }
}
