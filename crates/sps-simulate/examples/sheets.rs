//! Draws the pictures of `docs/simulator/`: each material at -45, 0 and 45 degrees.
//!
//! `cargo run --release -p sps-simulate --example sheets -- docs/simulator`

use std::path::PathBuf;

use image::{ExtendedColorType, ImageEncoder};
use sps_dataset::Source;
use sps_simulate::{Simulator, SimulatorSpec};

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
        let (width, pixels) = sheet(&simulator, materials)?;
        let height = pixels.len() / (3 * width);
        let mut file = std::io::BufWriter::new(std::fs::File::create(folder.join(name))?);
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, 88).write_image(
            &pixels,
            width as u32,
            height as u32,
            ExtendedColorType::Rgb8,
        )?;
    }
    Ok(())
}

fn sheet(
    simulator: &Simulator,
    materials: &[&str],
) -> Result<(usize, Vec<u8>), sps_simulate::SimulateError> {
    let columns = 9;
    let width = columns * (SIZE + GAP);
    let mut pixels = vec![255; width * materials.len() * (SIZE + GAP) * 3];
    for (row, material) in materials.iter().enumerate() {
        let surfaces = simulator.surfaces().iter().enumerate();
        let of_it = surfaces.filter(|(_, s)| s.material == *material).take(3);
        for (place, (surface, _)) in of_it.enumerate() {
            for view in 0..3 {
                let bytes = simulator.frame_bytes(surface, view)?;
                let left = (place * 3 + view) * (SIZE + GAP);
                for (y, line) in bytes.chunks_exact(SIZE * 3).enumerate() {
                    let at = ((row * (SIZE + GAP) + y) * width + left) * 3;
                    pixels[at..at + SIZE * 3].copy_from_slice(line);
                }
            }
        }
    }
    Ok((width, pixels))
}
