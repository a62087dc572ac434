//! How the relief hides the dome and the light from itself.

use super::super::geometry::{LIGHT_AZIMUTH_DEG, TILE_MM};
use super::super::grid::Grid;

/// Distances at which a ray looks at the relief, in mm.
const AMBIENT_STEPS: [f64; 6] = [0.125, 0.25, 0.5, 0.875, 1.5, 2.5];
const LIGHT_STEPS: [f64; 9] = [0.125, 0.25, 0.375, 0.5, 0.75, 1.0, 1.5, 2.25, 3.25];

/// The cosine-weighted share of the hemisphere above each texel that the relief leaves open, from
/// the horizons in eight directions: `1 / (1 + t^2)` for a horizon of slope `t`.
pub(super) fn ambient_occlusion(height: &Grid) -> Vec<f32> {
    const DIRECTIONS: u32 = 8;
    let mut open = vec![0.0; height.data().len()];
    for k in 0..DIRECTIONS {
        let angle = std::f64::consts::TAU * f64::from(k) / f64::from(DIRECTIONS);
        let horizon = horizons(height, angle, &AMBIENT_STEPS, 0.0);
        for (sum, t) in open.iter_mut().zip(horizon) {
            *sum += 1.0 / ((1.0 + t * t) * DIRECTIONS as f32);
        }
    }
    open
}

/// The slope of the horizon towards the light at each texel.
///
/// The sample rolls in the plane that the light nearly lies in, so the light's azimuth on the
/// surface hardly moves while it stands low enough to cast shadows; one horizon serves all views.
pub(super) fn light_horizon(height: &Grid) -> Vec<f32> {
    horizons(height, LIGHT_AZIMUTH_DEG.to_radians(), &LIGHT_STEPS, -4.0)
}

/// The largest slope from each texel to the relief at the given distances, at least `lowest`.
fn horizons(height: &Grid, angle: f64, steps: &[f64], lowest: f32) -> Vec<f32> {
    let n = height.n();
    let texel = TILE_MM / n as f64;
    let mut horizon = vec![lowest; n * n];
    let mut seen = (0, 0);
    for &step in steps {
        let dx = (step / texel * libm::cos(angle)).round() as i64;
        let dy = (step / texel * libm::sin(angle)).round() as i64;
        if (dx, dy) == seen {
            continue;
        }
        seen = (dx, dy);
        let distance = ((dx * dx + dy * dy) as f64).sqrt() * texel;
        raise(&mut horizon, height, (dx, dy), (1.0 / distance) as f32);
    }
    horizon
}

/// Raises each horizon to the slope towards the texel `(dx, dy)` away.
fn raise(horizon: &mut [f32], height: &Grid, (dx, dy): (i64, i64), inverse: f32) {
    let n = height.n();
    let shift = dx.rem_euclid(n as i64) as usize;
    for y in 0..n {
        let here = height.row(y);
        let there = height.row((y as i64 + dy).rem_euclid(n as i64) as usize);
        let row = &mut horizon[y * n..(y + 1) * n];
        let (head, tail) = row.split_at_mut(n - shift);
        raise_run(head, here, &there[shift..], inverse);
        raise_run(tail, &here[n - shift..], there, inverse);
    }
}

fn raise_run(horizon: &mut [f32], here: &[f32], there: &[f32], inverse: f32) {
    for ((t, h), other) in horizon.iter_mut().zip(here).zip(there) {
        let slope = (other - h) * inverse;
        *t = if slope > *t { slope } else { *t };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_open_and_a_pit_is_not() {
        let flat = ambient_occlusion(&Grid::filled(64, 0.3));
        assert!(flat.iter().all(|&open| (open - 1.0).abs() < 1e-6));

        // A round pit of radius 0.8 mm and depth 1 mm: from its middle the rim has slope 1.25,
        // met at the next distance that is looked at, 0.875 mm.
        let pit = Grid::from_fn(256, |u, v| {
            let (x, y) = ((u - 0.5) * 32.0, (v - 0.5) * 32.0);
            if x * x + y * y < 0.64 { -1.0 } else { 0.0 }
        });
        let open = ambient_occlusion(&pit);
        let middle = open[128 * 256 + 128];
        let slope: f32 = 1.0 / 0.875;
        let expected = 1.0 / (1.0 + slope * slope);
        assert!((middle - expected).abs() < 0.08, "{middle}");
        assert!((open[0] - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_wall_shadows_what_is_behind_it() {
        let wall = Grid::from_fn(256, |u, _| if (0.5..0.55).contains(&u) { 1.0 } else { 0.0 });
        let horizon = light_horizon(&wall);
        let before = horizon[128 * 256 + 120];
        let after = horizon[128 * 256 + 145];
        assert!(before > 0.8, "{before}");
        assert!(after <= 0.0, "{after}");
    }
}
