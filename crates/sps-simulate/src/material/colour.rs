//! Colours: what can be seen and, within a material, says almost nothing about touch.

use serde::Deserialize;

use super::super::stream::Stream;

/// Linear-light RGB reflectance.
pub(crate) type Rgb = [f32; 3];

/// A family of colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Palette {
    Dyed,
    Undyed,
    Tweed,
    Denim,
    Jute,
    Hide,
    Leather,
    Foam,
    Sponge,
    Paper,
    Cardboard,
    Cork,
    Plastic,
    Dark,
    Wood,
    Bamboo,
    Granite,
    Marble,
    Sandstone,
    Concrete,
    Paint,
    Grit,
    Glaze,
    Glass,
    Steel,
    Aluminium,
    Brass,
    Copper,
}

/// The colours of one surface: the four stops that the structure's tone runs through, and the
/// second colour of a print.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Colours {
    pub(crate) stops: [Rgb; 4],
    pub(crate) print: Rgb,
}

impl Colours {
    pub(crate) fn draw(palette: Palette, stream: &mut Stream) -> Self {
        Self {
            stops: stops(palette, stream),
            print: dye(stream),
        }
    }

    /// The colour at `t` in 0 to 1, piecewise linear through the stops.
    pub(crate) fn at(&self, t: f32) -> Rgb {
        let place = t.clamp(0.0, 1.0) * 3.0;
        let i = (place as usize).min(2);
        lerp(self.stops[i], self.stops[i + 1], place - i as f32)
    }
}

fn stops(palette: Palette, stream: &mut Stream) -> [Rgb; 4] {
    match palette {
        Palette::Dyed => around(dye(stream), 0.18),
        Palette::Undyed => {
            let base = natural([0.62, 0.52, 0.38], 0.25, stream);
            around(sometimes(base, 0.4, dye, stream), 0.35)
        }
        Palette::Tweed => {
            let (a, b) = (muted(stream), muted(stream));
            [scaled(a, 0.75), a, lerp(a, b, 0.5), b]
        }
        Palette::Denim => denim(stream),
        Palette::Jute => around(natural([0.42, 0.29, 0.15], 0.25, stream), 0.45),
        Palette::Hide => {
            let dark = natural([0.08, 0.05, 0.03], 0.8, stream);
            let light = natural([0.5, 0.38, 0.26], 0.5, stream);
            around(lerp(dark, light, stream.unit() as f32), 0.5)
        }
        Palette::Leather => leather(stream),
        Palette::Foam => {
            let base = match stream.index(4) {
                0 => natural([0.75, 0.72, 0.62], 0.15, stream),
                1 => natural([0.07, 0.07, 0.075], 0.5, stream),
                2 => natural([0.3, 0.3, 0.31], 0.4, stream),
                _ => dye(stream),
            };
            shades(base, [0.35, 0.75, 1.12])
        }
        Palette::Sponge => {
            let base = match stream.index(3) {
                0 => natural([0.75, 0.52, 0.14], 0.3, stream),
                1 => natural([0.12, 0.32, 0.1], 0.6, stream),
                _ => vivid(stream),
            };
            shades(base, [0.25, 0.7, 1.15])
        }
        Palette::Plastic | Palette::Paint => {
            let base = match stream.index(4) {
                0 => natural([0.75, 0.74, 0.71], 0.15, stream),
                1 => natural([0.05, 0.05, 0.05], 0.7, stream),
                2 => muted(stream),
                _ => vivid(stream),
            };
            let white = if palette == Palette::Paint { 0.6 } else { 0.0 };
            around(lerp(base, [0.8, 0.78, 0.74], white), 0.06)
        }
        Palette::Dark => {
            let base = natural([0.045, 0.045, 0.048], 0.6, stream);
            around(sometimes(base, 0.25, muted, stream), 0.12)
        }
        Palette::Paper => {
            let white = natural([0.82, 0.8, 0.75], 0.1, stream);
            around(sometimes(white, 0.35, muted, stream), 0.06)
        }
        Palette::Cardboard => around(natural([0.42, 0.29, 0.17], 0.2, stream), 0.1),
        Palette::Cork => {
            let base = natural([0.42, 0.26, 0.14], 0.2, stream);
            shades(base, [0.3, 0.8, 1.35])
        }
        Palette::Wood => wood(stream),
        Palette::Bamboo => {
            let base = natural([0.56, 0.39, 0.2], 0.25, stream);
            shades(base, [0.6, 0.9, 1.15])
        }
        Palette::Granite => granite(stream),
        Palette::Marble => marble(stream),
        Palette::Sandstone => around(natural([0.5, 0.36, 0.23], 0.45, stream), 0.45),
        Palette::Concrete => around(natural([0.36, 0.355, 0.34], 0.3, stream), 0.25),
        Palette::Grit => around(natural([0.2, 0.11, 0.07], 0.8, stream), 0.6),
        Palette::Glaze => {
            let base = match stream.index(3) {
                0 => natural([0.78, 0.76, 0.7], 0.15, stream),
                1 => muted(stream),
                _ => vivid(stream),
            };
            shades(base, [0.55, 0.95, 1.1])
        }
        Palette::Glass => around(natural([0.1, 0.16, 0.15], 0.6, stream), 0.05),
        // Reflectance at normal incidence, after Gulbrandsen, JCGT 3(4), 2014.
        Palette::Steel => around(natural([0.53, 0.51, 0.49], 0.08, stream), 0.12),
        Palette::Aluminium => around(natural([0.68, 0.69, 0.7], 0.08, stream), 0.12),
        Palette::Brass => around(natural([0.82, 0.66, 0.33], 0.08, stream), 0.14),
        Palette::Copper => around(natural([0.9, 0.58, 0.43], 0.08, stream), 0.2),
    }
}

