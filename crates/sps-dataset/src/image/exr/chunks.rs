use std::io::Cursor;

use exr::block::chunk::TileCoordinates;
use exr::error::Error;
use exr::math::Vec2;
use exr::meta::attribute::{Compression, IntegerBounds};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData, compute_block_count};

use super::super::{FrameErrorKind, Limits};
use super::{damaged, unsupported};

/// How large a block may be once unpacked, per pixel that the limits allow; the decompressors hold
/// several copies of it.
const BLOCK_BYTES_PER_PIXEL: u64 = 4;

/// The headers of a file, and its bytes after the offset tables.
///
/// The `exr` crate reads headers and unpacks blocks; the chunks between are walked here, because
/// it refuses subsampled channels, reserves what a file claims before seeing that many bytes, and
/// does not notice a missing block.
pub(super) struct ExrFile<'a> {
    meta: MetaData,
    chunk_count: usize,
    chunks: &'a [u8],
}

/// A decompressed block of the full-resolution picture.
pub(super) struct Block {
    bounds: IntegerBounds,
    bytes: Vec<u8>,
}

/// The samples of one channel in one row of a block.
pub(super) struct Line<'a> {
    /// Index in the header's list.
    pub(super) channel: usize,
    pub(super) x: usize,
    pub(super) y: usize,
    /// Native-endian.
    pub(super) bytes: &'a [u8],
}

/// One chunk as the file has it.
struct Chunk<'a> {
    part: usize,
    /// Absent for deep data, which is stepped over.
    tile: Option<TileCoordinates>,
    packed: &'a [u8],
}

impl<'a> ExrFile<'a> {
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, FrameErrorKind> {
        let mut cursor = Cursor::new(bytes);
        let meta = MetaData::read_from_buffered(&mut cursor, false).map_err(refused)?;
        let counts = meta.headers.iter().map(|header| header.chunk_count);
        let chunk_count = counts.fold(0, usize::saturating_add);
        let start = (cursor.position() as usize).saturating_add(chunk_count.saturating_mul(8));
        let chunks = bytes.get(start..).ok_or_else(cut)?;
        Ok(Self {
            meta,
            chunk_count,
            chunks,
        })
    }

    /// One per part.
    pub(super) fn headers(&self) -> &[Header] {
        &self.meta.headers
    }

    /// Unpacks every full-resolution block of a part that [`check_readable`] has passed, and steps
    /// over everything else.
    pub(super) fn read_part(
        &self,
        part: usize,
        mut take: impl FnMut(&Block),
    ) -> Result<(), FrameErrorKind> {
        let mut header = self.meta.headers[part].clone();
        let columns = compute_block_count(header.layer_size.0, header.max_block_pixel_size().0);
        let rows = compute_block_count(header.layer_size.1, header.max_block_pixel_size().1);
        let mut missing = vec![true; columns.saturating_mul(rows).min(header.chunk_count)];
        let mut rest = self.chunks;
        for _ in 0..self.chunk_count {
            let chunk = self.next_chunk(&mut rest)?;
            let tile = chunk.tile.filter(|_| chunk.part == part);
            let Some(tile) = tile.filter(TileCoordinates::is_largest_resolution_level) else {
                continue;
            };
            let bounds = header.get_absolute_block_pixel_coordinates(tile);
            let bounds = bounds.map_err(refused)?;
            let index = tile.tile_index.1 * columns + tile.tile_index.0;
            if !std::mem::take(missing.get_mut(index).ok_or_else(twice)?) {
                return Err(twice());
            }
            take(&unpack(&mut header, bounds, chunk.packed)?);
        }
        match missing.iter().filter(|&&missing| missing).count() {
            0 => Ok(()),
            count => {
                let all = missing.len();
                Err(damaged(format!("{count} of its {all} blocks are missing")))
            }
        }
    }

