//! The sums that tiles go through, along one axis: to values at points and back.

use crate::ops::simd::Lanes;

/// Two of the points of F(4x4, 3x3), 0, ±p, ±q and infinity, with p q = 1: where polynomials are multiplied
/// value by value. Powers of 2, which are common, round twice as much.
const P: f32 = 2.0 / 3.0;
const Q: f32 = 1.5;

/// Inputs of a column or row of a tile to values at the points: `B^T d`.
#[inline(always)]
pub(super) fn of_inputs<S: Lanes>(lanes: S, line: &mut [S::f32s]) {
    let add = |x, y| lanes.add_f32s(x, y);
    let sub = |x, y| lanes.sub_f32s(x, y);
    let fma = |factor, x, y| lanes.fma(lanes.splat_f32s(factor), x, y);
    let mul = |factor, x| lanes.mul_f32s(lanes.splat_f32s(factor), x);
    match *line {
        [a, b, c, d] => line.copy_from_slice(&[sub(a, c), add(b, c), sub(c, b), sub(b, d)]),
        [a, b, c, d, e, f] => {
            const SQUARES: f32 = P * P + Q * Q;
            let (even, odd) = (fma(-Q * Q, c, e), fma(P, d, mul(-Q, b)));
            let (even_q, odd_q) = (fma(-P * P, c, e), fma(Q, d, mul(-P, b)));
            line.copy_from_slice(&[
                fma(-SQUARES, c, add(a, e)),
                add(even, odd),
                sub(even, odd),
                add(even_q, odd_q),
                sub(even_q, odd_q),
                fma(-SQUARES, d, add(b, f)),
            ]);
        }
        _ => {}
    }
}

/// Weights of a column or row to values at the points: `G g`.
#[inline(always)]
pub(super) fn of_weights<S: Lanes>(lanes: S, [a, b, c]: [S::f32s; 3], line: &mut [S::f32s]) {
    let mul = |factor, x| lanes.mul_f32s(lanes.splat_f32s(factor), x);
    // At a point and its opposite, times a factor.
    let at = |point: f32, factor: f32| {
        let squared = lanes.splat_f32s(point * point * factor);
        let even = lanes.fma(squared, c, mul(factor, a));
        let odd = mul(point * factor, b);
        [lanes.add_f32s(even, odd), lanes.sub_f32s(even, odd)]
    };
    if let [_, _, _, _] = line {
        let [one, minus_one] = at(1.0, 0.5);
        line.copy_from_slice(&[a, one, minus_one, c]);
    } else {
        let [p, minus_p] = at(P, 1.0 / (2.0 * P * P * (P * P - Q * Q)));
        let [q, minus_q] = at(Q, 1.0 / (2.0 * Q * Q * (Q * Q - P * P)));
        line.copy_from_slice(&[a, p, minus_p, q, minus_q, c]);
    }
}

/// Values at the points of a column or row to outputs, as many as there are: `A^T m`.
#[inline(always)]
pub(super) fn of_products<S: Lanes>(lanes: S, line: &mut [S::f32s]) {
    let add = |x, y| lanes.add_f32s(x, y);
    let sub = |x, y| lanes.sub_f32s(x, y);
    // A power of each point times what stands there.
    let at = |[p, q]: [f32; 2], x, y| {
        let product = lanes.mul_f32s(lanes.splat_f32s(p), x);
        lanes.fma(lanes.splat_f32s(q), y, product)
    };
    match *line {
        [a, b, c, d] => line[..2].copy_from_slice(&[add(a, add(b, c)), sub(sub(b, c), d)]),
        [a, b, c, d, e, f] => {
            let (even, odd) = (add(b, c), sub(b, c));
            let (even_q, odd_q) = (add(d, e), sub(d, e));
            line[..4].copy_from_slice(&[
                add(a, add(even, even_q)),
                at([P, Q], odd, odd_q),
                at([P * P, Q * Q], even, even_q),
                add(at([P * P * P, Q * Q * Q], odd, odd_q), f),
            ]);
        }
        _ => {}
    }
}

/// Gradients of a column or row of outputs to those at the points: `A y`.
#[inline(always)]
pub(super) fn of_gradients<S: Lanes>(lanes: S, [a, b]: [S::f32s; 2]) -> [S::f32s; 4] {
    let nothing = lanes.splat_f32s(0.0);
    [
        a,
        lanes.add_f32s(a, b),
        lanes.sub_f32s(a, b),
        lanes.sub_f32s(nothing, b),
    ]
}

/// The gradient of the weights of a pair of channels from its sums, by tiles of 2 x 2: `G^T s G`.
pub(super) fn of_sums(sums: &[f32; 16]) -> [[f32; 3]; 3] {
    let fold = |[a, b, c, d]: [f32; 4]| {
        let ends = 0.5 * (b + c);
        [a + ends, 0.5 * (b - c), ends + d]
    };
    let column = |x: usize| fold([sums[x], sums[4 + x], sums[8 + x], sums[12 + x]]);
    let [a, b, c, d] = [0, 1, 2, 3].map(column);
    [0, 1, 2].map(|y| fold([a[y], b[y], c[y], d[y]]))
}
