//! Where each pixel looks, and from where the light comes.

use super::super::geometry::{CAMERA_MM, FIELD_MM, LIGHT_AZIMUTH_DEG, LIGHT_ZENITH_DEG, TILE_MM};
use super::super::parameters::Specimen;
use super::super::stream::{Purpose, Stream};
use super::maps::{Texels, channel};

/// How a surface lay when it was photographed, with the small errors of the stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    /// Roll in radians.
    pub(crate) roll: f64,
    /// Rotation in the image in radians.
    pub(crate) turn: f64,
    /// Displacement on the surface in mm.
    pub(crate) shift: (f64, f64),
    /// Exposure error as a factor.
    pub(crate) exposure: f64,
}

impl Pose {
    /// The pose without any error.
    #[cfg(test)]
    pub(crate) fn exact(degrees: f64) -> Self {
        Self {
            roll: degrees.to_radians(),
            turn: 0.0,
            shift: (0.0, 0.0),
            exposure: 1.0,
        }
    }

    /// The pose of one view, with the errors that belong to this surface and angle: 0.15 degrees
    /// of roll, 0.1 degrees of rotation, 0.06 mm of displacement and 2 % of exposure (standard
    /// deviations).
    pub(crate) fn draw(specimen: &Specimen, degrees: f64) -> Self {
        let key = [specimen.index, angle_key(degrees)];
        let mut stream = Stream::new(specimen.seed, Purpose::PLACEMENT, &key);
        Self {
            roll: (degrees + 0.15 * stream.normal()).to_radians(),
            turn: (0.1 * stream.normal()).to_radians(),
            shift: (0.06 * stream.normal(), 0.06 * stream.normal()),
            exposure: libm::exp(0.02 * stream.normal()),
        }
    }
}

/// A roll angle as an integer number of millionths of a degree.
pub(crate) fn angle_key(degrees: f64) -> u64 {
    ((degrees * 1e6).round() as i64) as u64
}

/// Directions and projections of one view, in the frame of the surface: x across the roll axis, y
/// along it, z the normal.
#[derive(Clone, Debug)]
pub(crate) struct View {
    pub(crate) size: usize,
    pub(crate) sine: f32,
    pub(crate) cosine: f32,
    /// Towards the light.
    pub(crate) light: [f32; 3],
    /// Cosine between the light and the half vector.
    pub(crate) light_half: f32,
    /// Slope of the light's direction above the plane.
    pub(crate) light_slope: f32,
    pub(crate) columns: Vec<Column>,
    /// Slope of the half vector along y at each row.
    pub(crate) half_y: Vec<f32>,
    turn: f32,
    shift: (f32, f32),
    /// Image position of each pixel centre from the middle, in mm at the roll axis.
    places: Vec<f32>,
}

/// What pixels of one column share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Column {
    /// Towards the camera.
    pub(crate) view: [f32; 3],
    /// Slope of the half vector along x.
    pub(crate) half_x: f32,
    /// Its cosine to the surface's normal, to the power -4.
    pub(crate) half_jacobian: f32,
}

impl View {
    pub(crate) fn new(pose: &Pose, size: usize) -> Self {
        let (sine, cosine) = (libm::sin(pose.roll), libm::cos(pose.roll));
        let to_surface = |v: [f64; 3]| {
            [
                v[0] * cosine - v[2] * sine,
                v[1],
                v[0] * sine + v[2] * cosine,
            ]
        };
        let light = world_light();
        let place = |i| ((i as f64 + 0.5) / size as f64 - 0.5) * FIELD_MM;
        let places: Vec<f64> = (0..size).map(place).collect();
        let column = |&x: &f64| Column::new(camera_direction(x, 0.0), light, to_surface);
        let half_y = |&y: &f64| {
            let half = to_surface(sum(camera_direction(0.0, y), light));
            (half[1] / half[2]) as f32
        };
        let light_here = to_surface(light);
        let flat = (light_here[0] * light_here[0] + light_here[1] * light_here[1]).sqrt();
        Self {
            size,
            sine: sine as f32,
            cosine: cosine as f32,
            light: light_here.map(|c| c as f32),
            light_half: (0.5 + 0.5 * light[2]).sqrt() as f32,
            light_slope: (light_here[2] / flat.max(1e-9)) as f32,
            columns: places.iter().map(column).collect(),
            half_y: places.iter().map(half_y).collect(),
            turn: pose.turn as f32,
            shift: (pose.shift.0 as f32, pose.shift.1 as f32),
            places: places.iter().map(|&p| p as f32).collect(),
        }
    }

    /// Fills the places that row `row` sees, in units of the period; `scratch` is reused memory.
    pub(crate) fn trace(
        &self,
        row: usize,
        texels: &Texels,
        scratch: &mut Vec<f32>,
        (us, vs): (&mut [f32], &mut [f32]),
    ) {
        let y = self.places[row];
        let shown = (texels.height_range.1 - texels.height_range.0) * self.sine.abs();
        let pixel = FIELD_MM as f32 / self.size as f32;
        if texels.rough && shown > 0.5 * pixel {
            self.trace_relief(y, texels, scratch, us);
        } else {
            for (u, &x) in us.iter_mut().zip(&self.places) {
                *u = self.plane_x(x - self.turn * y);
            }
        }
        let scale = 1.0 / TILE_MM as f32;
        for ((u, v), &x) in us.iter_mut().zip(vs).zip(&self.places) {
            let depth = 1.0 + *u * self.sine / CAMERA_MM as f32;
            *v = ((y + self.turn * x) * depth + self.shift.1) * scale + 0.5;
            *u = (*u + self.shift.0) * scale + 0.5;
        }
    }

