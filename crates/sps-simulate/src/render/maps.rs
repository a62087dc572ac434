//! What every view of a surface shares: texels that hold all that shading needs.

use super::super::geometry::{TILE_MM, map_size, sampling_grid};
use super::super::grid::Grid;
use super::super::material::Colours;
use super::super::parameters::{Parameters, Specimen};
use super::super::reflectance::Spread;
use super::super::relief::{self, Layers};
use super::super::stream::{Purpose, Stream};
use super::occlusion::{ambient_occlusion, light_horizon};
use super::resample::resample;

/// Values of a texel.
pub(crate) const CHANNELS: usize = 12;

/// One texel; the channels are all means over its area, so that any further averaging is right.
pub(crate) type Texel = [f32; CHANNELS];

/// Where each value of a texel is.
pub(crate) mod channel {
    /// Slope along x and y.
    pub(crate) const SLOPE_X: usize = 0;
    pub(crate) const SLOPE_Y: usize = 1;
    /// Mean squares and product of the slopes.
    pub(crate) const MOMENT_XX: usize = 2;
    pub(crate) const MOMENT_YY: usize = 3;
    pub(crate) const MOMENT_XY: usize = 4;
    /// Linear reflectance, three values.
    pub(crate) const ALBEDO: usize = 5;
    /// Share of the dome that is seen.
    pub(crate) const AMBIENT: usize = 8;
    /// Slope of the line of sight towards the light's azimuth that just clears the relief.
    pub(crate) const HORIZON: usize = 9;
    /// Share of the specular reflection that is left.
    pub(crate) const POLISH: usize = 10;
    /// Height in mm.
    pub(crate) const HEIGHT: usize = 11;
}

/// Steeper slopes than this are the walls of holes, which no camera resolves.
const STEEPEST: f32 = 4.0;

/// Roughness of a base under a clear coat, and that of the coat over the drawn one.
const UNDER_COAT: f32 = 0.35;
const COAT_SHARE: f32 = 0.5;

/// Below this root mean square slope a surface neither shades nor hides itself.
const FLAT: f32 = 0.04;

/// A surface ready to be photographed at one size.
#[derive(Clone, Debug)]
pub(crate) struct Texels {
    pub(crate) n: usize,
    pub(crate) data: Vec<Texel>,
    /// What does not vary over the surface.
    pub(crate) finish: Finish,
    /// Highest and lowest point, in mm.
    pub(crate) height_range: (f32, f32),
    /// Whether it shades and hides parts of itself.
    pub(crate) rough: bool,
}

/// Reflectance parameters of a whole surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Finish {
    pub(crate) metal: bool,
    pub(crate) f0: f32,
    /// Squared roughness of what is finer than a texel.
    pub(crate) spread: Spread,
    pub(crate) sheen: f32,
    pub(crate) coat: Option<f32>,
}

/// Builds a surface for views of `size x size` pixels.
pub(crate) fn prepare(specimen: &Specimen, size: usize) -> Texels {
    let repeats = relief::repeats(&specimen.parameters());
    prepare_on(specimen, size, map_size(size, repeats))
}

/// The same on a map of `n x n` texels.
pub(crate) fn prepare_on(specimen: &Specimen, size: usize, n: usize) -> Texels {
    let parameters = specimen.parameters();
    let layers = relief::layers(specimen, &parameters, n);
    let mut appearance = specimen.stream(Purpose::APPEARANCE);
    let mut data = paint(&layers, &parameters, &mut appearance);
    let moments = add_slopes(&mut data, &layers.height);
    let rough = moments[0] + moments[1] > FLAT * FLAT;
    if rough {
        shadow(&mut data, &layers.height);
    }
    let finish = Finish::draw(&parameters, moments, &mut appearance);
    let heights = layers.height.data().iter();
    let height_range = heights.fold((f32::MAX, f32::MIN), |(lo, hi), &h| (lo.min(h), hi.max(h)));
    let (n, data) = resample(n, data, sampling_grid(size).min(n));
    Texels {
        n,
        data,
        finish,
        height_range,
        rough,
    }
}

