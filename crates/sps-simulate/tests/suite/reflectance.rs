//! Laws that the reflectance model must obey, against quadrature in f64 that shares no code with
//! it.

use std::f64::consts::{PI, TAU};

use sps_base::streams::{ChaCha8Rng, RngCore, SeedableRng};
use sps_simulate::{Brdf, Vector};

const UP: Vector = [0.0, 0.0, 1.0];

fn white_metal(alpha: f32) -> Brdf {
    Brdf {
        albedo: [1.0; 3],
        metal: true,
        alpha: [alpha; 2],
        ..Brdf::default()
    }
}

fn view_at(cosine: f64) -> Vector {
    [(1.0 - cosine * cosine).sqrt() as f32, 0.0, cosine as f32]
}

/// Light that leaves towards `view` in a furnace of unit radiance, by half vectors drawn from the
/// GGX distribution on a grid: `dl = 4 (v.h) dh`.
fn furnace(brdf: &Brdf, view: Vector, alpha: f64) -> f64 {
    let (steps, turns) = (1500, 120);
    let v = view.map(f64::from);
    let mut sum = 0.0;
    for i in 0..steps {
        let u = (f64::from(i) + 0.5) / f64::from(steps);
        // A tail that reaches every direction also where the lobe is narrow.
        let u = 1.0 - (1.0 - u) * (1.0 - u);
        let stretch = 2.0 * (1.0 - (f64::from(i) + 0.5) / f64::from(steps));
        let slope = alpha * (u / (1.0 - u)).sqrt();
        let hz = 1.0 / (1.0 + slope * slope).sqrt();
        let t = slope / alpha;
        let density = 1.0 / (PI * alpha * alpha * (1.0 + t * t) * (1.0 + t * t) * hz.powi(4));
        for j in 0..turns {
            let phi = TAU * (f64::from(j) + 0.5) / f64::from(turns);
            let h = [slope * hz * phi.cos(), slope * hz * phi.sin(), hz];
            let vh = v[0] * h[0] + v[2] * h[2];
            let light: [f64; 3] = std::array::from_fn(|k| 2.0 * vh * h[k] - v[k]);
            if vh <= 0.0 || light[2] <= 0.0 {
                continue;
            }
            let value = f64::from(brdf.eval(UP, light.map(|c| c as f32), view)[0]);
            sum += stretch * value * light[2] * 4.0 * vh / (density * hz);
        }
    }
    sum / f64::from(steps * turns)
}

#[test]
fn a_white_metal_vanishes_in_a_white_furnace() {
    for roughness in [0.02, 0.05, 0.1, 0.15, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0] {
        for cosine in [0.15, 0.35, 0.6, 0.85, 1.0] {
            let brdf = white_metal(roughness as f32);
            let left = furnace(&brdf, view_at(cosine), roughness);
            let vanished = (left - 1.0).abs() < 0.01;
            assert!(vanished, "alpha {roughness}, cosine {cosine}: {left}");
        }
    }
}

/// Over the whole hemisphere, for lobes wide enough.
fn directional_albedo(brdf: &Brdf, view: Vector) -> f64 {
    let (steps, turns) = (300, 300);
    let mut sum = 0.0;
    for i in 0..steps {
        let z = (f64::from(i) + 0.5) / f64::from(steps);
        let s = (1.0 - z * z).sqrt();
        for j in 0..turns {
            let phi = TAU * (f64::from(j) + 0.5) / f64::from(turns);
            let light = [(s * phi.cos()) as f32, (s * phi.sin()) as f32, z as f32];
            sum += f64::from(brdf.eval(UP, light, view)[0]) * z;
        }
    }
    sum * TAU / f64::from(steps * turns)
}

#[test]
fn no_stack_of_layers_gains_energy() {
    for coat in [None, Some(0.3)] {
        for sheen in [0.0, 0.5] {
            for metal in [false, true] {
                let brdf = Brdf {
                    albedo: [1.0; 3],
                    metal,
                    alpha: [0.5; 2],
                    sheen,
                    coat,
                    ..Brdf::default()
                };
                for cosine in [0.2, 0.5, 0.9] {
                    let left = directional_albedo(&brdf, view_at(cosine));
                    assert!(left < 1.01, "{brdf:?} at {cosine}: {left}");
                    assert!(left > 0.6, "{brdf:?} at {cosine}: {left}");
                }
            }
        }
    }
}

#[test]
fn a_bare_white_dielectric_loses_nothing() {
    for alpha in [0.3, 0.6, 1.0] {
        let brdf = Brdf {
            albedo: [1.0; 3],
            alpha: [alpha; 2],
            ..Brdf::default()
        };
        for cosine in [0.2, 0.5, 0.9] {
            let left = directional_albedo(&brdf, view_at(cosine));
            assert!((left - 1.0).abs() < 0.01, "{alpha} at {cosine}: {left}");
        }
    }
}

struct Draws(ChaCha8Rng);

