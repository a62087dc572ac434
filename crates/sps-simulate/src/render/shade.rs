//! Shading, row by row.

use sps_dataset::LinearFrame;

use super::super::reflectance::{
    COAT_F0, DOME, Spread, energy, multiple_colour, schlick, sheen_lobe, sheen_table,
    slope_density, visibility,
};
use super::maps::{Finish, Texel, Texels, channel};
use super::view::{Pose, View, world_light};

/// Irradiance of the soft light on a plane that faces it; the dome's is about 2.5.
pub(super) const LIGHT: f32 = 1.5;

/// Squared roughness that the soft light's width adds to every lobe: half of 11 degrees, in slope.
pub(super) const LIGHT_SPREAD: f32 = 0.01;

/// Width of a shadow's edge in units of slope, again from the light's width.
const PENUMBRA: f32 = 0.25;

/// A clear coat fills what is under it: share of the slopes that is left on its surface.
const COAT_SLOPE: f32 = 0.35;

/// Signal of a white diffuser that faces the camera.
pub(super) const WHITE: f32 = 0.92;

/// Photographs the surface: scene-linear light, before the sensor.
pub(super) fn render(texels: &Texels, pose: &Pose, size: usize) -> LinearFrame {
    let view = View::new(pose, size);
    let mut row = Row::new(size);
    let mut data = vec![0.0; size * size * 3];
    for (y, out) in data.chunks_exact_mut(size * 3).enumerate() {
        row.trace(&view, y, texels);
        row.light(&view, y, texels);
        row.compose(&texels.finish, pose.exposure as f32, out);
    }
    LinearFrame {
        width: size,
        height: size,
        data,
    }
}

/// What is known of each pixel of a row, as one array per quantity so that loops vectorise.
struct Row {
    u: Vec<f32>,
    v: Vec<f32>,
    section: Vec<f32>,
    texels: [Vec<f32>; 12],
    /// Cosines from the pixel's normal to the camera and to the light.
    nv: Vec<f32>,
    nl: Vec<f32>,
    /// Irradiance from the soft light, with its shadow.
    direct: Vec<f32>,
    /// Specular density times masking, before Fresnel.
    lobe: Vec<f32>,
    alpha2: Vec<f32>,
    /// The base's specular reflection of the dome, as a scale of the reflectance at normal
    /// incidence and a rest; and the share of light that crosses the interface.
    dome_scale: Vec<f32>,
    dome_bias: Vec<f32>,
    /// For a metal, the light that its facets pass on to each other, before its colour.
    crossing: Vec<f32>,
    /// Of a metal: the mean directional albedo of white facets.
    mean: Vec<f32>,
    /// Fuzz and coat: light added, and share of what is below that is left.
    over: Vec<f32>,
    under: Vec<f32>,
    colour: Vec<f32>,
    /// Cosine between the light and the half vector, the same everywhere.
    light_half: f32,
}

impl Row {
    fn new(size: usize) -> Self {
        let row = || vec![0.0; size];
        Self {
            u: row(),
            v: row(),
            section: Vec::new(),
            texels: std::array::from_fn(|_| row()),
            nv: row(),
            nl: row(),
            direct: row(),
            lobe: row(),
            alpha2: row(),
            dome_scale: row(),
            dome_bias: row(),
            crossing: row(),
            mean: row(),
            over: row(),
            under: row(),
            colour: row(),
            light_half: 0.0,
        }
    }

    /// Finds what each pixel sees and samples it.
    fn trace(&mut self, view: &View, y: usize, texels: &Texels) {
        view.trace(y, texels, &mut self.section, (&mut self.u, &mut self.v));
        let n = texels.n as f32;
        let apart = view.tap_distance() * n;
        for i in 0..self.u.len() {
            let (x, y) = (self.u[i] * n - 0.5, self.v[i] * n - 0.5);
            let mut texel = bilinear(texels, x - apart, y);
            if apart > 0.0 {
                let other = bilinear(texels, x + apart, y);
                for (value, second) in texel.iter_mut().zip(other) {
                    *value = 0.5 * (*value + second);
                }
            }
            for (row, value) in self.texels.iter_mut().zip(texel) {
                row[i] = value;
            }
        }
    }

    fn light(&mut self, view: &View, y: usize, texels: &Texels) {
        self.light_half = view.light_half;
        let finish = &texels.finish;
        self.facets(view, y, finish);
        self.shadows(view, texels.rough);
        self.dome(finish);
        self.over.fill(0.0);
        self.under.fill(1.0);
        if finish.sheen > 0.0 {
            self.fuzz(view, finish.sheen);
        }
        if let Some(alpha) = finish.coat {
            self.coat(view, y, alpha);
        }
    }

