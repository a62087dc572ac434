use crate::Frame;

/// Decoded samples as PNG and JPEG have them: interleaved, row-major.
pub(super) struct Samples<'a> {
    pub(super) width: usize,
    pub(super) height: usize,
    /// 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha.
    pub(super) channels: usize,
    pub(super) depth: Depth,
    pub(super) bytes: &'a [u8],
}

/// How a sample is stored.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Depth {
    Eight,
    /// Big-endian, as PNG stores it.
    Sixteen,
}

impl Samples<'_> {
    /// The frame: the largest sample becomes 1, grey fills all three channels, and transparent
    /// pixels show `background`, mixed in the display-referred values as browsers do.
    pub(super) fn to_frame(&self, background: [f32; 3]) -> Frame {
        let data = match self.depth {
            Depth::Eight => {
                let levels: [f32; 256] = std::array::from_fn(|level| level as f32 / 255.0);
                let samples = self.bytes.iter().map(|&byte| levels[usize::from(byte)]);
                mix(samples, self.channels, background)
            }
            Depth::Sixteen => {
                let (pairs, _) = self.bytes.as_chunks::<2>();
                let samples = pairs
                    .iter()
                    .map(|&pair| f32::from(u16::from_be_bytes(pair)));
                mix(
                    samples.map(|sample| sample / 65535.0),
                    self.channels,
                    background,
                )
            }
        };
        Frame {
            width: self.width,
            height: self.height,
            data,
        }
    }
}

fn mix(samples: impl Iterator<Item = f32>, channels: usize, background: [f32; 3]) -> Vec<f32> {
    if channels == 3 {
        return samples.collect();
    }
    let mut samples = samples;
    let mut data = Vec::new();
    while let Some(first) = samples.next() {
        let mut next = || samples.next().unwrap_or(0.0);
        let (rgb, alpha) = match channels {
            1 => ([first; 3], 1.0),
            2 => ([first; 3], next()),
            _ => ([first, next(), next()], next()),
        };
        let shown = |(value, behind): (f32, f32)| value * alpha + behind * (1.0 - alpha);
        data.extend(rgb.into_iter().zip(background).map(shown));
    }
    data
}
