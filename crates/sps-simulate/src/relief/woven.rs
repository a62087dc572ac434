//! Woven cloth.

use super::super::numeric::mix;
use super::super::stream::Stream;
use super::{Builder, Fractal, Layers};

/// How warp and weft cross.
#[derive(Clone, Copy, Debug)]
pub(super) enum Weave {
    /// Over one, under one.
    Plain,
    /// Over three, under one, shifted by one each row: diagonal lines.
    Twill,
    /// Over four, under one, scattered: long floats.
    Satin,
    /// Plain with threads in pairs.
    Basket,
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
            let draw = |_| scale * (2.0 * stream.unit() as f32 - 1.0);
            (0..count).map(draw).collect()
        };
        Self {
            offset: draws(0.22 * disorder),
            tone: draws(0.1 + 0.2 * disorder),
            phase: draws(0.5),
        }
    }
}

impl Builder<'_> {
    pub(super) fn woven(&mut self, weave: Weave) -> Layers {
        let count = self.count;
        let disorder = 1.0 - self.regularity;
        let cloth = Cloth {
            weave,
            warp: Threads::draw(count, disorder, self.stream),
            weft: Threads::draw(count, disorder, self.stream),
        };
        let (dx, dy) = self.disorder(0.3, 12.0);
        // Thickness of the threads, which varies along each more than from one to the next.
        let mut slubs = |direction| {
            let slub = Fractal::isotropic(0.25 / count as f64, 0.8);
            let mut slubs = self.fields(slub.stretched(12.0, direction)).0;
            slubs.map_in_place(|v| (0.04 + 0.2 * disorder) * v);
            slubs
        };
        let (warp, weft) = (slubs(std::f64::consts::FRAC_PI_2), slubs(0.0));
        Layers::of_texels(self.n, |at, u, v| {
            let (x, y) = (u * count as f32 + dx[at], v * count as f32 + dy[at]);
            let (height, tone) = cloth.at(x, y, (warp[at], weft[at]));
            (height, tone, 1.0)
        })
    }
}

struct Cloth {
    weave: Weave,
    warp: Threads,
    weft: Threads,
}

impl Cloth {
    /// Height and tone at a place in units of the pitch. `slub` is by how much warp and weft are
    /// thicker there.
    fn at(&self, x: f32, y: f32, slub: (f32, f32)) -> (f32, f32) {
        let (warp, weft, count) = (&self.warp, &self.weft, self.warp.offset.len());
        let thread = |t: f32| (t.floor() as i32).rem_euclid(count as i32) as usize;
        let (i, j) = (thread(x), thread(y));
        // Across its thread, -1/2 to 1/2.
        let (across_warp, across_weft) = (x - x.floor() - 0.5, y - y.floor() - 0.5);
        let up = |i, j| warp_is_up(self.weave, i, j);
        let level = |i, j| if up(i, j) { 1.0 } else { -1.0 };
        let here = level(i, j);
        let step = |i: usize, across: f32| {
            let by = if across > 0.0 { 1 } else { count - 1 };
            (i + by) % count
        };
        // A thread dips halfway to its neighbouring crossing where the two differ.
        let dip = |next: f32, across: f32| here + 0.5 * (next - here) * (4.0 * across * across);
        let warp_level = dip(level(i, step(j, across_weft)), across_weft);
        let weft_level = dip(level(step(i, across_warp), j), across_warp);
        let (across, along) = (across_warp + warp.offset[i], across_weft + warp.phase[i]);
        let over = yarn(across, along, slub.0);
        let (across, along) = (across_weft + weft.offset[j], across_warp + weft.phase[j]);
        let under = yarn(across, along, slub.1);
        let (z_warp, z_weft) = (over.0 + 0.45 * warp_level, under.0 - 0.45 * weft_level);
        if z_warp > z_weft {
            (z_warp, 0.92 + 0.6 * (warp.tone[i] + over.1) + 0.5 * slub.0)
        } else {
            (z_weft, 0.08 + 0.6 * (weft.tone[j] + under.1) + 0.5 * slub.1)
        }
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
    let tone = 0.05 * ply - 0.25 * (1.0 - round);
    (depth + 0.06 * ply * round, tone)
}

#[cfg(test)]
mod tests {
    use super::super::Structure;
    use super::*;

    #[test]
    fn each_weave_repeats_and_has_its_share_of_warp() {
        for (name, weave, share) in [
            ("woven plain", Weave::Plain, 0.5),
            ("woven twill", Weave::Twill, 0.75),
            ("woven satin", Weave::Satin, 0.8),
            ("woven basket", Weave::Basket, 0.5),
        ] {
            let repeat = Structure::named(name).row().threads;
            let crossings = 0..repeat * repeat;
            let up = crossings.filter(|k| warp_is_up(weave, k / repeat, k % repeat));
            let up = up.count() as f64;
            assert_eq!(up / (repeat * repeat) as f64, share, "{weave:?}");
            let next = warp_is_up(weave, repeat, repeat + 1);
            assert_eq!(warp_is_up(weave, 0, 1), next, "{weave:?}");
        }
    }
}
