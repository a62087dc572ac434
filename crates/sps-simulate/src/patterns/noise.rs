//! Noise on the plane, each value a function of its place and a seed.

use crate::numeric::{mix, smoothstep};

/// Bits of a place of a lattice.
pub(super) fn hash(x: i32, y: i32, seed: u32) -> u32 {
    let mut bits = (x as u32).wrapping_mul(0x9E37_79B1)
        ^ (y as u32).wrapping_mul(0x85EB_CA77)
        ^ seed.wrapping_mul(0xC2B2_AE3D);
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x2C1B_3C6D);
    bits = (bits ^ (bits >> 12)).wrapping_mul(0x297A_2D39);
    bits ^ (bits >> 15)
}

/// Uniform in `[0, 1)`.
pub(super) fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / (1 << 24) as f32)
}

/// Another seed, of the same seed.
pub(super) fn reseed(seed: u32, purpose: u32) -> u32 {
    hash(purpose as i32, 0x5EED, seed)
}

/// A wave of period 1, from -1 to 1.
pub(super) fn wave(x: f32) -> f32 {
    libm::sinf(std::f32::consts::TAU * (x - x.floor()))
}

pub(super) fn turned([x, y]: [f32; 2], angle: f32) -> [f32; 2] {
    let (sine, cosine) = (libm::sinf(angle), libm::cosf(angle));
    [cosine * x - sine * y, sine * x + cosine * y]
}

const DIAGONAL: f32 = std::f32::consts::FRAC_1_SQRT_2;

const GRADIENTS: [[f32; 2]; 8] = [
    [1.0, 0.0],
    [DIAGONAL, DIAGONAL],
    [0.0, 1.0],
    [-DIAGONAL, DIAGONAL],
    [-1.0, 0.0],
    [-DIAGONAL, -DIAGONAL],
    [0.0, -1.0],
    [DIAGONAL, -DIAGONAL],
];

/// Gradient noise (Perlin, SIGGRAPH 2002) of one feature per unit of length, about -1 to 1.
pub(super) fn gradient([x, y]: [f32; 2], seed: u32) -> f32 {
    let (left, top) = (x.floor(), y.floor());
    let (dx, dy) = (x - left, y - top);
    let corner = |i: i32, j: i32| {
        let bits = hash(left as i32 + i, top as i32 + j, seed);
        let [gx, gy] = GRADIENTS[(bits >> 29) as usize];
        gx * (dx - i as f32) + gy * (dy - j as f32)
    };
    let fade = |t: f32| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(dx), fade(dy));
    let upper = mix(corner(0, 0), corner(1, 0), u);
    let lower = mix(corner(0, 1), corner(1, 1), u);
    1.5 * mix(upper, lower, v)
}

/// Octaves of noise, each twice as fine as the last and `gain` times as strong; about -1 to 1.
pub(super) fn octaves(
    [mut x, mut y]: [f32; 2],
    seed: u32,
    count: u32,
    gain: f32,
    shape: impl Fn(f32) -> f32,
) -> f32 {
    let (mut sum, mut weight, mut weights) = (0.0, 1.0, 0.0);
    for octave in 0..count {
        sum += weight * shape(gradient([x, y], reseed(seed, octave)));
        weights += weight * weight;
        weight *= gain;
        // Turned, or the lattices of the octaves would show.
        (x, y) = (1.6 * x - 1.2 * y, 1.2 * x + 1.6 * y);
    }
    sum / weights.sqrt()
}

/// The points of a lattice moved at random, as seen from a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    /// Distance to the nearest point.
    pub(super) first: f32,
    /// Distance to the next one.
    pub(super) second: f32,
    /// Bits of the nearest point.
    pub(super) bits: u32,
    /// From the nearest point to the place.
    pub(super) offset: [f32; 2],
}

/// Cells (Worley, SIGGRAPH 1996) of one point per unit square, each moved by up to half of `jitter`.
/// Points beyond the neighbouring squares are not looked at.
pub(super) fn nearest(place: [f32; 2], seed: u32, jitter: f32, metric: Metric) -> Nearest {
    let mut found = Nearest {
        first: f32::INFINITY,
        second: f32::INFINITY,
        bits: 0,
        offset: [0.0; 2],
    };
    let (column, row) = (place[0].floor() as i32, place[1].floor() as i32);
    for y in row - 1..=row + 1 {
        for x in column - 1..=column + 1 {
            let bits = hash(x, y, seed);
            let offset = from_point(place, [x, y], bits, jitter);
            let distance = metric.length(offset);
            if distance < found.first {
                found.second = found.first;
                found = Nearest {
                    first: distance,
                    bits,
                    offset,
                    ..found
                };
            } else {
                found.second = found.second.min(distance);
            }
        }
    }
    found
}

/// From a point of the moved lattice to a place.
pub(super) fn from_point(place: [f32; 2], cell: [i32; 2], bits: u32, jitter: f32) -> [f32; 2] {
    let moved = |shift: u32| 0.5 + jitter * (((bits >> shift) & 0xFFFF) as f32 / 65536.0 - 0.5);
    [
        place[0] - cell[0] as f32 - moved(0),
        place[1] - cell[1] as f32 - moved(16),
    ]
}

/// How far is far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Metric {
    Euclid,
    Blocks,
    Chess,
}

impl Metric {
    pub(super) fn length(self, [x, y]: [f32; 2]) -> f32 {
        match self {
            Self::Euclid => (x * x + y * y).sqrt(),
            Self::Blocks => x.abs() + y.abs(),
            Self::Chess => x.abs().max(y.abs()),
        }
    }
}

/// 1 inside an edge and 0 outside, over a width.
pub(super) fn within(edge: f32, width: f32, x: f32) -> f32 {
    1.0 - smoothstep(edge - width, edge + width, x)
}

/// Moves a place by soft noise, by up to about `strength` of a feature.
pub(super) fn warped(place: [f32; 2], seed: u32, strength: f32, length: f32) -> [f32; 2] {
    if strength == 0.0 {
        return place;
    }
    let along = |purpose| {
        let soft = place.map(|v| v / length);
        strength * length * octaves(soft, reseed(seed, purpose), 3, 0.5, |v| v)
    };
    [place[0] + along(11), place[1] + along(12)]
}