    fn next_chunk(&self, rest: &mut &'a [u8]) -> Result<Chunk<'a>, FrameErrorKind> {
        let several = self.meta.requirements.has_multiple_layers;
        let part = if several { take_index(rest)? } else { 0 };
        let header = self.meta.headers.get(part);
        let header = header.ok_or_else(|| damaged(format!("a block belongs to part {part}")))?;
        let tile = match header.blocks {
            BlockDescription::ScanLines => scan_line_tile(header, take_i32(rest)?)?,
            BlockDescription::Tiles(_) => TileCoordinates {
                tile_index: Vec2(take_index(rest)?, take_index(rest)?),
                level_index: Vec2(take_index(rest)?, take_index(rest)?),
            },
        };
        let (tile, size) = if header.deep {
            let sizes = [take_u64(rest)?, take_u64(rest)?, take_u64(rest)?];
            take(rest, sizes[0])?;
            (None, sizes[1])
        } else {
            (Some(tile), take_index(rest)? as u64)
        };
        let packed = take(rest, size)?;
        Ok(Chunk { part, tile, packed })
    }
}

/// Scan lines are addressed by their first row; here they count as tiles as wide as the picture.
fn scan_line_tile(header: &Header, y: i32) -> Result<TileCoordinates, FrameErrorKind> {
    let rows = i64::from(y) - i64::from(header.own_attributes.layer_position.1);
    let lines = header.compression.scan_lines_per_block();
    let row = usize::try_from(rows).ok().filter(|row| row % lines == 0);
    let row = row.ok_or_else(|| damaged(format!("a block begins at row {y}")))?;
    Ok(TileCoordinates {
        tile_index: Vec2(0, row / lines),
        level_index: Vec2(0, 0),
    })
}

/// Refuses what cannot be unpacked, before anything is reserved for it.
pub(super) fn check_readable(header: &Header, limits: &Limits) -> Result<(), FrameErrorKind> {
    if header.deep {
        return Err(unsupported("deep data"));
    }
    let sampling = || header.channels.list.iter().map(|channel| channel.sampling);
    if !sampling().all(|sampling| fits(header, sampling)) {
        let reason = "its size or position is no multiple of a channel's sampling";
        return Err(damaged(reason));
    }
    let subsampled = sampling().any(|sampling| sampling != Vec2(1, 1));
    if subsampled && header.blocks != BlockDescription::ScanLines {
        return Err(unsupported("subsampled channels in tiles"));
    }
    let lossy = matches!(
        header.compression,
        Compression::B44 | Compression::B44A | Compression::DWAA(_) | Compression::DWAB(_)
    );
    if subsampled && lossy {
        let compression = header.compression;
        let reason = format!("subsampled channels under {compression}");
        return Err(unsupported(reason));
    }
    let Vec2(width, height) = header.layer_size;
    let block = header.max_block_pixel_size();
    let pixels = (block.0.min(width) as u64).saturating_mul(block.1.min(height) as u64);
    let bytes = pixels.saturating_mul(header.channels.bytes_per_pixel as u64);
    let most = limits.pixels.saturating_mul(BLOCK_BYTES_PER_PIXEL);
    if bytes > most {
        let reason = format!("a block that unpacks to {bytes} bytes, more than {most}");
        return Err(unsupported(reason));
    }
    Ok(())
}

fn fits(header: &Header, sampling: Vec2<usize>) -> bool {
    let (Vec2(width, height), Vec2(x, y)) =
        (header.layer_size, header.own_attributes.layer_position);
    let multiple = |size: usize, start: i32, step: usize| {
        step > 0 && size.is_multiple_of(step) && i64::from(start) % step as i64 == 0
    };
    multiple(width, x, sampling.0) && multiple(height, y, sampling.1)
}

/// Unpacks one block. `header` is the block's, and is left changed.
fn unpack(
    header: &mut Header,
    bounds: IntegerBounds,
    packed: &[u8],
) -> Result<Block, FrameErrorKind> {
    let size: usize = line_sizes(bounds, header).map(|(_, _, size)| size).sum();
    let area = bounds.size.area();
    if !size.is_multiple_of(area) {
        let reason = "channels subsampled so that a pixel is no whole number of bytes";
        return Err(unsupported(reason));
    }
    // The crate takes every channel for full resolution; told the true number of bytes per pixel,
    // its decompressors unpack subsampled lines as they should.
    header.channels.bytes_per_pixel = size / area;
    check_dwa(header, bounds, packed, size)?;
    let compression = header.compression;
    let bytes = compression
        .decompress_image_section_from_le(header, packed.to_vec(), bounds, false)
        .map_err(refused)?;
    if bytes.len() != size {
        let found = bytes.len();
        return Err(damaged(format!(
            "a block has {found} bytes instead of {size}"
        )));
    }
    Ok(Block { bounds, bytes })
}

/// A DWA block begins with eleven counts, by which the crate reserves memory unseen.
fn check_dwa(
    header: &Header,
    bounds: IntegerBounds,
    packed: &[u8],
    size: usize,
) -> Result<(), FrameErrorKind> {
    let dwa = matches!(
        header.compression,
        Compression::DWAA(_) | Compression::DWAB(_)
    );
    // A block that would not shrink is stored as it is.
    if !dwa || packed.len() == size {
        return Ok(());
    }
    let (counts, _) = packed.as_chunks::<8>();
    let [_, unknown, _, _, _, _, run_lengths, raw, ac, dc, ..] = *counts else {
        return Err(cut());
    };
    let [unknown, run_lengths, raw, ac, dc] =
        [unknown, run_lengths, raw, ac, dc].map(u64::from_le_bytes);
    let size = size as u64;
    // Coefficients come in blocks of 8 x 8.
    let area = bounds.size.0.next_multiple_of(8) * bounds.size.1.next_multiple_of(8);
    let coefficients = (area * header.channels.list.len()) as u64;
    let lies = unknown > size
        || raw > size
        || run_lengths > size * 2
        || ac > coefficients
        || dc > coefficients;
    if lies {
        let reason = "a block says that it unpacks to more than it can hold";
        return Err(damaged(reason));
    }
    Ok(())
}

/// Channel, row in the picture and bytes of each line of a block, in the order of storage.
fn line_sizes(
    bounds: IntegerBounds,
    header: &Header,
) -> impl Iterator<Item = (usize, usize, usize)> {
    let (width, top) = (bounds.size.0, bounds.position.1 as usize);
    (top..top + bounds.size.1).flat_map(move |y| {
        let channels = header.channels.list.iter().enumerate();
        let stored = channels.filter(move |(_, channel)| y % channel.sampling.1 == 0);
        stored.map(move |(index, channel)| {
            let samples = width / channel.sampling.0;
            (index, y, samples * channel.sample_type.bytes_per_sample())
        })
    })
}

impl Block {
    pub(super) fn lines(&self, header: &Header) -> impl Iterator<Item = Line<'_>> {
        let x = self.bounds.position.0 as usize;
        let mut rest = self.bytes.as_slice();
        line_sizes(self.bounds, header).map_while(move |(channel, y, size)| {
            let bytes = rest.split_off(..size)?;
            Some(Line {
                channel,
                x,
                y,
                bytes,
            })
        })
    }
}