/// The colour, or with this chance another.
fn sometimes(base: Rgb, chance: f64, other: fn(&mut Stream) -> Rgb, stream: &mut Stream) -> Rgb {
    if stream.chance(chance) {
        other(stream)
    } else {
        base
    }
}

/// Indigo or black warp (the last stop) over a pale weft (the first).
fn denim(stream: &mut Stream) -> [Rgb; 4] {
    let wash = stream.unit() as f32;
    let warp = match stream.index(5) {
        0 => lerp([0.012, 0.012, 0.014], [0.12, 0.12, 0.125], wash),
        1 => lerp([0.06, 0.06, 0.065], [0.3, 0.3, 0.31], wash),
        _ => lerp([0.01, 0.016, 0.05], [0.12, 0.2, 0.36], wash),
    };
    let warp = natural(warp, 0.2, stream);
    let weft = natural([0.52, 0.52, 0.5], 0.25, stream);
    let weft = lerp(weft, warp, 0.25 * stream.unit() as f32);
    [weft, lerp(weft, warp, 0.4), lerp(weft, warp, 0.85), warp]
}

fn leather(stream: &mut Stream) -> [Rgb; 4] {
    let base = match stream.index(6) {
        0 => natural([0.02, 0.018, 0.017], 0.5, stream),
        1 => natural([0.09, 0.035, 0.018], 0.5, stream),
        2 => natural([0.3, 0.13, 0.05], 0.4, stream),
        3 => natural([0.5, 0.38, 0.25], 0.35, stream),
        4 => natural([0.7, 0.66, 0.58], 0.15, stream),
        _ => muted(stream),
    };
    shades(base, [0.5, 0.85, 1.15])
}

fn wood(stream: &mut Stream) -> [Rgb; 4] {
    // Maple, pine, oak, cherry, walnut, wenge.
    const SPECIES: [(Rgb, Rgb); 6] = [
        ([0.5, 0.36, 0.22], [0.66, 0.5, 0.34]),
        ([0.44, 0.24, 0.09], [0.68, 0.48, 0.25]),
        ([0.25, 0.14, 0.06], [0.47, 0.31, 0.16]),
        ([0.23, 0.08, 0.035], [0.42, 0.19, 0.09]),
        ([0.055, 0.03, 0.018], [0.17, 0.095, 0.055]),
        ([0.02, 0.013, 0.009], [0.08, 0.05, 0.035]),
    ];
    let (dark, light) = SPECIES[stream.index(SPECIES.len())];
    let gain = stream.between32(0.75, 1.3);
    let (dark, light) = (scaled(dark, gain), scaled(light, gain));
    [scaled(dark, 0.55), dark, lerp(dark, light, 0.6), light]
}

