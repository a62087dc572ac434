//! Draws the pictures of `docs/simulator/`: each material at -45, 0 and 45 degrees, and patterns.
//!
//! `cargo run --release -p sps-simulate --example sheets -- docs/simulator`

use std::path::{Path, PathBuf};

use image::{ExtendedColorType, ImageEncoder};
use sps_dataset::Source;
use sps_simulate::{Patterns, Simulator, SimulatorSpec};

const SIZE: usize = 128;
const GAP: usize = 2;

/// Rows of each picture; three surfaces a row, at three angles each.
const SHEETS: [(&str, &[&str]); 3] = [
    (
        "classes-1.jpg",
        &["plastic", "leather", "wood", "cotton", "upholstery"],
    ),
    (
        "classes-2.jpg",
        &["towel", "sponge", "denim", "foam", "carpet"],
    ),
    (
        "classes-3.jpg",
        &["stone", "linen", "silk", "ceramic", "steel", "brass"],
    ),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder: PathBuf = std::env::args_os()
        .nth(1)
        .ok_or("expected a folder")?
        .into();
    std::fs::create_dir_all(&folder)?;
    let simulator = Simulator::new(SimulatorSpec {
        surfaces: 400,
        size: SIZE,
        views: 3,
        ..SimulatorSpec::default()
    })?;
    for (name, materials) in SHEETS {
        let mut sheet = Sheet::new(materials.len());
        surfaces(&mut sheet, &simulator, materials)?;
        sheet.write(&folder.join(name))?;
    }
    let mut sheet = Sheet::new(6);
    patterns(&mut sheet);
    sheet.write(&folder.join("patterns.jpg"))
}

/// Images of one size in rows.
struct Sheet {
    width: usize,
    pixels: Vec<u8>,
}

const COLUMNS: usize = 9;

impl Sheet {
    fn new(rows: usize) -> Self {
        let width = COLUMNS * (SIZE + GAP);
        Self {
            width,
            pixels: vec![255; width * rows * (SIZE + GAP) * 3],
        }
    }

    fn put(&mut self, row: usize, column: usize, bytes: &[u8]) {
        let left = column * (SIZE + GAP);
        for (y, line) in bytes.chunks_exact(SIZE * 3).enumerate() {
            let at = ((row * (SIZE + GAP) + y) * self.width + left) * 3;
            self.pixels[at..at + SIZE * 3].copy_from_slice(line);
        }
    }

    fn write(&self, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
        let height = self.pixels.len() / (3 * self.width);
        let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, 88).write_image(
            &self.pixels,
            self.width as u32,
            height as u32,
            ExtendedColorType::Rgb8,
        )?;
        Ok(())
    }
}

/// Three images of each of eighteen classes.
fn patterns(sheet: &mut Sheet) {
    let patterns = Patterns::new(1);
    for class in 0..18 {
        for number in 0..3 {
            let frame = patterns.frame(class, number, SIZE);
            let bytes: Vec<u8> = frame.data.iter().map(|v| (255.0 * v) as u8).collect();
            sheet.put(class / 3, class % 3 * 3 + number, &bytes);
        }
    }
}

fn surfaces(
    sheet: &mut Sheet,
    simulator: &Simulator,
    materials: &[&str],
) -> Result<(), sps_simulate::SimulateError> {
    for (row, material) in materials.iter().enumerate() {
        let surfaces = simulator.surfaces().iter().enumerate();
        let of_it = surfaces.filter(|(_, s)| s.material == *material).take(3);
        for (place, (surface, _)) in of_it.enumerate() {
            for view in 0..3 {
                let bytes = simulator.frame_bytes(surface, view)?;
                sheet.put(row, place * 3 + view, &bytes);
            }
        }
    }
    Ok(())
}
