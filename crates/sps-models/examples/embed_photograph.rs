//! Photographs to embeddings, by an encoder with the weights of a file:
//!
//! `cargo run --release -p sps-models --example embed_photograph -- squeezenet1-0 WEIGHTS PHOTOGRAPH..`
//!
//! Weights are safetensors or PyTorch's `.pth`, named as torchvision's or timm's. Prints how alike
//! the photographs are to the encoder: the cosine of their embeddings' angle. Without arguments it
//! shows the same on two drawn images and untrained weights.

use image::imageops::{self, FilterType};
use image::{DynamicImage, ImageBuffer, Rgb, Rgb32FImage};
use sps_models::encoders::{Encoder, EncoderKind};

/// The length of an image's shorter side, as the encoders were trained.
const SIDE: u32 = 224;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (encoder, images): (_, Vec<_>) = match arguments.as_slice() {
        [kind, weights, photographs @ ..] if !photographs.is_empty() => {
            let encoder = Encoder::load(kind.parse()?, weights)?;
            let images: Result<Vec<_>, _> = photographs.iter().map(image::open).collect();
            (
                encoder,
                images?.iter().map(DynamicImage::to_rgb32f).collect(),
            )
        }
        _ => {
            println!("no KIND WEIGHTS PHOTOGRAPH.. given: untrained weights, drawn images");
            let kind = EncoderKind::EfficientNetLiteBody;
            let encoder = Encoder::seeded(kind, 0)?;
            (encoder, vec![stripes(0.1), stripes(0.5)])
        }
    };
    let embeddings: Result<Vec<_>, _> = images.iter().map(|image| embed(&encoder, image)).collect();
    let embeddings = embeddings?;
    println!("{}: {} features", encoder.kind(), encoder.width());
    for one in &embeddings {
        let cosines = embeddings
            .iter()
            .map(|other| format!("{:6.3}", cosine(one, other)));
        println!("{}", cosines.collect::<String>());
    }
    Ok(())
}

/// Images keep their shape: encoders take any height and width.
fn embed(encoder: &Encoder, image: &Rgb32FImage) -> sps_models::Result<Vec<f32>> {
    let (width, height) = image.dimensions();
    let scaled = |side: u32| (side * SIDE).div_ceil(width.min(height).max(1));
    let filter = FilterType::CatmullRom;
    let image = imageops::resize(image, scaled(width), scaled(height), filter);
    let size = [image.height() as usize, image.width() as usize];
    encoder.embed_pixels(&[image.as_raw()], size)
}

fn stripes(frequency: f32) -> Rgb32FImage {
    ImageBuffer::from_fn(320, 240, |x, _| {
        let value = 0.5 + 0.5 * (x as f32 * frequency).sin();
        Rgb([value, value, 0.5])
    })
}

fn cosine(one: &[f32], other: &[f32]) -> f32 {
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    dot(one, other) / (dot(one, one) * dot(other, other)).sqrt()
}
