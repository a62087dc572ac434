//! A photograph of any size brought to a small one, without the whole of it as a frame.
//!
//! `cargo run --release -p sps-dataset --example thumbnail -- PHOTOGRAPH [SHORTER_SIDE [OUT.png]]`

use std::path::PathBuf;
use std::time::Instant;

use sps_dataset::{DecodeSettings, FrameFormat, read_image_resized};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let Some(photograph) = arguments.next().map(PathBuf::from) else {
        println!("expected the path of a PNG, JPEG or EXR");
        return Ok(());
    };
    let shorter_side = arguments.next().map_or(Ok(224), |pixels| pixels.parse())?;
    let start = Instant::now();
    let frame = read_image_resized(&photograph, &DecodeSettings::default(), shorter_side)?.frame;
    let milliseconds = 1e3 * start.elapsed().as_secs_f64();
    println!(
        "{} x {} pixels in {milliseconds:.0} ms",
        frame.width, frame.height
    );
    if let Some(out) = arguments.next() {
        std::fs::write(out, FrameFormat::Png.encode(&frame)?)?;
    }
    Ok(())
}
