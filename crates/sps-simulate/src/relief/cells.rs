//! Cells around scattered points (Worley, SIGGRAPH 1996).

use super::super::stream::Stream;

/// Points on a jittered periodic lattice.
pub(super) struct Cells {
    count: usize,
    points: Vec<(f32, f32)>,
}

/// What lies at a place; distances are in units of the lattice pitch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Nearest {
    /// Which point is nearest.
    pub(super) id: usize,
    /// Distance to it.
    pub(super) first: f32,
    /// Distance to the next.
    pub(super) second: f32,
}

impl Cells {
    /// `jitter` is 0 for a square lattice, 1 for points anywhere in their squares.
    pub(super) fn new(count: usize, jitter: f32, stream: &mut Stream) -> Self {
        let mut place = || 0.5 + jitter * (stream.unit() as f32 - 0.5);
        let points = (0..count * count).map(|_| (place(), place())).collect();
        Self { count, points }
    }

    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// What lies at `(x, y)` in units of the pitch; wraps.
    pub(super) fn at(&self, x: f32, y: f32) -> Nearest {
        let (cx, cy) = (x.floor(), y.floor());
        let wrap = |i: i32| i.rem_euclid(self.count as i32) as usize;
        let columns: [usize; 3] = std::array::from_fn(|i| wrap(cx as i32 + i as i32 - 1));
        let (mut best, mut next, mut id) = (f32::MAX, f32::MAX, 0);
        for j in 0..3 {
            let row = wrap(cy as i32 + j - 1) * self.count;
            let fy = cy + (j - 1) as f32 - y;
            for (i, &column) in columns.iter().enumerate() {
                let (px, py) = self.points[row + column];
                let dx = cx + (i as f32 - 1.0) + px - x;
                let dy = fy + py;
                let d = dx * dx + dy * dy;
                if d < best {
                    next = best;
                    best = d;
                    id = row + column;
                } else if d < next {
                    next = d;
                }
            }
        }
        Nearest {
            id,
            first: best.sqrt(),
            second: next.sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::stream::Purpose;
    use super::*;

    #[test]
    fn on_a_lattice_the_nearest_is_the_squares_own_point() {
        let cells = Cells::new(4, 0.0, &mut Stream::new(0, Purpose::RELIEF, &[]));
        let found = cells.at(1.5, 2.75);
        assert_eq!((found.id, found.first), (9, 0.25));
        assert!((found.second - 0.75).abs() < 1e-6);
        assert_eq!(cells.at(-2.5, 6.75), found);
    }
}
