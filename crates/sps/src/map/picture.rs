//! A map as a picture: colours over the photograph, and a legend.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use anyhow::Result;
use font8x8::{BASIC_FONTS, UnicodeFonts};
use sps_estimator::{Frame, Map};

use super::Wanted;
use super::scale::Scale;

/// Pixels that a letter takes either way.
const LETTER: usize = 8;
const MARGIN: usize = 8;
const BAR: usize = 16;
/// Pixels between the lines of a hatching.
const HATCHING: usize = 6;
/// How much of a place's colour is the property's.
const COLOUR: f32 = 0.75;
/// The PNG keyword under which a picture names its photograph.
const SOURCE: &str = "Source";

/// RGB, row by row.
pub(super) struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

/// The photograph in grey under the colours of its places; where nothing was estimated it stays bare.
/// Places whose p-value is low are hatched. The legend is to the right.
pub(super) fn draw(
    (photograph, map): (&Frame, &Map),
    places: &[[f64; 4]],
    wanted: &Wanted,
    scale: &Scale,
) -> Picture {
    let legend = Legend::of(wanted, scale, map.predictions.familiar.is_some());
    let height = photograph.height.max(14 * LETTER + 5 * MARGIN);
    let mut picture = Picture::new(photograph.width + legend.width(), height);
    let rows = windows(map, 0, photograph.height, (map.rows, map.columns));
    let columns = windows(map, 1, photograph.width, (map.columns, 1));
    let colours: Vec<[f32; 3]> = places.iter().map(|place| scale.colour(place[0])).collect();
    for (y, row) in rows.into_iter().enumerate() {
        for (x, column) in columns.iter().enumerate() {
            let bare = grey(photograph, x, y);
            let colour = row.zip(*column).map_or([bare; 3], |(row, column)| {
                let place = row * map.columns + column;
                let [.., familiar] = places[place];
                if familiar <= wanted.unfamiliar && (x + y) % HATCHING == 0 {
                    return [0.0; 3];
                }
                colours[place].map(|c| COLOUR * c + (1.0 - COLOUR) * bare)
            });
            picture.set(x, y, colour.map(byte));
        }
    }
    legend.draw(&mut picture, photograph.width + MARGIN, scale);
    picture
}

/// What stands beside a map.
struct Legend<'a> {
    property: &'a str,
    /// Beside the colours, from the top.
    labels: [String; 3],
    /// Whether places have p-values, by which they are hatched.
    hatched: bool,
    /// Beside the sample of hatching.
    key: String,
    intervals: String,
}

impl<'a> Legend<'a> {
    fn of(wanted: &'a Wanted, scale: &Scale, familiar: bool) -> Self {
        let middle = f64::midpoint(scale.lowest, scale.highest);
        Self {
            property: &wanted.property,
            labels: [scale.highest, middle, scale.lowest].map(|value| scale.shown(value)),
            hatched: familiar,
            key: if familiar {
                format!("p <= {}", wanted.unfamiliar)
            } else {
                "no p-value".to_owned()
            },
            intervals: scale.intervals().unwrap_or_default(),
        }
    }

    fn width(&self) -> usize {
        let key = self.labels.iter().chain([&self.key]);
        let key = key.map(|text| BAR + MARGIN + LETTER * text.chars().count());
        let line = [self.property, &self.intervals].map(|text| LETTER * text.chars().count());
        2 * MARGIN + key.chain(line).max().unwrap_or(0)
    }

    /// Draws it at `left`, from the top of the picture to its bottom.
    fn draw(&self, picture: &mut Picture, left: usize, scale: &Scale) {
        picture.write(self.property, left, MARGIN);
        let top = 2 * MARGIN + LETTER;
        let bottom = picture.height - 4 * MARGIN - 3 * LETTER;
        for y in top..bottom {
            let share = (bottom - 1 - y) as f64 / (bottom - 1 - top).max(1) as f64;
            let colour = scale.colour(scale.lowest + share * (scale.highest - scale.lowest));
            for x in left..left + BAR {
                picture.set(x, y, colour.map(byte));
            }
        }
        let text = left + BAR + MARGIN;
        for (at, label) in self.labels.iter().enumerate() {
            picture.write(label, text, top + at * (bottom - top - LETTER) / 2);
        }
        for y in 0..2 * LETTER {
            for x in 0..BAR {
                let line = self.hatched && (x + y) % HATCHING == 0;
                let shade = if line { 0 } else { 200 };
                picture.set(left + x, bottom + MARGIN + y, [shade; 3]);
            }
        }
        picture.write(&self.key, text, bottom + MARGIN + LETTER / 2);
        picture.write(&self.intervals, left, bottom + 2 * MARGIN + 2 * LETTER);
    }
}

/// The photograph that the map at `path` is of; none where the file is no map that says so.
pub(crate) fn source(path: &Path) -> Option<String> {
    let file = BufReader::new(File::open(path).ok()?);
    let reader = png::Decoder::new(file).read_info().ok()?;
    let mut texts = reader.info().utf8_text.iter();
    texts.find(|text| text.keyword == SOURCE)?.get_text().ok()
}

/// For each pixel along an axis the window whose centre is nearest, as long as it lies in it; the centres
/// of `count` windows stand `step` apart in the map.
fn windows(map: &Map, axis: usize, pixels: usize, of: (usize, usize)) -> Vec<Option<usize>> {
    let (count, step) = of;
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

/// A brightness from 0 to 1 as a picture has it.
fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
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

    /// The content of a PNG file that names the photograph.
    pub(super) fn png(&self, photograph: &Path) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.add_itxt_chunk(SOURCE.to_owned(), photograph.display().to_string())?;
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.pixels.as_flattened())?;
        writer.finish()?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use colorous::CIVIDIS;
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
                familiar: places[0][3].is_finite().then(Vec::new),
            },
        };
        let wanted = Wanted {
            property: "fRS".to_owned(),
            at: 0,
            sight: Sight::Within,
            unfamiliar: 0.05,
        };
        let scale = Scale::of(&places, 0.9, 1.0);
        draw((&photograph, &map), &places, &wanted, &scale)
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
        let written = picture.png(Path::new("a.png")).unwrap();
        let decoded = png::Decoder::new(std::io::Cursor::new(written));
        let size = (picture.width as u32, picture.height as u32);
        assert_eq!(decoded.read_info().unwrap().info().size(), size);
    }

    /// Nothing to tell apart, and no p-value.
    #[test]
    fn hard_cases() {
        let picture = drawn([[2.0, f64::NAN, f64::NAN, f64::NAN]; 2]);
        let at = |x: usize| picture.pixels[4 * picture.width + x];
        assert_eq!(at(3), at(13));
        assert_ne!(at(3), [0; 3]);
        // The sample in the legend is not hatched either.
        let sample = |picture: &Picture| {
            let (left, top) = (30 + MARGIN, picture.height - 3 * MARGIN - 3 * LETTER);
            let rows = (top..top + 2 * LETTER).map(|y| y * picture.width + left);
            let pixels = rows.flat_map(|start| picture.pixels[start..start + BAR].to_vec());
            pixels.filter(|pixel| *pixel == [0; 3]).count()
        };
        assert_eq!(sample(&picture), 0);
        assert!(sample(&drawn([[2.0, 0.0, 3.0, 0.5]; 2])) > 0);
    }
}