impl Draws {
    fn unit(&mut self) -> f32 {
        (self.0.next_u32() >> 8) as f32 / (1u32 << 24) as f32
    }

    fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    /// Any direction above the plane, often at grazing angles.
    fn direction(&mut self) -> Vector {
        let z = self.unit() * self.unit() * self.unit();
        let phi = std::f32::consts::TAU * self.unit();
        let s = (1.0 - z * z).max(0.0).sqrt();
        [s * phi.cos(), s * phi.sin(), z]
    }

    fn brdf(&mut self) -> Brdf {
        let mut alpha = || 1e-4f32.powf(self.unit());
        let alpha = [alpha(), alpha()];
        Brdf {
            albedo: [self.unit(), self.unit(), self.unit()],
            metal: self.unit() < 0.5,
            f0: 0.1 * self.unit(),
            alpha,
            sheen: if self.unit() < 0.5 { 0.0 } else { self.unit() },
            coat: (self.unit() < 0.5).then(|| 1e-4f32.powf(self.unit())),
        }
    }
}

#[test]
fn light_and_view_can_be_exchanged() {
    let mut draws = Draws(ChaCha8Rng::seed_from_u64(1));
    for _ in 0..100_000 {
        let brdf = draws.brdf();
        let (a, b) = (draws.direction(), draws.direction());
        let (there, back) = (brdf.eval(UP, a, b), brdf.eval(UP, b, a));
        for (x, y) in there.into_iter().zip(back) {
            let near = (x - y).abs() <= 1e-6 * x.abs().max(1.0);
            assert!(near, "{brdf:?} {a:?} {b:?}: {x} {y}");
        }
    }
}

/// Grazing angles, roughness down to 1e-4, normals without a direction.
mod hard_cases {
    use super::*;

    type Exact = [f64; 3];

    fn unit(v: Exact) -> Exact {
        let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
        v.map(|c| c / length)
    }

    /// Single scattering of white facets about the z axis, in f64 by the formulas of the papers
    /// (Walter et al., EGSR 2007; Heitz, JCGT 3(2), 2014).
    fn exact_lobe(alpha: f64, light: Vector, view: Vector) -> f64 {
        let (l, v) = (unit(light.map(f64::from)), unit(view.map(f64::from)));
        let h = unit(std::array::from_fn(|i| l[i] + v[i]));
        let slope2 = (h[0] * h[0] + h[1] * h[1]) / (h[2] * h[2]);
        let reach = 1.0 + slope2 / (alpha * alpha);
        let density = 1.0 / (PI * alpha * alpha * h[2].powi(4) * reach * reach);
        let lambda = |d: Exact| {
            let tan2 = (d[0] * d[0] + d[1] * d[1]) / (d[2] * d[2]);
            0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
        };
        density / ((1.0 + lambda(l) + lambda(v)) * 4.0 * l[2] * v[2])
    }

    /// The same as it stands in most renderers, in f32: the density from the cosine of the half
    /// vector, masking from the tangent.
    fn naive_lobe(alpha: f32, light: Vector, view: Vector) -> f32 {
        let sum: Vector = std::array::from_fn(|i| light[i] + view[i]);
        let length = sum.iter().map(|c| c * c).sum::<f32>().sqrt();
        let (cosine, a2) = (sum[2] / length, alpha * alpha);
        let q = cosine * cosine * (a2 - 1.0) + 1.0;
        let density = a2 / (std::f32::consts::PI * q * q);
        let masked = |c: f32| {
            let tan2 = (1.0 - c * c) / (c * c);
            2.0 / (1.0 + (1.0 + a2 * tan2).sqrt())
        };
        density * masked(light[2]) * masked(view[2]) / (4.0 * light[2] * view[2])
    }

    /// An interface that reflects everything, over black: single scattering and nothing else.
    fn bare_lobe(alpha: f32) -> Brdf {
        Brdf {
            albedo: [0.0; 3],
            f0: 1.0,
            alpha: [alpha; 2],
            ..Brdf::default()
        }
    }

    fn off(found: f32, expected: f64) -> f64 {
        let error = (f64::from(found) - expected).abs() / expected;
        if error.is_nan() { f64::INFINITY } else { error }
    }

    /// Half vectors from the middle of the lobe to five times its width. The directions are f32, so
    /// their sum has a slope of 1e-4 to within some 1e-7: a thousandth.
    #[test]
    fn roughness_of_1e_4_follows_the_formula() {
        const BOUND: f64 = 4e-3;
        let (mut worst, mut naive) = (0.0_f64, 0.0_f64);
        for step in 0..=50 {
            let slope = 1e-5 * step as f32;
            for angle in [0.0_f32, 0.4, 0.9] {
                let light = [angle.sin(), 0.0, angle.cos()];
                let tilted = -angle + 2.0 * slope.atan();
                let view = [tilted.sin(), 0.0, tilted.cos()];
                let expected = exact_lobe(1e-4, light, view);
                let found = bare_lobe(1e-4).eval(UP, light, view)[0];
                worst = worst.max(off(found, expected));
                naive = naive.max(off(naive_lobe(1e-4, light, view), expected));
            }
        }
        println!("roughness 1e-4: error {worst:.1e}, bound {BOUND:.0e}, naive form {naive:.1e}");
        assert!(worst <= BOUND && naive > BOUND);
    }