    /// Half the distance between the two places that a foreshortened pixel is sampled at, in units
    /// of the period: growing from nothing at nadir to a quarter of the footprint at 45 degrees,
    /// where it removes just the pattern that repeats with the pixels.
    pub(crate) fn tap_distance(&self) -> f32 {
        const AT_45: f32 = std::f32::consts::SQRT_2 - 1.0;
        let stretch = 1.0 / self.cosine;
        let share = ((stretch - 1.02) / AT_45).clamp(0.0, 1.0);
        let footprint = stretch * (FIELD_MM / TILE_MM) as f32 / self.size as f32;
        0.25 * share * footprint
    }

    /// Where on the flat surface the ray through image place `x` lands, in mm.
    fn plane_x(&self, x: f32) -> f32 {
        x / (self.cosine - x * self.sine / CAMERA_MM as f32)
    }

    /// Where the ray through each pixel first meets the relief, in mm on the surface.
    ///
    /// The roll moves a point of height `h` by `h sin(roll)` across the image and nowhere along
    /// it, so a row of the image is a section of the surface. Walking the section from the side
    /// that the camera looks from, a point is seen where it passes all points before it.
    fn trace_relief(&self, y: f32, texels: &Texels, scratch: &mut Vec<f32>, us: &mut [f32]) {
        let step = TILE_MM as f32 / texels.n as f32;
        let margin = texels.height_range.0.abs().max(texels.height_range.1);
        let half = 0.5 * FIELD_MM as f32;
        let near = self.plane_x(-half) - margin - 2.0 * step;
        let far = self.plane_x(half) + margin + 2.0 * step;
        let first = (near / step).floor() as i32;
        let count = ((far - near) / step) as usize + 2;
        self.section(y, texels, first, count, scratch);
        let sign = if self.sine > 0.0 { 1.0 } else { -1.0 };
        let forward = self.sine > 0.0;
        let at = |k: usize| if forward { k } else { count - 1 - k };
        let image = |k: usize| sign * scratch[at(k)];
        let place = |k: usize| (first + at(k) as i32) as f32 * step;
        let mut k = 1;
        let pixels = us.len();
        for i in 0..pixels {
            let column = if forward { i } else { pixels - 1 - i };
            let target = sign * (self.places[column] - self.turn * y);
            while k + 1 < count && image(k) < target {
                k += 1;
            }
            let (before, after) = (image(k - 1), image(k));
            let t = ((target - before) / (after - before).max(1e-6)).clamp(0.0, 1.0);
            us[column] = place(k - 1) + (place(k) - place(k - 1)) * t;
        }
    }

    /// Image places, across, of the section of the relief under image row `y`.
    fn section(&self, y: f32, texels: &Texels, first: i32, count: usize, out: &mut Vec<f32>) {
        let n = texels.n;
        let step = TILE_MM as f32 / n as f32;
        let v = (y + self.shift.1) / step + 0.5 * n as f32 - 0.5;
        let v0 = v.floor();
        let fraction = v - v0;
        let row = |j: f32| (j as i32).rem_euclid(n as i32) as usize * n;
        let (low, high) = (row(v0), row(v0 + 1.0));
        // Texel centres lie half a step off the middle of the period.
        let u = self.shift.0 / step + 0.5 * n as f32 - 0.5;
        let offset = u.floor();
        let between = u - offset;
        let mut column = (first + offset as i32).rem_euclid(n as i32) as usize;
        let height = |column: usize| {
            let a = texels.data[low + column][channel::HEIGHT];
            let b = texels.data[high + column][channel::HEIGHT];
            a + (b - a) * fraction
        };
        let mut here = height(column);
        out.clear();
        for k in 0..count {
            column = if column + 1 == n { 0 } else { column + 1 };
            let next = height(column);
            let h = here + (next - here) * between;
            here = next;
            let x = (first + k as i32) as f32 * step;
            let across = x * self.cosine + h * self.sine;
            let depth = h * self.cosine - x * self.sine;
            out.push(across / (1.0 - depth / CAMERA_MM as f32));
        }
    }
}

impl Column {
    fn new(camera: [f64; 3], light: [f64; 3], to_surface: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        let both = sum(camera, light);
        let norm = both.iter().map(|c| c * c).sum::<f64>().sqrt();
        let half = to_surface(both);
        let hz = half[2] / norm;
        Self {
            view: to_surface(camera).map(|c| c as f32),
            half_x: (half[0] / half[2]) as f32,
            half_jacobian: (1.0 / (hz * hz * hz * hz)) as f32,
        }
    }
}

/// Unit vector from the place `(x, y)` in the focal plane to the camera.
fn camera_direction(x: f64, y: f64) -> [f64; 3] {
    let length = (x * x + y * y + CAMERA_MM * CAMERA_MM).sqrt();
    [-x / length, -y / length, CAMERA_MM / length]
}

/// Unit vector to the soft light; z is the camera's axis.
pub(super) fn world_light() -> [f64; 3] {
    let zenith = LIGHT_ZENITH_DEG.to_radians();
    let azimuth = LIGHT_AZIMUTH_DEG.to_radians();
    [
        libm::sin(zenith) * libm::cos(azimuth),
        libm::sin(zenith) * libm::sin(azimuth),
        libm::cos(zenith),
    ]
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}
