//! OpenEXR: only the channels of the picture, whatever their types, blocks and compression.

mod channels;
mod chroma;
mod chunks;
mod display;
mod write;

use std::fmt::Display;

use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use half::f16;
use half::slice::HalfFloatSliceExt;

use super::{DecodeSettings, Decoded, FrameErrorKind, ImageFormat, check_size};
use crate::Frame;
use channels::{Picture, Slot, choose};
use chroma::{Chroma, LuminanceWeights};
use chunks::{Block, ExrFile, check_readable};
use display::to_display;

pub(crate) use write::encode_half;

pub(super) fn decode(bytes: &[u8], settings: &DecodeSettings) -> Result<Decoded, FrameErrorKind> {
    let file = ExrFile::open(bytes)?;
    let (part, picture) = choose(file.headers(), settings.exr_layer.as_deref())?;
    let header = &file.headers()[part];
    let (width, height) = (header.layer_size.width(), header.layer_size.height());
    let limits = &settings.limits;
    check_size(ImageFormat::Exr, width as u64, height as u64, limits)?;
    check_readable(header, limits)?;

    let mut light = Light::new(width, height, picture);
    file.read_part(part, |block| light.take(block, header))?;
    let mut data = light.into_rgb(header);
    let light = to_display(&mut data, picture.is_all_half(header), settings)?;
    Ok(Decoded {
        frame: Frame {
            width,
            height,
            data,
        },
        light,
    })
}

fn damaged(reason: impl Display) -> FrameErrorKind {
    FrameErrorKind::damaged(ImageFormat::Exr, reason)
}

fn unsupported(reason: impl Display) -> FrameErrorKind {
    FrameErrorKind::unsupported(ImageFormat::Exr, reason)
}

/// The picture while its blocks come in.
struct Light {
    width: usize,
    height: usize,
    picture: Picture,
    /// `(height, width, 3)`; luminance stands in the middle.
    data: Vec<f32>,
    chroma: [Chroma; 2],
    line: LineSamples,
}

impl Light {
    fn new(width: usize, height: usize, picture: Picture) -> Self {
        let chroma = || match picture {
            Picture::LuminanceChroma { sampling, .. } => Chroma::new(width, height, sampling),
            _ => Chroma::default(),
        };
        Self {
            width,
            height,
            picture,
            data: vec![0.0; width * height * 3],
            chroma: [chroma(), chroma()],
            line: LineSamples::default(),
        }
    }

    /// Copies the wanted lines of a decompressed block.
    fn take(&mut self, block: &Block, header: &Header) {
        for line in block.lines(header) {
            let Some(slot) = self.picture.slot(line.channel) else {
                continue;
            };
            let kind = header.channels.list[line.channel].sample_type;
            let samples = self.line.read(line.bytes, kind);
            match slot {
                Slot::Colour(channel) => {
                    let first = (line.y * self.width + line.x) * 3 + channel;
                    let to = self.data[first..].iter_mut().step_by(3);
                    to.zip(samples).for_each(|(to, &sample)| *to = sample);
                }
                Slot::Chroma(plane) => {
                    let to = self.chroma[plane].row_mut(line.y).iter_mut();
                    to.zip(samples).for_each(|(to, &sample)| *to = sample);
                }
            }
        }
    }

    fn into_rgb(mut self, header: &Header) -> Vec<f32> {
        match self.picture {
            Picture::Rgb(_) => {}
            Picture::Luminance(_) => {
                for pixel in self.data.as_chunks_mut::<3>().0 {
                    *pixel = [pixel[1]; 3];
                }
            }
            Picture::LuminanceChroma { .. } => {
                let weights = LuminanceWeights::of(header.shared_attributes.chromaticities);
                let (width, height) = (self.width, self.height);
                chroma::reconstruct(&mut self.data, width, height, &self.chroma, weights);
            }
        }
        self.data
    }
}

/// Samples of any of the three types as numbers, a line at a time.
#[derive(Default)]
struct LineSamples {
    halves: Vec<f16>,
    floats: Vec<f32>,
}

impl LineSamples {
    fn read(&mut self, bytes: &[u8], kind: SampleType) -> &[f32] {
        let Self { halves, floats } = self;
        floats.clear();
        let words = bytes.as_chunks::<4>().0.iter();
        match kind {
            SampleType::F16 => {
                let (stored, _) = bytes.as_chunks::<2>();
                halves.clear();
                halves.extend(stored.iter().map(|&half| f16::from_ne_bytes(half)));
                floats.resize(halves.len(), 0.0);
                halves.convert_to_f32_slice(floats);
            }
            SampleType::F32 => floats.extend(words.map(|&word| f32::from_ne_bytes(word))),
            SampleType::U32 => floats.extend(words.map(|&word| u32::from_ne_bytes(word) as f32)),
        }
        floats
    }
}
