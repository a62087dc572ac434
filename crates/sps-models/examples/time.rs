//! scratch
use candle_core::{DType, Device, Tensor};
use sps_models::encoders::{Encoder, EncoderKind};
use std::time::Instant;
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().collect();
    let kind: EncoderKind = args[1].parse()?;
    let reps: usize = args[2].parse()?;
    let plain: usize = args.get(3).map_or(Ok(0), |s| s.parse())?;
    let encoder = Encoder::seeded(kind, 0, &Device::Cpu)?;
    for batch in [8, 1] {
        let x = Tensor::ones((batch, 3, 224, 224), DType::F32, &Device::Cpu)?;
        let time = |f: &dyn Fn() -> (), reps: usize| {
            let mut t: Vec<f64> = (0..reps)
                .map(|_| {
                    let s = Instant::now();
                    f();
                    s.elapsed().as_secs_f64() * 1e3 / batch as f64
                })
                .collect();
            t.sort_by(f64::total_cmp);
            if t.is_empty() {
                (0., 0.)
            } else {
                (t[t.len() / 2], t[0])
            }
        };
        encoder.embed(&x)?;
        let f = time(
            &|| {
                encoder.embed(&x).unwrap();
            },
            reps,
        );
        let p = time(
            &|| {
                encoder.embed_plain(&x).unwrap();
            },
            plain,
        );
        println!(
            "{kind} batch {batch}: fused {:.1} ms (min {:.1}), plain {:.1} (min {:.1})",
            f.0, f.1, p.0, p.1
        );
    }
    Ok(())
}
