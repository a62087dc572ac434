//! Woven cloth.

use super::super::grid::Grid;
use super::super::material::Weave;
use super::super::numeric::mix;
use super::super::stream::Stream;
use super::{Builder, Layers, fractal};

/// Threads after which a weave repeats.
pub(super) const fn repeat(weave: Weave) -> usize {
    match weave {
        Weave::Plain => 2,
        Weave::Twill | Weave::Basket => 4,
        Weave::Satin => 5,
    }
}

/// Whether warp thread `i` lies over weft thread `j`.
const fn warp_is_up(weave: Weave, i: usize, j: usize) -> bool {
    match weave {
        Weave::Plain => (i + j).is_multiple_of(2),
        Weave::Twill => !(i + j).is_multiple_of(4),
        Weave::Satin => !(i + 2 * j).is_multiple_of(5),
        Weave::Basket => (i / 2 + j / 2).is_multiple_of(2),
    }
}

/// How each thread of one set differs from its neighbours.
struct Threads {
    offset: Vec<f32>,
    tone: Vec<f32>,
    phase: Vec<f32>,
}

impl Threads {
    fn draw(count: usize, disorder: f32, stream: &mut Stream) -> Self {
        let mut draws = |scale: f32| -> Vec<f32> {
            (0..count)
                .map(|_| scale * (2.0 * stream.unit() as f32 - 1.0))
                .collect()
        };
        Self {
            offset: draws(0.22 * disorder),
            tone: draws(0.1 + 0.2 * disorder),
            phase: draws(0.5),
        }
    }
}

/// A thread at one place: the thread's number, and where the place lies across it (-1/2 to 1/2).
struct Crossing {
    warp: usize,
    weft: usize,
    across_warp: f32,
    across_weft: f32,
}

impl Builder<'_> {
    pub(super) fn woven(&mut self, weave: Weave) -> Layers {
        let (n, count) = (self.n, self.count);
        let disorder = 1.0 - self.regularity;
        let warp = Threads::draw(count, disorder, self.stream);
        let weft = Threads::draw(count, disorder, self.stream);
        let (dx, dy) = self.disorder(0.3, 12.0);
        let slubs = Slubs::draw(n, count, disorder, self.stream);
        let mut height = Grid::filled(n, 0.0);
        let mut tone = Grid::filled(n, 0.0);
        for y in 0..n {
            for x in 0..n {
                let at = y * n + x;
                let scale = count as f32 / n as f32;
                let px = (x as f32 + 0.5) * scale + dx.data()[at];
                let py = (y as f32 + 0.5) * scale + dy.data()[at];
                let crossing = Crossing {
                    warp: (px.floor() as i32).rem_euclid(count as i32) as usize,
                    weft: (py.floor() as i32).rem_euclid(count as i32) as usize,
                    across_warp: px - px.floor() - 0.5,
                    across_weft: py - py.floor() - 0.5,
                };
                let (z, t) = at_crossing(weave, count, &crossing, &warp, &weft, slubs.at(at));
                height.data_mut()[at] = z;
                tone.data_mut()[at] = t;
            }
        }
        Layers {
            height,
            tone,
            polish: Grid::filled(n, 1.0),
        }
    }
}

/// Thickness of the threads, which varies along each more than from one to the next.
struct Slubs {
    warp: Grid,
    weft: Grid,
    strength: f32,
}

impl Slubs {
    fn draw(n: usize, count: usize, disorder: f32, stream: &mut Stream) -> Self {
        let mut along = |direction: f64| {
            let slub = fractal::Fractal {
                length: 0.25 / count as f64,
                hurst: 0.8,
                stretch: 12.0,
                direction,
            };
            fractal::field(n, slub, stream)
        };
        Self {
            warp: along(std::f64::consts::FRAC_PI_2),
            weft: along(0.0),
            strength: 0.04 + 0.2 * disorder,
        }
    }

    fn at(&self, at: usize) -> (f32, f32) {
        (
            self.strength * self.warp.data()[at],
            self.strength * self.weft.data()[at],
        )
    }
}

fn at_crossing(
    weave: Weave,
    count: usize,
    c: &Crossing,
    warp: &Threads,
    weft: &Threads,
    slub: (f32, f32),
) -> (f32, f32) {
    let level = |i: usize, j: usize| if warp_is_up(weave, i, j) { 1.0 } else { -1.0 };
    let here = level(c.warp, c.weft);
    let step = |i: usize, across: f32| {
        let by = if across > 0.0 { 1 } else { count - 1 };
        (i + by) % count
    };
    // A thread dips halfway to its neighbouring crossing where the two differ.
    let dip = |next: f32, across: f32| here + 0.5 * (next - here) * (4.0 * across * across);
    let warp_level = dip(level(c.warp, step(c.weft, c.across_weft)), c.across_weft);
    let weft_level = dip(level(step(c.warp, c.across_warp), c.weft), c.across_warp);
    let a = c.across_warp + warp.offset[c.warp];
    let b = c.across_weft + weft.offset[c.weft];
    let over = yarn(a, c.across_weft + warp.phase[c.warp], slub.0);
    let under = yarn(b, c.across_warp + weft.phase[c.weft], slub.1);
    let (z_warp, z_weft) = (over.0 + 0.45 * warp_level, under.0 - 0.45 * weft_level);
    if z_warp > z_weft {
        (
            z_warp,
            0.92 + 0.6 * (warp.tone[c.warp] + over.1) + 0.5 * slub.0,
        )
    } else {
        (
            z_weft,
            0.08 + 0.6 * (weft.tone[c.weft] + under.1) + 0.5 * slub.1,
        )
    }
}

/// Height and tone of a twisted yarn, `across` and `along` in thread widths.
fn yarn(across: f32, along: f32, slub: f32) -> (f32, f32) {
    let width = 0.5 + 0.12 * slub;
    let q = across / width;
    let round = (1.0 - q * q).max(0.0).sqrt();
    let twist = along * 1.6 + across * 1.2;
    let ply = (twist - twist.floor() - 0.5).abs() * 4.0 - 1.0;
    let depth = mix(-0.6, 0.5, round) + slub * 0.3;
    (
        depth + 0.06 * ply * round,
        0.05 * ply - 0.25 * (1.0 - round),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_weave_repeats_and_has_its_share_of_warp() {
        for (weave, share) in [
            (Weave::Plain, 0.5),
            (Weave::Twill, 0.75),
            (Weave::Satin, 0.8),
            (Weave::Basket, 0.5),
        ] {
            let repeat = repeat(weave);
            let up = (0..repeat * repeat)
                .filter(|k| warp_is_up(weave, k / repeat, k % repeat))
                .count();
            assert_eq!(up as f64 / (repeat * repeat) as f64, share, "{weave:?}");
            assert_eq!(
                warp_is_up(weave, 0, 1),
                warp_is_up(weave, repeat, repeat + 1)
            );
        }
    }
}