/// Texels with colour, polish and height, unshaded.
fn paint(layers: &Layers, parameters: &Parameters, stream: &mut Stream) -> Vec<Texel> {
    let profile = parameters.profile;
    let colours = Colours::draw(profile.palette, stream);
    let printed = stream.chance(profile.printed);
    let mask = printed.then(|| relief::print_mask(layers.height.n(), stream));
    let (height, tone, polish) = (&layers.height, &layers.tone, &layers.polish);
    // How dye and dirt have settled. It looks like shading and says nothing of the height: seen from
    // straight above, a flat dirty surface and a clean deep one can be the same picture.
    let hollow = stream.between32(-0.1, 0.4) * profile.structure.dirt();
    let contrast = stream.between32(0.5, 1.3);
    let (mean, scale) = (tone.mean(), 0.5 / height.deviation().max(1e-6));
    (0..height.data().len())
        .map(|at| {
            let tone = mean + contrast * (tone[at] - mean);
            let depth = (height[at] * scale).clamp(-1.0, 1.0);
            let shade = 1.0 - hollow * (0.5 - 0.5 * depth);
            let mut colour = colours.at(tone).map(|c| c * shade);
            if let Some(mask) = &mask {
                // A print keeps the shading of the yarn or grain beneath it.
                let (share, depth) = (mask[at], 0.7 + 0.5 * tone.clamp(0.0, 1.0));
                for (c, print) in colour.iter_mut().zip(colours.print) {
                    *c += (print * depth - *c) * share;
                }
            }
            let mut texel = [0.0; CHANNELS];
            texel[channel::ALBEDO..channel::ALBEDO + 3].copy_from_slice(&colour);
            texel[channel::AMBIENT] = 1.0;
            texel[channel::HORIZON] = -1e3;
            texel[channel::POLISH] = polish[at].clamp(0.0, 1.0);
            texel[channel::HEIGHT] = height[at];
            texel
        })
        .collect()
}

/// Central differences, and the means of their squares over the surface.
fn add_slopes(data: &mut [Texel], height: &Grid) -> [f32; 2] {
    let n = height.n();
    let scale = 0.5 * n as f32 / TILE_MM as f32;
    let mut sums = [0.0f64; 2];
    for y in 0..n {
        let [above, here, below] = [y + n - 1, y, y + 1].map(|y| height.row(y % n));
        let row = &mut data[y * n..(y + 1) * n];
        for (x, texel) in row.iter_mut().enumerate() {
            let left = if x == 0 { n - 1 } else { x - 1 };
            let right = if x + 1 == n { 0 } else { x + 1 };
            let sx = ((here[right] - here[left]) * scale).clamp(-STEEPEST, STEEPEST);
            let sy = ((below[x] - above[x]) * scale).clamp(-STEEPEST, STEEPEST);
            texel[channel::SLOPE_X] = sx;
            texel[channel::SLOPE_Y] = sy;
            texel[channel::MOMENT_XX] = sx * sx;
            texel[channel::MOMENT_YY] = sy * sy;
            texel[channel::MOMENT_XY] = sx * sy;
            sums[0] += f64::from(sx * sx);
            sums[1] += f64::from(sy * sy);
        }
    }
    sums.map(|s| (s / (n * n) as f64) as f32)
}

fn shadow(data: &mut [Texel], height: &Grid) {
    let ambient = ambient_occlusion(height);
    let horizon = light_horizon(height);
    for (at, texel) in data.iter_mut().enumerate() {
        texel[channel::AMBIENT] = ambient[at];
        texel[channel::HORIZON] = horizon[at];
    }
}

impl Finish {
    /// The unresolved roughness is anisotropic along the same axis as the resolved relief.
    fn draw(parameters: &Parameters, moments: [f32; 2], stream: &mut Stream) -> Self {
        let profile = parameters.profile;
        let coated = stream.chance(profile.coated);
        // A coat is what is touched and what shines; under it the base has its usual grain.
        let own = parameters.alpha as f32;
        let alpha = if coated { UNDER_COAT } else { own };
        let ratio = profile.anisotropy as f32;
        let mut spread = [alpha * alpha * ratio, alpha * alpha / ratio];
        if moments[0] <= moments[1] {
            spread.reverse();
        }
        Self {
            metal: profile.f0 == 0.0,
            f0: profile.f0 as f32,
            spread: Spread::along(spread),
            sheen: parameters.sheen as f32,
            coat: coated.then_some(COAT_SHARE * own),
        }
    }
}
