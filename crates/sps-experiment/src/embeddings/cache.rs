//! Embeddings on disk, found again by the content of the frame and the identity of the encoder.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Result;
use sps_dataset::FrameKey;
use tracing::warn;

use super::segment::Segment;
use crate::files::{create_folder, inside, remove_unfinished};
use crate::work::Work;

/// How long after the last write a file that is not whole belongs to a process that was killed: others
/// write one in seconds.
const IDLE: Duration = Duration::from_secs(3600);

/// The cached embeddings of one encoder with one way of preparing frames.
///
/// A folder of [`Segment`]s, each written once, so that several runs can share it and a run killed
/// at any moment leaves only whole segments behind. A damaged segment is set aside with a line in
/// the log, and its frames are encoded again; one that cannot be read is an error.
pub(crate) struct EmbeddingCache {
    folder: PathBuf,
    width: usize,
    /// What is done of what it lacks.
    pub(super) work: Work,
}

pub(super) type Seen = HashSet<PathBuf>;

impl EmbeddingCache {
    /// Opens or creates the cache of the encoder called `encoder` under `root`, for so much work.
    pub(crate) fn open(root: &Path, encoder: &str, width: usize, work: Work) -> Result<Self> {
        let folder = root.join("embeddings").join(encoder);
        if work != Work::None {
            create_folder(&folder)?;
            remove_unfinished(&folder, IDLE)?;
        }
        Ok(Self {
            folder,
            width,
            work,
        })
    }

    /// What is cached of the frames called `wanted`, in segments that were not `seen` before.
    pub(super) fn get(
        &self,
        wanted: &HashSet<FrameKey>,
        seen: &mut Seen,
    ) -> Result<HashMap<FrameKey, Vec<f32>>> {
        let mut found = HashMap::new();
        for path in self.segments()? {
            if !seen.insert(path.clone()) {
                continue;
            }
            let segment = Segment::read_keys(&path).and_then(|keys| {
                let useful = keys.iter().any(|key| wanted.contains(key));
                let read = || Segment::read(&path, self.width);
                useful.then(read).transpose()
            });
            match segment {
                Ok(None) => {}
                Ok(Some(segment)) => {
                    let rows = segment.values.chunks_exact(self.width);
                    let rows = segment.keys.iter().zip(rows);
                    let rows = rows.filter(|(key, _)| wanted.contains(*key));
                    found.extend(rows.map(|(key, row)| (*key, row.to_vec())));
                }
                Err(error) => match error.downcast_ref().map(io::Error::kind) {
                    None | Some(ErrorKind::UnexpectedEof) => self.set_aside(&path, &error),
                    // Another process has set it aside.
                    Some(ErrorKind::NotFound) => {}
                    Some(_) => return Err(error),
                },
            }
        }
        Ok(found)
    }

    /// Adds embeddings; when this returns they are on disk.
    pub(crate) fn put(&self, segment: &Segment) -> Result<()> {
        segment.write(&self.folder)
    }

    fn segments(&self) -> Result<Vec<PathBuf>> {
        let mut paths = inside(&self.folder)?;
        paths.retain(|path| path.extension().is_some_and(|name| name == "safetensors"));
        Ok(paths)
    }

