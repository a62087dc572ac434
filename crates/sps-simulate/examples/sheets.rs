//! Draws the pictures of `docs/simulator/`: each material at -45, 0 and 45 degrees, and patterns.
//!
//! `cargo run --release -p sps-simulate --example sheets -- docs/simulator`

use std::error::Error;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::{Rgb, RgbImage, imageops};
use sps_dataset::Source;
use sps_simulate::{Patterns, Simulator, SimulatorSpec};

const SIZE: usize = 128;

/// Rows of each picture; three surfaces a row, at three angles each.
const SHEETS: [(&str, &str); 3] = [
    ("classes-1.jpg", "plastic leather wood cotton upholstery"),
    ("classes-2.jpg", "towel sponge denim foam carpet"),
    ("classes-3.jpg", "stone linen silk ceramic steel brass"),
];

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).ok_or("expected a folder")?;
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder)?;
    let simulator = Simulator::new(SimulatorSpec {
        surfaces: 400,
        size: SIZE,
        views: 3,
        ..SimulatorSpec::default()
    })?;
    for (name, materials) in SHEETS {
        let mut pictures = Vec::new();
        for material in materials.split(' ') {
            let all = simulator.surfaces().iter().enumerate();
            let of_it = all.filter(|(_, surface)| surface.material == material);
            for (surface, _) in of_it.take(3) {
                for view in 0..3 {
                    pictures.push(simulator.frame_bytes(surface, view)?);
                }
            }
            // A material of fewer surfaces leaves the rest of its row white.
            let row = pictures.len().next_multiple_of(9);
            pictures.resize(row, vec![255; 3 * SIZE * SIZE]);
        }
        write(&folder.join(name), pictures)?;
    }
    // Three images of each of eighteen classes.
    let patterns = Patterns::new(1);
    let picture = |place: usize| {
        let frame = patterns.frame(place / 3, place % 3, SIZE);
        frame.data.iter().map(|v| (255.0 * v) as u8).collect()
    };
    let pictures = (0..54).map(picture).collect();
    write(&folder.join("patterns.jpg"), pictures)
}

/// Nine pictures a row.
fn write(path: &Path, pictures: Vec<Vec<u8>>) -> Result<(), Box<dyn Error>> {
    let (side, apart) = (SIZE as u32, SIZE as u32 + 2);
    let rows = pictures.len().div_ceil(9) as u32;
    let mut sheet = RgbImage::from_pixel(9 * apart, rows * apart, Rgb([255; 3]));
    for (place, bytes) in (0..).zip(pictures) {
        let picture = RgbImage::from_raw(side, side, bytes).ok_or("a picture of another size")?;
        let (x, y) = (place % 9 * apart, place / 9 * apart);
        imageops::replace(&mut sheet, &picture, x.into(), y.into());
    }
    let file = BufWriter::new(File::create(path)?);
    Ok(sheet.write_with_encoder(JpegEncoder::new_with_quality(file, 88))?)
}