    /// Normals, and the response of the microfacets to the soft light.
    fn facets(&mut self, view: &View, y: usize, finish: &Finish) {
        let size = self.u.len();
        let [sx, sy, xx, yy, xy, ..] = &self.texels;
        let (sx, sy) = (&sx[..size], &sy[..size]);
        let (xx, yy, xy) = (&xx[..size], &yy[..size], &xy[..size]);
        let columns = &view.columns[..size];
        let [lx, ly, lz] = view.light;
        let half_y = view.half_y[y];
        let base = finish.spread;
        let (nv, nl) = (&mut self.nv[..size], &mut self.nl[..size]);
        let (lobe, alpha2) = (&mut self.lobe[..size], &mut self.alpha2[..size]);
        for i in 0..size {
            let nz = 1.0 / (1.0 + sx[i] * sx[i] + sy[i] * sy[i]).sqrt();
            let [vx, vy, vz] = columns[i].view;
            nv[i] = ((vz - sx[i] * vx - sy[i] * vy) * nz).max(0.03);
            nl[i] = ((lz - sx[i] * lx - sy[i] * ly) * nz).max(0.0);
            // Slopes finer than the footprint widen the lobe: twice their variance.
            let spread = Spread {
                xx: base.xx + LIGHT_SPREAD + 2.0 * (xx[i] - sx[i] * sx[i]).max(0.0),
                yy: base.yy + LIGHT_SPREAD + 2.0 * (yy[i] - sy[i] * sy[i]).max(0.0),
                xy: base.xy + 2.0 * (xy[i] - sx[i] * sy[i]),
            };
            let mean = 0.5 * (spread.xx + spread.yy);
            let through = |c: f32| mean * (1.0 - c * c);
            let density = slope_density(columns[i].half_x + sx[i], half_y + sy[i], spread);
            lobe[i] = density
                * columns[i].half_jacobian
                * nz
                * visibility(nl[i].max(1e-3), nv[i], through(nl[i]), through(nv[i]));
            alpha2[i] = mean - LIGHT_SPREAD;
        }
    }

    /// Light that the relief lets through.
    fn shadows(&mut self, view: &View, rough: bool) {
        if !rough {
            for (direct, nl) in self.direct.iter_mut().zip(&self.nl) {
                *direct = LIGHT * nl;
            }
            return;
        }
        let horizon = &self.texels[channel::HORIZON];
        for ((direct, nl), t) in self.direct.iter_mut().zip(&self.nl).zip(horizon) {
            let clear = ((view.light_slope - t) / PENUMBRA + 0.5).clamp(0.0, 1.0);
            *direct = LIGHT * nl * clear;
        }
    }

    /// The dome in the microfacets.
    fn dome(&mut self, finish: &Finish) {
        let table = energy();
        for i in 0..self.nv.len() {
            let e = table.at(self.alpha2[i], self.nv[i]);
            self.dome_scale[i] = e.dome_scale;
            self.dome_bias[i] = e.dome_bias;
            self.crossing[i] = if finish.metal {
                let (scale, bias) = table.mean(self.alpha2[i]);
                self.mean[i] = scale + bias;
                let l = table.at(self.alpha2[i], self.nl[i]);
                let lit = self.direct[i] * (1.0 - l.scale - l.bias) / (1.0 - self.mean[i]);
                let ambient = DOME.irradiance(self.nv[i]) * self.texels[channel::AMBIENT][i];
                (1.0 - e.scale - e.bias) * (lit + ambient) * std::f32::consts::FRAC_1_PI
            } else {
                1.0 - finish.f0 * e.scale - e.bias
            };
        }
    }

    fn fuzz(&mut self, view: &View, strength: f32) {
        let table = sheen_table();
        let ambient = &self.texels[channel::AMBIENT];
        let cosine = 2.0 * view.light_half;
        let lit = (1.0 - strength * table.mean).max(0.0);
        for (i, open) in ambient.iter().enumerate() {
            let (nl, nv) = (self.nl[i], self.nv[i]);
            let (albedo, dome) = table.at(nv);
            let half = (nl + nv) / cosine;
            let direct = sheen_lobe(nl, nv, half.min(1.0)) * self.direct[i];
            self.over[i] = strength * (direct + dome * open);
            // Towards the light the fuzz takes its mean share.
            self.under[i] = (1.0 - strength * albedo).max(0.0) * lit;
        }
    }

    fn coat(&mut self, view: &View, y: usize, alpha: f32) {
        let table = energy();
        let a2 = alpha * alpha + LIGHT_SPREAD;
        let spread = Spread::along([a2; 2]);
        let reflected = schlick(COAT_F0, view.light_half);
        let [sx, sy, ..] = &self.texels;
        let [lx, ly, lz] = view.light;
        for (i, column) in view.columns.iter().enumerate() {
            let (x, z) = (COAT_SLOPE * sx[i], COAT_SLOPE * sy[i]);
            let nz = 1.0 / (1.0 + x * x + z * z).sqrt();
            let [vx, vy, vz] = column.view;
            let nv = ((vz - x * vx - z * vy) * nz).max(0.03);
            let nl = ((lz - x * lx - z * ly) * nz).max(0.0);
            let through = |c: f32| a2 * (1.0 - c * c);
            let lobe = slope_density(column.half_x + x, view.half_y[y] + z, spread)
                * column.half_jacobian
                * nz
                * visibility(nl.max(1e-3), nv, through(nl), through(nv));
            let e = table.at(alpha * alpha, nv);
            let left = 1.0 - COAT_F0 * e.scale - e.bias;
            let gloss = lobe * reflected * LIGHT * nl + COAT_F0 * e.dome_scale + e.dome_bias;
            self.over[i] = gloss + left * self.over[i];
            self.under[i] *= left * left;
        }
    }

