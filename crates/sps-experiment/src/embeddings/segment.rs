//! One file of cached embeddings: a safetensors file that is written once and never changed.
//!
//! It holds `embeddings`, f32, (frames, width), and `keys`, u8, (frames, 32), one content key per
//! row; `checksum` in its metadata is the blake3 hash of both, `keys-checksum` that of the keys.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use safetensors::tensor::{Dtype, Metadata, SafeTensors, TensorView};
use sps_dataset::FrameKey;

use crate::files::{self, write_atomically};

const KEYS: &str = "keys";
const EMBEDDINGS: &str = "embeddings";
const CHECKSUM: &str = "checksum";
const KEYS_CHECKSUM: &str = "keys-checksum";
const KEY_BYTES: usize = size_of::<FrameKey>();

/// Embeddings with the content keys of their frames, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Segment {
    pub keys: Vec<FrameKey>,
    /// Row-major, `keys.len()` rows of equal width.
    pub values: Vec<f32>,
}

fn checksum(parts: &[&[u8]]) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(part);
    }
    hasher.finalize().to_hex().to_string()
}

impl Segment {
    /// Writes the segment into `folder` under a name made from its content.
    pub(crate) fn write(&self, folder: &Path) -> Result<()> {
        let keys = self.keys.concat();
        let values: Vec<u8> = self.values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let rows = self.keys.len();
        let width = self.values.len() / rows.max(1);
        let (of_keys, checksum) = (checksum(&[&keys]), checksum(&[&keys, &values]));
        let values = TensorView::new(Dtype::F32, vec![rows, width], &values)?;
        let keys = TensorView::new(Dtype::U8, vec![rows, KEY_BYTES], &keys)?;
        let tensors = [(EMBEDDINGS, values), (KEYS, keys)];
        let metadata = HashMap::from([
            (CHECKSUM.to_owned(), checksum.clone()),
            (KEYS_CHECKSUM.to_owned(), of_keys),
        ]);
        let bytes = safetensors::serialize(tensors, Some(metadata))?;
        let name = format!("{}.safetensors", &checksum[..32]);
        write_atomically(&folder.join(name), &bytes)
    }

    /// Reads embeddings of this width.
    pub(crate) fn read(path: &Path, width: usize) -> Result<Self> {
        let failed = || format!("cannot read {}", path.display());
        let bytes = files::read(path)?;
        let (_, metadata) = SafeTensors::read_metadata(&bytes).with_context(failed)?;
        let tensors = SafeTensors::deserialize(&bytes).with_context(failed)?;
        let keys = tensors.tensor(KEYS).with_context(failed)?;
        let values = tensors.tensor(EMBEDDINGS).with_context(failed)?;
        ensure_whole(path, &metadata, CHECKSUM, &[keys.data(), values.data()])?;
        let rows = keys.shape().first().copied().unwrap_or_default();
        let of_keys = (keys.dtype(), keys.shape()) == (Dtype::U8, &[rows, KEY_BYTES]);
        let of_values = (values.dtype(), values.shape()) == (Dtype::F32, &[rows, width]);
        ensure!(
            of_keys && of_values,
            "{}: found `keys` {:?} {:?} and `embeddings` {:?} {:?}, expected U8 [{rows}, {KEY_BYTES}] and F32 \
             [{rows}, {width}]",
            path.display(),
            keys.dtype(),
            keys.shape(),
            values.dtype(),
            values.shape()
        );
        let values = values.data().chunks_exact(4);
        let value = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        Ok(Self {
            keys: frame_keys(keys.data()),
            values: values.map(value).collect(),
        })
    }

    /// Reads the keys alone, checked: enough to tell whether the rest is worth reading.
    pub(crate) fn read_keys(path: &Path) -> Result<Vec<FrameKey>> {
        let failed = || format!("cannot read {}", path.display());
        let mut file = File::open(path).with_context(failed)?;
        let length = file.metadata().with_context(failed)?.len();
        let mut size = [0; 8];
        file.read_exact(&mut size).with_context(failed)?;
        let header_bytes = u64::from_le_bytes(size);
        ensure!(header_bytes < length, "{}: cut short", path.display());
        let mut header = Vec::new();
        let read = (&mut file).take(header_bytes).read_to_end(&mut header);
        read.with_context(failed)?;
        let metadata: Metadata = serde_json::from_slice(&header).with_context(failed)?;
        let Some(info) = metadata.info(KEYS) else {
            bail!("{}: has no tensor `{KEYS}`", path.display());
        };
        let (start, end) = info.data_offsets;
        let reaches = (8 + header_bytes).checked_add(end as u64);
        ensure!(
            reaches.is_some_and(|reaches| reaches <= length),
            "{}: cut short",
            path.display()
        );
        let begins = SeekFrom::Start(8 + header_bytes + start as u64);
        file.seek(begins).with_context(failed)?;
        let mut keys = vec![0; end - start];
        file.read_exact(&mut keys).with_context(failed)?;
        ensure_whole(path, &metadata, KEYS_CHECKSUM, &[&keys])?;
        Ok(frame_keys(&keys))
    }
}

/// That the checksum of this name is that of these parts of the file.
fn ensure_whole(path: &Path, metadata: &Metadata, name: &str, parts: &[&[u8]]) -> Result<()> {
    let stored = metadata.metadata().as_ref().and_then(|all| all.get(name));
    ensure!(
        stored == Some(&checksum(parts)),
        "{}: the {name} does not match the file's content",
        path.display()
    );
    Ok(())
}

fn frame_keys(bytes: &[u8]) -> Vec<FrameKey> {
    let (keys, _) = bytes.as_chunks::<KEY_BYTES>();
    keys.to_vec()
}