fn granite(stream: &mut Stream) -> [Rgb; 4] {
    let mica = natural([0.03, 0.03, 0.032], 0.6, stream);
    let quartz = natural([0.45, 0.44, 0.43], 0.3, stream);
    let feldspar = match stream.index(4) {
        0 => natural([0.5, 0.26, 0.18], 0.35, stream),
        1 => natural([0.08, 0.085, 0.09], 0.6, stream),
        2 => natural([0.45, 0.38, 0.26], 0.35, stream),
        _ => natural([0.66, 0.65, 0.62], 0.2, stream),
    };
    let (grey, pale) = (lerp(mica, quartz, 0.6), lerp(feldspar, quartz, 0.5));
    [mica, grey, feldspar, pale]
}

fn marble(stream: &mut Stream) -> [Rgb; 4] {
    let base = match stream.index(4) {
        0 => natural([0.05, 0.05, 0.052], 0.6, stream),
        1 => natural([0.1, 0.2, 0.14], 0.5, stream),
        2 => natural([0.55, 0.42, 0.3], 0.3, stream),
        _ => natural([0.74, 0.73, 0.7], 0.12, stream),
    };
    let vein = if base[1] > 0.3 {
        scaled(base, 0.3)
    } else {
        [0.5, 0.48, 0.45]
    };
    [vein, lerp(vein, base, 0.55), base, scaled(base, 1.05)]
}

/// Any hue, any depth.
fn dye(stream: &mut Stream) -> Rgb {
    match stream.index(5) {
        0 => natural([0.72, 0.71, 0.68], 0.15, stream),
        1 => natural([0.05, 0.05, 0.055], 0.7, stream),
        2 | 3 => muted(stream),
        _ => vivid(stream),
    }
}

fn vivid(stream: &mut Stream) -> Rgb {
    let (hue, saturation) = (stream.unit(), stream.between(0.65, 0.95));
    hsv(hue, saturation, stream.between(0.25, 0.85))
}

fn muted(stream: &mut Stream) -> Rgb {
    let (hue, saturation) = (stream.unit(), stream.between(0.1, 0.6));
    hsv(hue, saturation, stream.between(0.06, 0.6))
}

/// A colour scattered around `base` by up to `spread` in brightness, less in hue.
fn natural(base: Rgb, spread: f64, stream: &mut Stream) -> Rgb {
    let gain = 1.0 + spread * stream.between(-1.0, 1.0);
    base.map(|c| {
        let tint = 1.0 + 0.25 * spread * stream.between(-1.0, 1.0);
        reflectance((f64::from(c) * gain * tint) as f32)
    })
}

fn around(base: Rgb, spread: f32) -> [Rgb; 4] {
    [-1.0, -0.4, 0.2, 0.6].map(|share| scaled(base, 1.0 + share * spread))
}

/// Two darker than `base`, itself and a lighter one.
fn shades(base: Rgb, gains: [f32; 3]) -> [Rgb; 4] {
    let [darkest, darker, lighter] = gains.map(|gain| scaled(base, gain));
    [darkest, darker, base, lighter]
}

fn scaled(colour: Rgb, gain: f32) -> Rgb {
    colour.map(|c| reflectance(c * gain))
}

/// Nothing reflects less than soot or more than snow.
fn reflectance(c: f32) -> f32 {
    c.clamp(0.008, 0.92)
}

fn lerp(a: Rgb, b: Rgb, t: f32) -> Rgb {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * t)
}

/// From hue, saturation and value, all 0 to 1, value and result linear.
fn hsv(hue: f64, saturation: f64, value: f64) -> Rgb {
    let channel = |offset: f64| {
        let k = (offset + hue * 6.0) % 6.0;
        let dip = k.min(4.0 - k).clamp(0.0, 1.0);
        reflectance((value * (1.0 - saturation * dip)) as f32)
    };
    [channel(5.0), channel(3.0), channel(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hue_runs_red_green_blue() {
        for (hue, strongest) in [(0.0, 0), (1.0 / 3.0, 1), (2.0 / 3.0, 2)] {
            let colour = hsv(hue, 1.0, 0.8);
            assert_eq!(colour[strongest], 0.8);
            assert_eq!(colour.iter().filter(|&&c| c < 0.01).count(), 2);
        }
    }

    #[test]
    fn stops_are_met_and_between_is_linear() {
        let grey = |v| [v; 3];
        let colours = Colours {
            stops: [grey(0.0), grey(0.3), grey(0.6), grey(0.3)],
            print: grey(0.0),
        };
        assert_eq!(colours.at(0.0), grey(0.0));
        assert_eq!(colours.at(1.0), grey(0.3));
        assert!((colours.at(0.5)[0] - 0.45).abs() < 1e-6);
    }
}