fn take<'a>(rest: &mut &'a [u8], count: u64) -> Result<&'a [u8], FrameErrorKind> {
    let count = usize::try_from(count).map_err(|_| cut())?;
    rest.split_off(..count).ok_or_else(cut)
}

fn take_i32(rest: &mut &[u8]) -> Result<i32, FrameErrorKind> {
    let bytes = take(rest, 4)?;
    bytes.try_into().map(i32::from_le_bytes).map_err(|_| cut())
}

fn take_u64(rest: &mut &[u8]) -> Result<u64, FrameErrorKind> {
    let bytes = take(rest, 8)?;
    bytes.try_into().map(u64::from_le_bytes).map_err(|_| cut())
}

fn take_index(rest: &mut &[u8]) -> Result<usize, FrameErrorKind> {
    let value = take_i32(rest)?;
    usize::try_from(value).map_err(|_| damaged(format!("a block has the number {value}")))
}

fn cut() -> FrameErrorKind {
    damaged("it is cut off")
}

fn twice() -> FrameErrorKind {
    damaged("a block is there twice, or lies outside the picture")
}

fn refused(error: Error) -> FrameErrorKind {
    match error {
        Error::NotSupported(reason) => unsupported(reason),
        Error::Io(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => cut(),
        error => damaged(error),
    }
}
