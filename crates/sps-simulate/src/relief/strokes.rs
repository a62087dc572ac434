//! Fibres, hairs and loops, stamped into a height map.

use super::super::numeric::mix;
use super::Layers;
use super::fractal::unit;

/// A bent round fibre; lengths are in units of the period.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stroke {
    pub(super) x: f32,
    pub(super) y: f32,
    /// Radians from the x axis, at its start.
    pub(super) direction: f32,
    /// Radians that it turns from start to end.
    pub(super) turn: f32,
    pub(super) length: f32,
    pub(super) radius: f32,
    /// Height of its start, of its middle and of its end, in any unit.
    pub(super) heights: [f32; 3],
    /// Height that its round section adds.
    pub(super) bulge: f32,
    /// Tone of its start and of its end.
    pub(super) tones: [f32; 2],
}

impl Layers {
    /// Stamps discs along the fibre, keeping what is highest.
    pub(super) fn draw(&mut self, stroke: &Stroke) {
        let n = self.height.n() as f32;
        let radius = (stroke.radius * n).max(0.8);
        let steps = ((stroke.length * n / (0.6 * radius)).ceil() as usize).clamp(2, 512);
        let advance = stroke.length * n / steps as f32;
        let mut direction = unit(f64::from(stroke.direction));
        let (c, s) = unit(f64::from(stroke.turn) / steps as f64);
        let (mut x, mut y) = (stroke.x * n, stroke.y * n);
        for step in 0..=steps {
            let t = step as f32 / steps as f32;
            let tone = mix(stroke.tones[0], stroke.tones[1], t);
            let base = height_along(stroke.heights, t);
            self.stamp((x, y), radius, base, stroke.bulge, tone);
            x += advance * direction.0;
            y += advance * direction.1;
            direction = (
                direction.0 * c - direction.1 * s,
                direction.0 * s + direction.1 * c,
            );
        }
    }

    fn stamp(&mut self, centre: (f32, f32), radius: f32, base: f32, bulge: f32, tone: f32) {
        let n = self.height.n() as i32;
        let inverse = 1.0 / (radius * radius);
        let reach = |c: f32| (c - radius).floor() as i32..=(c + radius) as i32;
        for y in reach(centre.1) {
            let dy = y as f32 + 0.5 - centre.1;
            let row = (y.rem_euclid(n) * n) as usize;
            for x in reach(centre.0) {
                let dx = x as f32 + 0.5 - centre.0;
                let inside = 1.0 - (dx * dx + dy * dy) * inverse;
                if inside <= 0.0 {
                    continue;
                }
                let at = row + x.rem_euclid(n) as usize;
                let z = base + bulge * inside.sqrt();
                if z > self.height[at] {
                    self.height.data_mut()[at] = z;
                    self.tone.data_mut()[at] = tone;
                }
            }
        }
    }
}

/// A parabola through the three heights at 0, 1/2 and 1.
fn height_along([start, middle, end]: [f32; 3], t: f32) -> f32 {
    let a = 2.0 * (start - 2.0 * middle + end);
    let b = end - start - a;
    start + (a * t + b) * t
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;

    #[test]
    fn a_parabola_meets_its_three_heights() {
        let heights = [0.3, 1.0, -0.2];
        for (t, expected) in [(0.0, 0.3), (0.5, 1.0), (1.0, -0.2)] {
            assert!((height_along(heights, t) - expected).abs() < 1e-6);
        }
    }

    #[test]
    fn the_higher_fibre_wins_and_edges_wrap() {
        let mut layers = Layers::new(Grid::filled(32, 0.0), Grid::filled(32, 0.5), 1.0);
        let mut stroke = Stroke {
            x: 0.9,
            y: 0.5,
            direction: 0.0,
            turn: 0.0,
            length: 0.3,
            radius: 0.06,
            heights: [2.0; 3],
            bulge: 0.1,
            tones: [1.0; 2],
        };
        layers.draw(&stroke);
        stroke.heights = [1.0; 3];
        stroke.tones = [0.0; 2];
        layers.draw(&stroke);
        assert_eq!(layers.tone.row(16)[31], 1.0);
        assert_eq!(layers.tone.row(16)[1], 1.0);
        assert_eq!(layers.tone.row(0)[31], 0.5);
    }
}
