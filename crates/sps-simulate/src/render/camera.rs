//! The sensor and the encoding of its signal.

use std::sync::LazyLock;

use sps_dataset::LinearFrame;

use super::super::parameters::Specimen;
use super::super::stream::{Purpose, Stream};
use super::view::angle_key;

/// Variance of the signal in darkness, and what a signal of 1 adds: read noise of 0.2 % and a well
/// of 10,000 electrons, a machine-vision camera's.
const READ_VARIANCE: f32 = 4e-6;
const SHOT_VARIANCE: f32 = 1e-4;

/// The signal saturates here, in a well deeper than the display's white.
const FULL_WELL: f32 = 4.0;

/// Adds the sensor's noise, which belongs to this surface, angle and size.
pub(super) fn expose(mut image: LinearFrame, specimen: &Specimen, degrees: f64) -> LinearFrame {
    let key = [specimen.index, angle_key(degrees), image.width as u64];
    let mut stream = Stream::new(specimen.seed, Purpose::SENSOR, &key);
    let mut bytes = [0u8; 4 * 1024];
    for part in image.data.chunks_mut(bytes.len() / 4) {
        stream.fill(&mut bytes);
        for (value, four) in part.iter_mut().zip(bytes.chunks_exact(4)) {
            let deviation = (READ_VARIANCE + SHOT_VARIANCE * value.max(0.0)).sqrt();
            *value = (*value + deviation * bell(four)).clamp(0.0, FULL_WELL);
        }
    }
    image
}

/// The sum of four bytes, of mean zero and unit variance: within 1 % of the normal distribution
/// function everywhere, and never beyond 3.5 deviations.
#[inline]
fn bell(four: &[u8]) -> f32 {
    // The variance of a byte is (256^2 - 1) / 12.
    const SCALE: f32 = 0.006_765_8;
    let sum: i32 = four.iter().map(|&b| i32::from(b)).sum();
    (sum - 510) as f32 * SCALE
}

/// Display-referred bytes (IEC 61966-2-1), rounded to the nearest.
pub(crate) fn encode(image: &LinearFrame) -> Vec<u8> {
    let table = &*TABLE;
    let entry = |v: f32| table[(v.clamp(0.0, 1.0) * LAST + 0.5) as usize];
    image.data.iter().map(|&v| entry(v)).collect()
}

const LAST: f32 = 65535.0;

/// The byte for each of 65,536 steps of linear light; a step is at most a twentieth of a byte.
static TABLE: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let byte = |i| (255.0 * srgb(f64::from(i) / f64::from(LAST)) + 0.5) as u8;
    (0..=65535).map(byte).collect()
});

fn srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(data: Vec<f32>) -> LinearFrame {
        LinearFrame {
            width: data.len() / 3,
            height: 1,
            data,
        }
    }

    #[test]
    fn noise_has_the_stated_variance() {
        let specimen = Specimen::draw(1, 0);
        let noisy = expose(row(vec![0.5; 200 * 200 * 3]), &specimen, 0.0);
        let count = noisy.data.len() as f64;
        let mean = noisy.data.iter().map(|&v| f64::from(v)).sum::<f64>() / count;
        let squares = noisy.data.iter().map(|&v| (f64::from(v) - mean).powi(2));
        let variance = squares.sum::<f64>() / count;
        assert!((mean - 0.5).abs() < 1e-4);
        assert!((variance / 5.4e-5 - 1.0).abs() < 0.02, "{variance}");
    }

    #[test]
    fn encoding_meets_the_standards_values() {
        // IEC 61966-2-1: byte 128 is linear 0.2159, and linear 0.18 encodes to 0.4613.
        assert_eq!(encode(&row(vec![0.2159, 0.18, 2.0])), [128, 118, 255]);
        assert_eq!(encode(&row(vec![0.0; 3])), [0, 0, 0]);
    }
}