    fn set_aside(&self, path: &Path, error: &anyhow::Error) {
        warn!("{error:#}; its frames are encoded again");
        if self.work == Work::None {
            return;
        }
        if let Err(error) = fs::rename(path, path.with_extension("damaged")) {
            warn!("cannot set {} aside: {error}", path.display());
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::fuzz::{broken, fuzz, nested, with_header};

    fn segment(first: u8, rows: u8) -> Segment {
        let keys: Vec<FrameKey> = (first..first + rows).map(|i| [i; 32]).collect();
        let values = keys.iter().flat_map(|k| [f32::from(k[0]), 0.5]).collect();
        Segment { keys, values }
    }

    fn get<const N: usize>(
        cache: &EmbeddingCache,
        keys: [u8; N],
    ) -> Result<HashMap<FrameKey, Vec<f32>>> {
        cache.get(&keys.map(|key| [key; 32]).into(), &mut Seen::new())
    }

    #[test]
    fn finds_what_was_put_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let cache = EmbeddingCache::open(folder.path(), "e", 2, Work::All).unwrap();
        cache.put(&segment(0, 4)).unwrap();
        cache.put(&segment(4, 4)).unwrap();
        let found = get(&cache, [1, 6, 99]).unwrap();
        assert_eq!(found.len(), 2);
        assert_eq!(found[&[6; 32]], [6.0, 0.5]);
        let other = EmbeddingCache::open(folder.path(), "other", 2, Work::All).unwrap();
        assert!(get(&other, [1]).unwrap().is_empty());
    }

    /// A cache with one segment.
    struct Stored {
        root: tempfile::TempDir,
        cache: EmbeddingCache,
        path: PathBuf,
        whole: Vec<u8>,
    }

    impl Stored {
        fn new(first: u8, rows: u8) -> Self {
            let root = tempfile::tempdir().unwrap();
            let cache = EmbeddingCache::open(root.path(), "e", 2, Work::All).unwrap();
            cache.put(&segment(first, rows)).unwrap();
            let path = cache.segments().unwrap().remove(0);
            Self {
                root,
                cache,
                whole: fs::read(&path).unwrap(),
                path,
            }
        }

        /// What is found of four frames where the segment's file holds `bytes` is what was put.
        fn holds_no_other(&self, bytes: &[u8]) {
            let _ = fs::remove_file(self.path.with_extension("damaged"));
            fs::write(&self.path, bytes).unwrap();
            for (key, row) in get(&self.cache, [0, 1, 2, 3]).unwrap() {
                assert_eq!(row, [f32::from(key[0]), 0.5]);
            }
        }
    }

    #[test]
    fn a_damaged_segment_is_never_believed() {
        let stored = Stored::new(0, 4);
        let whole = &stored.whole;
        for at in 0..whole.len() {
            stored.holds_no_other(&whole[..at]);
            let mut bytes = whole.clone();
            bytes[at] ^= 0x10;
            stored.holds_no_other(&bytes);
        }
    }

    /// In the header too, whose fields lie in another order in every file.
    #[test]
    fn every_flipped_bit_of_a_segment_is_noticed() {
        let stored = Stored::new(0, 1);
        for bit in 0..8 * stored.whole.len() {
            let mut bytes = stored.whole.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            stored.holds_no_other(&bytes);
            assert!(!stored.path.exists(), "bit {} of byte {}", bit % 8, bit / 8);
        }
    }

    /// By its keys alone it would be a segment of frames that nobody wants.
    #[test]
    fn a_segment_whose_only_key_is_damaged_is_set_aside() {
        let Stored {
            cache, path, whole, ..
        } = &Stored::new(7, 1);
        let mut bytes = whole.clone();
        let key = whole.windows(32).position(|bytes| bytes == [7; 32]);
        bytes[key.unwrap()] ^= 1;
        fs::write(path, bytes).unwrap();
        assert!(get(cache, [7]).unwrap().is_empty());
        assert!(path.with_extension("damaged").exists());
    }

    /// Whatever the reason, nothing is known of its content.
    #[test]
    fn a_segment_that_cannot_be_read_is_named_and_stays() {
        let Stored { cache, path, .. } = &Stored::new(0, 4);
        fs::remove_file(path).unwrap();
        fs::create_dir(path).unwrap();
        let error = get(cache, [1]).unwrap_err();
        let name = path.display().to_string();
        assert!(format!("{error:#}").contains(&name), "{error:#}");
        assert!(path.exists());
    }

    #[test]
    fn what_killed_processes_left_is_removed() {
        let Stored { root, cache, .. } = &Stored::new(0, 4);
        let [old, new] = [2 * IDLE, IDLE / 2].map(|idle| {
            let path = cache.folder.join(format!(".writing-{}", idle.as_secs()));
            let file = fs::File::create(&path).unwrap();
            let modified = std::time::SystemTime::now() - idle;
            file.set_modified(modified).unwrap();
            path
        });
        EmbeddingCache::open(root.path(), "e", 2, Work::None).unwrap();
        assert!(old.exists());
        EmbeddingCache::open(root.path(), "e", 2, Work::All).unwrap();
        assert!(!old.exists() && new.exists());
        assert_eq!(cache.segments().unwrap().len(), 1);
    }

    #[test]
    fn any_damage_to_a_segment_costs_its_frames_alone() {
        let stored = Stored::new(0, 4);
        let whole = &stored.whole;
        let input = broken(vec![whole.clone()]);
        fuzz("segments of the cache", &input, |bytes| {
            stored.holds_no_other(&bytes);
        });
        nested("segments of the cache", |text| {
            stored.holds_no_other(&with_header(whole, |_| text.into_bytes()));
        });
        // Tensors that are as long as an address reaches, and keys at its end.
        let far = |name: String, at: u64, length: u64| {
            let offsets = [at, at + length];
            let tensor = json!({ "dtype": "U8", "shape": [length], "data_offsets": offsets });
            (name, tensor)
        };
        let (long, last) = (1_u64 << 60, 15_u64 << 60);
        let tensors = (0..15).map(|i| far(format!("t{i}"), i * long, long));
        let tensors = tensors.chain([
            far("t15".to_owned(), last, long - 40),
            far("keys".to_owned(), last + (long - 40), 32),
        ]);
        let header = Value::Object(tensors.collect()).to_string();
        stored.holds_no_other(&with_header(whole, |_| header.into_bytes()));
    }
}