    /// Adds all up for the three colours.
    fn compose(&mut self, finish: &Finish, exposure: f32, out: &mut [f32]) {
        let gain = exposure * WHITE / white_radiance();
        for c in 0..3 {
            if finish.metal {
                self.metal(c);
            } else {
                self.dielectric(c, finish.f0);
            }
            for (pixel, value) in out.iter_mut().skip(c).step_by(3).zip(&self.colour) {
                *pixel = value * gain;
            }
        }
    }

    /// Diffuse light under an interface.
    fn dielectric(&mut self, c: usize, f0: f32) {
        let size = self.colour.len();
        let reflected = schlick(f0, self.light_half);
        let albedo = &self.texels[channel::ALBEDO + c][..size];
        let ambient = &self.texels[channel::AMBIENT][..size];
        let polish = &self.texels[channel::POLISH][..size];
        let (direct, lobe) = (&self.direct[..size], &self.lobe[..size]);
        let (nv, crossing) = (&self.nv[..size], &self.crossing[..size]);
        let (scale, bias) = (&self.dome_scale[..size], &self.dome_bias[..size]);
        let (over, under) = (&self.over[..size], &self.under[..size]);
        for i in 0..size {
            let (a, open) = (albedo[i], ambient[i]);
            // What a hollow hides of the dome it shows of itself, in its own colour.
            let bounced = open / (1.0 - a * (1.0 - open));
            let light = direct[i] + DOME.irradiance(nv[i]) * bounced;
            let diffuse = a * crossing[i] * light * std::f32::consts::FRAC_1_PI;
            let gloss = reflected * lobe[i] * direct[i] + (f0 * scale[i] + bias[i]) * open;
            self.colour[i] = over[i] + under[i] * (diffuse + polish[i] * gloss);
        }
    }

    /// Nothing but facets, whose colour is the albedo, and light that they pass on to each other
    /// (Kulla and Conty, as in [`Brdf`](super::super::reflectance::Brdf)).
    fn metal(&mut self, c: usize) {
        let size = self.colour.len();
        let albedo = &self.texels[channel::ALBEDO + c][..size];
        let ambient = &self.texels[channel::AMBIENT][..size];
        let polish = &self.texels[channel::POLISH][..size];
        let (direct, lobe) = (&self.direct[..size], &self.lobe[..size]);
        let (crossing, mean) = (&self.crossing[..size], &self.mean[..size]);
        let (scale, bias) = (&self.dome_scale[..size], &self.dome_bias[..size]);
        let (over, under) = (&self.over[..size], &self.under[..size]);
        for i in 0..size {
            let f0 = albedo[i];
            let gloss = schlick(f0, self.light_half) * lobe[i] * direct[i]
                + (f0 * scale[i] + bias[i]) * ambient[i];
            let again = multiple_colour(f0, mean[i]) * crossing[i];
            self.colour[i] = over[i] + under[i] * polish[i] * (gloss + again);
        }
    }
}

/// Radiance of a white diffuser that faces the camera.
pub(super) fn white_radiance() -> f32 {
    let facing = DOME.irradiance(1.0) + LIGHT * world_light()[2] as f32;
    facing * std::f32::consts::FRAC_1_PI
}

/// The texel at `(x, y)` in texels; wraps.
#[inline]
fn bilinear(texels: &Texels, x: f32, y: f32) -> Texel {
    let n = texels.n as i32;
    // Places lie within one period of the middle one, so truncation after a shift is a floor.
    let (x, y) = (x + 2.0 * n as f32, y + 2.0 * n as f32);
    let (i, j) = (x as i32, y as i32);
    let (fx, fy) = (x - i as f32, y - j as f32);
    let wrap = |i: i32| (i % n) as usize;
    let (i0, i1) = (wrap(i), wrap(i + 1));
    let (j0, j1) = (wrap(j) * texels.n, wrap(j + 1) * texels.n);
    let (a, b) = (&texels.data[j0 + i0], &texels.data[j0 + i1]);
    let (c, d) = (&texels.data[j1 + i0], &texels.data[j1 + i1]);
    std::array::from_fn(|k| {
        let top = a[k] + (b[k] - a[k]) * fx;
        let bottom = c[k] + (d[k] - c[k]) * fx;
        top + (bottom - top) * fy
    })
}