    /// One direction grazes, the other does not: the lobe has a finite limit, of which the plain
    /// form is 0 / 0.
    #[test]
    fn grazing_angles_follow_the_formula() {
        const BOUND: f64 = 2e-6;
        let (alpha, view) = (0.3_f32, [0.6, 0.0, 0.8]);
        let (mut worst, mut naive) = (0.0_f64, 0.0_f64);
        for cosine in [1e-2_f32, 1e-4, 1e-6, 1e-10, 1e-20, f32::MIN_POSITIVE] {
            let light = [-(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
            let expected = exact_lobe(f64::from(alpha), light, view);
            let found = bare_lobe(alpha).eval(UP, light, view)[0];
            worst = worst.max(off(found, expected));
            naive = naive.max(off(naive_lobe(alpha, light, view), expected));
        }
        println!("grazing angles: error {worst:.1e}, bound {BOUND:.0e}, naive form {naive:.1e}");
        assert!(worst <= BOUND && naive > BOUND);
    }

    #[test]
    fn reflectance_is_finite_and_never_negative() {
        let mut draws = Draws(ChaCha8Rng::seed_from_u64(2));
        for _ in 0..100_000 {
            let brdf = draws.brdf();
            let normal = [draws.signed(), draws.signed(), draws.signed()];
            let tilted = draws.direction();
            let mirrored = [-tilted[0], -tilted[1], tilted[2]];
            for (light, view) in [
                (draws.direction(), tilted),
                (mirrored, tilted),
                (tilted, tilted),
            ] {
                for n in [normal, UP] {
                    for value in brdf.eval(n, light, view) {
                        let sane = value.is_finite() && value >= 0.0;
                        assert!(sane, "{brdf:?} {n:?} {light:?} {view:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn vectors_without_a_direction_reflect_nothing() {
        let brdf = white_metal(1e-4);
        let broken = [
            [0.0; 3],
            [f32::NAN, 0.0, 1.0],
            [f32::INFINITY, 0.0, 0.0],
            [1e-38, 0.0, 0.0],
        ];
        for bad in broken {
            assert_eq!(brdf.eval(bad, UP, UP), [0.0; 3]);
            assert_eq!(brdf.eval(UP, bad, UP), [0.0; 3]);
            assert_eq!(brdf.eval(UP, UP, bad), [0.0; 3]);
        }
        let naive = |v: Vector| {
            let length = v.iter().map(|c| c * c).sum::<f32>().sqrt();
            v.map(|c| c / length)
        };
        for bad in broken {
            assert!(naive(bad).iter().any(|c| !c.is_finite()), "the naive form");
        }
        // Opposite directions have no half vector; below the surface nothing is seen.
        assert_eq!(brdf.eval(UP, [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]), [0.0; 3]);
        assert_eq!(brdf.eval(UP, UP, [0.0, 0.0, -1.0]), [0.0; 3]);
        // Length does not matter.
        let long = brdf.eval([0.0, 0.0, 9.0], [0.0, 0.6, 0.8], [0.0, -1.2e6, 1.6e6]);
        assert_eq!(long, brdf.eval(UP, [0.0, 0.6, 0.8], [0.0, -0.6, 0.8]));
    }

    #[test]
    fn grazing_directions_on_a_near_mirror() {
        for cosine in [1e-1f32, 1e-3, 1e-5, 1e-7, 1e-20, f32::MIN_POSITIVE] {
            let graze = [(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
            let mirrored = [-graze[0], 0.0, cosine];
            let aside = [0.0, graze[0], cosine];
            for metal in [false, true] {
                for alpha in [[1e-4; 2], [1e-4, 1.0], [1.0; 2]] {
                    for coat in [None, Some(1e-4)] {
                        let brdf = Brdf {
                            metal,
                            alpha,
                            coat,
                            sheen: 1.0,
                            ..Brdf::default()
                        };
                        for (light, view) in [
                            (graze, graze),
                            (graze, mirrored),
                            (graze, aside),
                            (graze, UP),
                            (UP, graze),
                        ] {
                            let there = brdf.eval(UP, light, view);
                            let back = brdf.eval(UP, view, light);
                            for (x, y) in there.into_iter().zip(back) {
                                assert!(x.is_finite() && x >= 0.0, "{brdf:?} {light:?}: {x}");
                                assert!((x - y).abs() <= 1e-6 * x.max(1.0), "{x} {y}");
                            }
                        }
                    }
                }
            }
        }
    }
}
