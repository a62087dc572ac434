//! A map as a picture: colours over the photograph, and a legend.

use anyhow::Result;
use colorous::CIVIDIS;
use font8x8::{BASIC_FONTS, UnicodeFonts};
use sps_estimator::{Frame, Map};

use super::Wanted;

/// Pixels that a letter takes either way.
const LETTER: usize = 8;
const MARGIN: usize = 8;
const BAR: usize = 16;
/// Pixels between the lines of a hatching.
const HATCHING: usize = 6;
/// How much of a place's colour is the property's.
const COLOUR: f32 = 0.75;

/// RGB, row by row.
pub(super) struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

/// The photograph in grey under the colours of its places; where nothing was estimated it stays bare.
/// Places whose p-value is low are hatched. The legend is to the right.
pub(super) fn draw(
    photograph: &Frame,
    map: &Map,
    places: &[[f64; 4]],
    wanted: &Wanted<'_>,
) -> Picture {
    let scale = Scale::of(places);
    let labels = [
        scale.highest,
        f64::midpoint(scale.lowest, scale.highest),
        scale.lowest,
    ];
    let labels = labels.map(|value| format!("{value:.1}"));
    let hatched = format!("p <= {}", wanted.unfamiliar);
    let letters = labels
        .iter()
        .map(String::len)
        .chain([wanted.property.len(), hatched.len()]);
    let legend = BAR + 3 * MARGIN + LETTER * letters.max().unwrap_or(0);
    let height = photograph.height.max(12 * LETTER + 4 * MARGIN);
    let mut picture = Picture::new(photograph.width + legend, height);
    let rows = windows(map, 0, photograph.height, (map.rows, map.columns));
    let columns = windows(map, 1, photograph.width, (map.columns, 1));
    for (y, row) in rows.into_iter().enumerate() {
        for (x, column) in columns.iter().enumerate() {
            let bare = grey(photograph, x, y);
            let place = row.zip(*column);
            let colour = place.map_or([bare; 3], |(row, column)| {
                let [value, _, _, familiar] = places[row * map.columns + column];
                let hatch = familiar <= wanted.unfamiliar && (x + y) % HATCHING == 0;
                if hatch {
                    [0.0; 3]
                } else {
                    scale.colour(value).map(|c| mixed(c, bare))
                }
            });
            picture.set(
                x,
                y,
                colour.map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8),
            );
        }
    }
    let left = photograph.width + MARGIN;
    picture.write(wanted.property, left, MARGIN);
    let (top, bottom) = (2 * MARGIN + LETTER, height - 3 * MARGIN - 2 * LETTER);
    for y in top..bottom {
        let share = (bottom - 1 - y) as f64 / (bottom - 1 - top).max(1) as f64;
        let colour = scale.colour(scale.lowest + share * (scale.highest - scale.lowest));
        for x in left..left + BAR {
            picture.set(x, y, colour.map(|value| (value * 255.0).round() as u8));
        }
    }
    let text = left + BAR + MARGIN;
    for (at, label) in labels.iter().enumerate() {
        picture.write(label, text, top + at * (bottom - top - LETTER) / 2);
    }
    for y in 0..2 * LETTER {
        for x in 0..BAR {
            let shade = if (x + y) % HATCHING == 0 { 0 } else { 200 };
            picture.set(left + x, bottom + MARGIN + y, [shade; 3]);
        }
    }
    picture.write(&hatched, text, bottom + MARGIN + LETTER / 2);
    picture
}

/// The ends of the colours: those of the estimates.
struct Scale {
    lowest: f64,
    highest: f64,
}

impl Scale {
    fn of(places: &[[f64; 4]]) -> Self {
        let values = places.iter().map(|place| place[0]);
        Self {
            lowest: values.clone().fold(f64::INFINITY, f64::min),
            highest: values.fold(f64::NEG_INFINITY, f64::max),
        }
    }

    /// Cividis (Nuñez, Anderton and Renslow 2018), which people see alike whether or not they tell red
    /// from green.
    fn colour(&self, value: f64) -> [f32; 3] {
        let room = self.highest - self.lowest;
        let share = if room > 0.0 {
            (value - self.lowest) / room
        } else {
            0.5
        };
        let colour = CIVIDIS.eval_continuous(share.clamp(0.0, 1.0));
        [colour.r, colour.g, colour.b].map(|value| f32::from(value) / 255.0)
    }
}

