//! Says what an ONNX file makes of a grey image: `embed dino.onnx 224`.

use std::error::Error;
use std::path::Path;

use sps_onnx::{OnnxEncoder, Settings};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let Some(path) = arguments.next() else {
        println!("expected an ONNX file, for example dino.onnx");
        return Ok(());
    };
    let size = arguments.next().map(|size| size.parse()).transpose()?;
    let settings = Settings {
        size,
        ..Settings::default()
    };
    let encoder = OnnxEncoder::read(Path::new(&path), settings)?;
    let size = encoder.size();
    let embedding = encoder.embed(&[&vec![0.5; 3 * size * size]], [size; 2])?;
    let first = &embedding[..4.min(embedding.len())];
    println!("{:?}: {first:?} ...", encoder.blocks());
    Ok(())
}
