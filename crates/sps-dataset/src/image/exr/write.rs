use std::io::Cursor;

use exr::prelude::{
    Blocks, Compression, Encoding, Image, LineOrder, SpecificChannels, Vec2, WritableImage, f16,
};

use crate::LinearFrame;

/// A scan-line EXR with half R, G and B under lossless ZIP.
pub(crate) fn encode_half(frame: &LinearFrame) -> Result<Vec<u8>, exr::error::Error> {
    let light = |Vec2(x, y): Vec2<usize>| {
        let pixel = (y * frame.width + x) * 3;
        let half = |channel: usize| {
            let value = frame.data.get(pixel + channel).copied().unwrap_or_default();
            f16::from_f32(value)
        };
        (half(0), half(1), half(2))
    };
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let image = Image::from_encoded_channels(
        (frame.width, frame.height),
        encoding,
        SpecificChannels::rgb(light),
    );
    let mut bytes = Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes)?;
    Ok(bytes.into_inner())
}
