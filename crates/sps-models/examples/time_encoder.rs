//! Times an encoder: for each line on standard input one pass over a batch of images of 224 x 224 (of I3D,
//! sequences of 16 of 112 x 112), and on standard output its milliseconds for each.
//! `benches/peers/peers.py` sets them beside those of other libraries, in turn.
//!
//! `cargo run --release -p sps-models --example time_encoder -- resnet18 int8 8`, where the second
//! argument is a precision, with `training-` before it or without, and the third the batch.

use std::error::Error;
use std::io::{Write, stdin, stdout};
use std::time::Instant;

use sps_models::candle::{Device, Tensor};
use sps_models::encoders::{Encoder, EncoderKind, Precision, TrainableEncoder};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let mut next = || arguments.next().ok_or("expected NETWORK PRECISION BATCH");
    let (kind, what, batch): (EncoderKind, String, usize) =
        (next()?.parse()?, next()?, next()?.parse()?);
    let images = match kind {
        EncoderKind::I3d => stripes(&[batch, 3, 16, 112, 112])?,
        _ => stripes(&[batch, 3, 224, 224])?,
    };
    let encoder = Encoder::seeded(kind, 0)?;
    if let Some(precision) = what.strip_prefix("training-") {
        let trainable = TrainableEncoder::new(&encoder)?;
        let mut trainable = trainable.with_precision(precision.parse()?)?;
        return time(batch, || {
            let loss = trainable.forward(&images)?.sqr()?.mean_all()?;
            trainable.backward(&loss).map(drop)
        });
    }
    let precision: Precision = what.parse()?;
    let encoder = encoder.calibrated(&[&images])?.with_precision(precision)?;
    time(batch, || encoder.embed(&images).map(drop))
}

/// Stripes of a width that grows.
fn stripes(shape: &[usize]) -> Result<Tensor, Box<dyn Error>> {
    let values = (0..shape.iter().product()).map(|i: usize| {
        let phase = i as f32 * 0.37 / (1.0 + i as f32 / 1e5);
        0.5 + 0.5 * phase.sin()
    });
    Ok(Tensor::from_iter(values, &Device::Cpu)?.reshape(shape)?)
}

/// Runs a pass for each line, after one to warm up.
fn time(
    batch: usize,
    mut pass: impl FnMut() -> sps_models::Result<()>,
) -> Result<(), Box<dyn Error>> {
    pass()?;
    for line in stdin().lines() {
        line?;
        let start = Instant::now();
        pass()?;
        let milliseconds = 1e3 * start.elapsed().as_secs_f64();
        println!("{}", milliseconds / batch as f64);
        stdout().flush()?;
    }
    Ok(())
}
