//! Code written out for each row of a tile.

/// Repeats a block for each row of a tile of height `$h`.
///
/// Written out rather than looped: an index that is not a constant would put the sums into
/// memory. Decided by a constant block, or each height would be compiled with the rows of the tallest.
macro_rules! each_row {
    ($h:ident, $i:ident, $body:block) => {
        each_row!(@ $h $i $body 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16)
    };
    (@ $h:ident $i:ident $body:block $($row:literal)*) => {
        $(if const { $row < $h } {
            let $i = $row;
            $body
        })*
    };
}

/// Evaluates an expression with the constant `$h` set to a tile's height, from 1 to the tallest; for
/// heights beyond it nothing is compiled.
macro_rules! with_height {
    ($height:expr, $s:ident, $h:ident => $body:expr) => {
        with_height!(@ $height, $s, $h, $body, 1 2 3 4 5 6 7 8 9 10 11 12 13 14)
    };
    (@ $height:expr, $s:ident, $h:ident, $body:expr, $($literal:literal)*) => {
        {
            let height = $height;
            $(if const { $literal <= tallest::<$s>() } && height == $literal {
                const $h: usize = $literal;
                $body
            } else)* {}
        }
    };
}

use super::simd::Lanes;

/// The tallest tile, two vectors wide, whose sums stay in registers.
#[inline(always)]
pub(super) const fn tallest<S: Lanes>() -> usize {
    if S::REGISTER_COUNT >= 32 { 14 } else { 6 }
}

/// Cuts rows into tiles of nearly one height, at most `tallest`: first row and height of each.
pub(super) fn tiles(
    start: usize,
    end: usize,
    tallest: usize,
) -> impl Iterator<Item = (usize, usize)> {
    let rows = end - start;
    let count = rows.div_ceil(tallest);
    (0..count).map(move |i| {
        let (from, to) = (rows * i / count, rows * (i + 1) / count);
        (start + from, to - from)
    })
}