/// For each pixel along an axis the window whose centre is nearest, as long as it lies in it; the centres
/// of `count` windows stand `step` apart in the map.
fn windows(
    map: &Map,
    axis: usize,
    pixels: usize,
    (count, step): (usize, usize),
) -> Vec<Option<usize>> {
    let nearest = |pixel: usize| {
        let distance = |at: &usize| (map.centres[at * step][axis] - (pixel as f64 + 0.5)).abs();
        let nearest = (0..count).min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        (distance(&nearest) <= map.window[axis] as f64 / 2.0).then_some(nearest)
    };
    (0..pixels).map(nearest).collect()
}

/// How bright a pixel of the photograph is.
fn grey(photograph: &Frame, x: usize, y: usize) -> f32 {
    let at = 3 * (y * photograph.width + x);
    let [red, green, blue] = [0, 1, 2].map(|channel| photograph.data[at + channel]);
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

fn mixed(colour: f32, bare: f32) -> f32 {
    COLOUR * colour + (1.0 - COLOUR) * bare
}

impl Picture {
    /// A white one.
    fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            pixels: vec![[255; 3]; width * height],
        }
    }

    fn set(&mut self, x: usize, y: usize, colour: [u8; 3]) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = colour;
        }
    }

    /// Writes a text in black, its upper left corner here.
    fn write(&mut self, text: &str, x: usize, y: usize) {
        for (place, letter) in text.chars().enumerate() {
            let rows = BASIC_FONTS.get(letter).unwrap_or_default();
            for (down, row) in rows.into_iter().enumerate() {
                for right in (0..LETTER).filter(|right| row >> right & 1 == 1) {
                    self.set(x + place * LETTER + right, y + down, [0; 3]);
                }
            }
        }
    }

    /// The content of a PNG file.
    pub(super) fn png(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.pixels.as_flattened())?;
        writer.finish()?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use sps_estimator::{Predictions, Sight};

    use super::*;

    /// Two windows side by side over a photograph that is wider than both.
    fn drawn(places: [[f64; 4]; 2]) -> Picture {
        let photograph = Frame {
            width: 30,
            height: 10,
            data: vec![0.5; 30 * 10 * 3],
        };
        let map = Map {
            rows: 1,
            columns: 2,
            window: [10, 10],
            centres: vec![[5.0, 5.0], [5.0, 15.0]],
            predictions: Predictions {
                properties: Vec::new(),
                familiar: None,
            },
        };
        let wanted = Wanted {
            property: "fRS",
            sight: Sight::Within,
            unfamiliar: 0.05,
        };
        draw(&photograph, &map, &places, &wanted)
    }

    #[test]
    fn places_have_the_colours_of_the_legend() {
        let picture = drawn([[1.0, 0.0, 0.0, 0.5], [3.0, 0.0, 0.0, 0.01]]);
        let at = |x: usize, y: usize| picture.pixels[y * picture.width + x];
        let blended = |t: f64| {
            let colour = CIVIDIS.eval_continuous(t);
            [colour.r, colour.g, colour.b]
                .map(|c| (0.75 * f32::from(c) + 0.25 * 127.5).round() as u8)
        };
        assert_eq!(at(3, 4), blended(0.0));
        assert_eq!(at(16, 3), blended(1.0));
        // Hatched, and bare where no window lies.
        assert_eq!(at(14, 4), [0; 3]);
        assert_eq!(at(25, 4), [128; 3]);
        let decoded = png::Decoder::new(std::io::Cursor::new(picture.png().unwrap()));
        let info = decoded.read_info().unwrap();
        assert_eq!(
            info.info().size(),
            (picture.width as u32, picture.height as u32)
        );
    }

    /// Nothing to tell apart, and no p-value.
    #[test]
    fn hard_cases() {
        let picture = drawn([[2.0, f64::NAN, f64::NAN, f64::NAN]; 2]);
        let at = |x: usize| picture.pixels[4 * picture.width + x];
        assert_eq!(at(3), at(13));
        assert_ne!(at(3), [0; 3]);
    }
}
