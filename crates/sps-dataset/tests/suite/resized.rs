//! Images brought to a size as they are read, against the whole frame brought to it.

use crate::common::{at_most, data};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use png::{BitDepth, ColorType};
use proptest::prelude::*;
use proptest::sample::select;
use sps_dataset::{
    DecodeSettings, Decoded, FrameErrorKind, decode_image, decode_image_resized, read_image,
    read_image_resized,
};

/// What image files hold: colour and samples of a pixel.
const COLOURS: [(ColorType, usize); 4] = [
    (ColorType::Grayscale, 1),
    (ColorType::GrayscaleAlpha, 2),
    (ColorType::Rgb, 3),
    (ColorType::Rgba, 4),
];

/// An EXIF block that says the orientation and nothing else.
fn exif(orientation: u8) -> Vec<u8> {
    let mut exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    exif
}

fn noise(length: usize) -> Vec<u8> {
    let byte = |i: usize| ((i * i * 31 + i * 17) >> 3) as u8;
    (0..length).map(byte).collect()
}

fn png_file(
    (colour, channels): (ColorType, usize),
    depth: BitDepth,
    [width, height]: [u32; 2],
    orientation: u8,
) -> Vec<u8> {
    let mut info = png::Info::with_size(width, height);
    (info.color_type, info.bit_depth) = (colour, depth);
    info.exif_metadata = Some(exif(orientation).into());
    let mut file = Vec::new();
    let encoder = png::Encoder::with_info(&mut file, info).unwrap();
    let mut writer = encoder.write_header().unwrap();
    let pixels = (width * height) as usize;
    let bytes = noise(pixels * channels * depth as usize / 8);
    writer.write_image_data(&bytes).unwrap();
    writer.finish().unwrap();
    file
}

fn jpeg_file(is_grey: bool, [width, height]: [u32; 2], orientation: u8) -> Vec<u8> {
    let (channels, colour) = if is_grey {
        (1, ExtendedColorType::L8)
    } else {
        (3, ExtendedColorType::Rgb8)
    };
    let mut file = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut file, 90);
    encoder.set_exif_metadata(exif(orientation)).unwrap();
    let bytes = noise((width * height) as usize * channels);
    encoder.write_image(&bytes, width, height, colour).unwrap();
    file
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Compares an image read at a size with the whole of it brought to that size.
fn check(name: &str, file: &[u8], settings: &DecodeSettings, shorter_side: usize) {
    let Decoded { frame, light } = decode_image(file, settings).unwrap();
    let expected = frame.resized(shorter_side).unwrap();
    let found = decode_image_resized(file, settings, Some(shorter_side)).unwrap();
    assert_eq!(found.frame.extent(), expected.extent(), "{name}");
    assert_eq!(bits(&found.frame.data), bits(&expected.data), "{name}");
    assert_eq!(found.light, light, "{name}");
}

proptest! {
    #[test]
    fn a_png_of_each_kind_is_as_its_frame_resized(
        colour in select(&COLOURS[..]),
        depth in select(vec![BitDepth::Eight, BitDepth::Sixteen]),
        size in [1_u32..50, 1..50],
        orientation in 1_u8..9,
        shorter_side in 1_usize..60,
        background in [0.0_f32..1.0, 0.0..1.0, 0.0..1.0],
    ) {
        let settings = DecodeSettings { background, ..DecodeSettings::default() };
        let file = png_file(colour, depth, size, orientation);
        check("png", &file, &settings, shorter_side);
    }

    #[test]
    fn a_jpeg_of_each_kind_is_as_its_frame_resized(
        is_grey: bool,
        size in [1_u32..50, 1..50],
        orientation in 1_u8..9,
        shorter_side in 1_usize..60,
    ) {
        let file = jpeg_file(is_grey, size, orientation);
        check("jpeg", &file, &DecodeSettings::default(), shorter_side);
    }
}

#[test]
fn files_of_other_encoders_are_as_their_frames_resized() {
    let mut names = vec!["png/palette4-alpha.png", "png/rgb8-interlaced.png"];
    names.extend(["jpeg/ycck.jpg", "jpeg/subsampled.jpg", "jpeg/turned7.jpg"]);
    #[cfg(feature = "exr")]
    names.extend(["exr/half-zip.exr", "exr/hard-float.exr"]);
    for name in names {
        for shorter_side in [1, 5, 12, 30] {
            let settings = DecodeSettings::default();
            check(name, &data(name), &settings, shorter_side);
        }
    }
}

#[test]
fn threads_change_no_bit() {
    let file = png_file(COLOURS[2], BitDepth::Eight, [150, 90], 6);
    let resized = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let decode = || decode_image_resized(&file, &DecodeSettings::default(), Some(40)).unwrap();
        bits(&pool.unwrap().install(decode).frame.data)
    };
    assert_eq!(resized(1), resized(3));
}

#[test]
fn what_is_refused_whole_is_refused_resized() {
    let any = DecodeSettings::default();
    for name in ["png/rgb8.png", "jpeg/rgb.jpg"] {
        let file = data(name);
        let refused = decode_image_resized(&file, &at_most(191), Some(2)).unwrap_err();
        let too_many = matches!(refused, FrameErrorKind::TooManyPixels { .. });
        assert!(too_many, "{refused}");
        let cut = decode_image_resized(&file[..file.len() - 9], &any, Some(2));
        assert!(matches!(cut, Err(FrameErrorKind::Damaged(_))));
        let vast = decode_image_resized(&file, &any, Some(10_000));
        assert!(matches!(vast, Err(FrameErrorKind::ResizedTooLarge { .. })));
    }
}

#[test]
fn a_file_is_read_at_a_size_and_named_where_it_cannot_be() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("photograph.jpg");
    let settings = DecodeSettings::default();
    let missing = read_image_resized(&path, &settings, Some(6)).unwrap_err();
    assert_eq!(missing.path(), path);
    std::fs::write(&path, data("jpeg/turned6.jpg")).unwrap();
    let whole = read_image(&path, &settings).unwrap().frame;
    let resized = read_image_resized(&path, &settings, Some(6)).unwrap().frame;
    assert_eq!(resized, *whole.resized(6).unwrap());
    assert_eq!((resized.width, resized.height), (8, 6));
}
