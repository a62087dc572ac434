//! Luminance and chroma back to RGB, as OpenEXR's own `RgbaInputFile` does it: odd chroma samples
//! are interpolated by a 27-tap filter, along rows and then along columns, and pixels far more
//! saturated than their neighbours, which the interpolation makes beside edges, are toned down.

use exr::math::Vec2;
use exr::meta::attribute::Chromaticities;

/// Weights of the samples 1, 3, ... 13 to either side of one that is to be interpolated.
const HALF_FILTER: [f32; 7] = [
    0.627_123, -0.186_077, 0.087_929, -0.043_159, 0.019_597, -0.007_540, 0.002_128,
];

type Rgb = [f32; 3];

/// The stored samples of one chroma channel.
#[derive(Default)]
pub(super) struct Chroma {
    width: usize,
    /// 1 or 2, along rows and columns alike.
    sampling: usize,
    data: Vec<f32>,
}

/// Luminance of red, green and blue; they sum to 1.
#[derive(Clone, Copy)]
pub(super) struct LuminanceWeights([f32; 3]);

impl Chroma {
    /// For a picture of that size.
    pub(super) fn new(width: usize, height: usize, sampling: Vec2<usize>) -> Self {
        let (width, rows) = (width / sampling.0, height / sampling.1);
        Self {
            width,
            sampling: sampling.0,
            data: vec![0.0; width * rows],
        }
    }

    /// The samples stored with row `y` of the picture.
    pub(super) fn row_mut(&mut self, y: usize) -> &mut [f32] {
        let start = y / self.sampling * self.width;
        &mut self.data[start..start + self.width]
    }

    /// Every stored row with its odd columns filled in.
    fn widened(&self) -> Vec<f32> {
        let mut wide = Vec::with_capacity(self.data.len() * 2);
        for row in self.data.chunks_exact(self.width) {
            for x in 0..self.width {
                let between = interpolate(x as isize, self.width, |at| row[at]);
                wide.extend([row[x], between]);
            }
        }
        wide
    }
}

/// The value halfway between samples `before` and `before + 1` of `count`, beyond whose ends the
/// outermost repeat.
fn interpolate(before: isize, count: usize, sample: impl Fn(usize) -> f32) -> f32 {
    let last = count as isize - 1;
    let at = |index: isize| sample(index.clamp(0, last) as usize);
    let taps = (0..).zip(HALF_FILTER);
    taps.map(|(step, weight)| weight * (at(before - step) + at(before + 1 + step)))
        .sum()
}

/// Turns `data`, whose middle channel is luminance, into RGB in place.
pub(super) fn reconstruct(
    data: &mut [f32],
    width: usize,
    height: usize,
    chroma: &[Chroma; 2],
    weights: LuminanceWeights,
) {
    if chroma[0].sampling == 1 {
        let samples = chroma[0].data.iter().zip(&chroma[1].data);
        for (pixel, (&ry, &by)) in data.as_chunks_mut::<3>().0.iter_mut().zip(samples) {
            *pixel = weights.rgb(pixel[1], ry, by);
        }
        return;
    }
    let rows = Rows {
        width,
        height,
        wide: chroma.each_ref().map(Chroma::widened),
        weights,
    };
    // Rows are replaced one behind where they are read, and each needs both neighbours.
    let mut above = rows.rgb(data, -1);
    let mut row = rows.rgb(data, 0);
    for y in 0..height {
        let below = if y + 1 < height {
            rows.rgb(data, y as isize + 1)
        } else {
            above.clone()
        };
        let to = &mut data[y * width * 3..(y + 1) * width * 3];
        for (x, pixel) in to.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            *pixel = weights.tone_down(row[x], mean_saturation([&above, &below], x));
        }
        above = std::mem::replace(&mut row, below);
    }
}

/// A picture whose chroma is complete along rows but not along columns.
struct Rows {
    width: usize,
    height: usize,
    wide: [Vec<f32>; 2],
    weights: LuminanceWeights,
}

