//! scratch
use candle_core::{DType, Device, Tensor};
use sps_models::encoders::{Encoder, EncoderKind, TrainableEncoder};
use std::time::Instant;
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().collect();
    let kind: EncoderKind = args[1].parse()?;
    let reps: usize = args[2].parse()?;
    let encoder = Encoder::seeded(kind, 0, &Device::Cpu)?;
    let mut t = TrainableEncoder::new(&encoder)?;
    if args.len() > 3 {
        t = t.with_plain_operators();
    }
    let batch = 8;
    let x = Tensor::ones((batch, 3, 224, 224), DType::F32, &Device::Cpu)?;
    for _ in 0..reps {
        let s = Instant::now();
        let y = t.forward(&x)?;
        let f = s.elapsed().as_secs_f64();
        let g = t.backward(&y.sqr()?.mean_all()?)?;
        drop(y);
        let b = s.elapsed().as_secs_f64();
        drop(g);
        println!(
            "{kind} forward {:.1} step {:.1} ms a frame",
            f * 1e3 / batch as f64,
            b * 1e3 / batch as f64
        );
    }
    let st = std::fs::read_to_string("/proc/self/stat")?;
    let f: Vec<&str> = st.split(" ").collect();
    println!("user {} sys {} (10 ms)", f[13], f[14]);
    let status = std::fs::read_to_string("/proc/self/status")?;
    println!(
        "{}",
        status
            .lines()
            .filter(|l| l.starts_with("VmHWM"))
            .collect::<String>()
    );
    Ok(())
}