impl Rows {
    /// Row `y`, which may be -1: the first row under chroma beyond the edge.
    fn rgb(&self, data: &[f32], y: isize) -> Vec<Rgb> {
        let stored = self.height / 2;
        let chroma = |plane: &[f32], x: usize| {
            let sample = |row: usize| plane[row * self.width + x];
            if y % 2 == 0 {
                sample(y as usize / 2)
            } else {
                interpolate(y.div_euclid(2), stored, sample)
            }
        };
        let start = y.max(0) as usize * self.width;
        let pixel = |x: usize| {
            let luminance = data[(start + x) * 3 + 1];
            let [ry, by] = self.wide.each_ref().map(|plane| chroma(plane, x));
            self.weights.rgb(luminance, ry, by)
        };
        (0..self.width).map(pixel).collect()
    }
}

impl LuminanceWeights {
    /// Of the picture's primaries and white; Rec. 709 where it does not name them, or names some
    /// that span no colours.
    pub(super) fn of(chromaticities: Option<Chromaticities>) -> Self {
        const REC_709: [f32; 3] = [0.212_639, 0.715_169, 0.072_192];
        let named = chromaticities.and_then(from_primaries);
        Self(named.unwrap_or(REC_709))
    }

    fn rgb(self, luminance: f32, ry: f32, by: f32) -> Rgb {
        if ry == 0.0 && by == 0.0 {
            return [luminance; 3];
        }
        let Self([red_weight, green_weight, blue_weight]) = self;
        let (red, blue) = ((ry + 1.0) * luminance, (by + 1.0) * luminance);
        [
            red,
            (luminance - red * red_weight - blue * blue_weight) / green_weight,
            blue,
        ]
    }

    fn luminance(self, rgb: Rgb) -> f32 {
        let weighted = rgb.iter().zip(self.0);
        weighted.map(|(value, weight)| value * weight).sum()
    }

    /// Brings the saturation down to three quarters of the way from `mean` to 1, at constant
    /// luminance.
    fn tone_down(self, rgb: Rgb, mean: f32) -> Rgb {
        let own = saturation(rgb);
        let most = (1.0 - (1.0 - mean) * 0.25).min(1.0);
        // Not `own <= most`: what is NaN is left as it is.
        if !(own > mean && own > most) {
            return rgb;
        }
        let peak = rgb.into_iter().fold(f32::NEG_INFINITY, f32::max);
        let toned = rgb.map(|value| (peak - (peak - value) * most / own).max(0.0));
        let luminance = self.luminance(toned);
        if luminance > 0.0 {
            toned.map(|value| value * self.luminance(rgb) / luminance)
        } else {
            toned
        }
    }
}

fn saturation(rgb: Rgb) -> f32 {
    let most = rgb.into_iter().fold(f32::NEG_INFINITY, f32::max);
    let least = rgb.into_iter().fold(f32::INFINITY, f32::min);
    if most > 0.0 { 1.0 - least / most } else { 0.0 }
}

/// Of the four pixels diagonal to column `x`.
fn mean_saturation(rows: [&[Rgb]; 2], x: usize) -> f32 {
    let of_row = |row: &[Rgb]| {
        let right = (x + 1).min(row.len() - 1);
        saturation(row[x.saturating_sub(1)]) + saturation(row[right])
    };
    let sum: f32 = rows.into_iter().map(of_row).sum();
    (sum / 4.0).min(1.0)
}

/// The Y row of the matrix from RGB to XYZ (SMPTE RP 177), scaled to sum 1.
fn from_primaries(primaries: Chromaticities) -> Option<[f32; 3]> {
    let xyz = |point: Vec2<f32>| {
        let (x, y) = (f64::from(point.0), f64::from(point.1));
        [x, y, 1.0 - x - y]
    };
    let Chromaticities {
        red,
        green,
        blue,
        white,
    } = primaries;
    let [red, green, blue, white] = [red, green, blue, white].map(xyz);
    let determinant = |a: [f64; 3], b: [f64; 3], c: [f64; 3]| {
        a[0] * (b[1] * c[2] - c[1] * b[2]) - b[0] * (a[1] * c[2] - c[1] * a[2])
            + c[0] * (a[1] * b[2] - b[1] * a[2])
    };
    let luminance = [
        determinant(white, green, blue) * red[1],
        determinant(red, white, blue) * green[1],
        determinant(red, green, white) * blue[1],
    ];
    let sum: f64 = luminance.iter().sum();
    let weights = luminance.map(|value| (value / sum) as f32);
    let usable = weights.iter().all(|weight| weight.is_finite()) && weights[1] > 0.0;
    usable.then_some(weights)
}
