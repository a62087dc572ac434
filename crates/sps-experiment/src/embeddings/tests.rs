use sps_dataset::{RollAngle, SourceError, Surface, TactileTable};

use super::*;

/// Black frames of these sizes, one for each surface, counting those asked for.
struct Sizes {
    sizes: Vec<[usize; 2]>,
    decoded: AtomicUsize,
}

impl Source for Sizes {
    fn name(&self) -> &'static str {
        "sizes"
    }

    fn surfaces(&self) -> &[Surface] {
        &[]
    }

    fn view_angles(&self) -> &[RollAngle] {
        &[]
    }

    fn tactile(&self) -> &TactileTable {
        unreachable!("no reading is asked for")
    }

    fn frame(&self, surface: usize, _: usize) -> Result<Frame, SourceError> {
        self.decoded.fetch_add(1, Ordering::Relaxed);
        let [width, height] = self.sizes[surface];
        let data = vec![0.0; width * height * 3];
        Ok(Frame {
            width,
            height,
            data,
        })
    }

    fn frame_key(&self, surface: usize, _: usize) -> Result<FrameKey, SourceError> {
        Ok([surface as u8; 32])
    }
}

/// A ten thousandth of what may be held, beside frames with a ten thousandth of the pixels.
const ROOM: usize = BYTES_AT_ONCE / 10_000;

/// How many of these frames are decoded at once, again and again until all are, none twice.
fn chunks(sizes: &[[usize; 2]]) -> Vec<usize> {
    let source = Sizes {
        sizes: sizes.to_vec(),
        decoded: AtomicUsize::new(0),
    };
    let wanted = (0..sizes.len()).map(|surface| ([0; 32], FrameIndex { surface, view: 0 }));
    let wanted: Vec<Wanted> = wanted.collect();
    let (mut rest, mut chunks) = (&wanted[..], Vec::new());
    while !rest.is_empty() {
        let frames = decode_some(&source, rest, None, ROOM).unwrap();
        for (frame, (_, index)) in frames.iter().zip(rest) {
            assert_eq!([frame.width, frame.height], sizes[index.surface]);
        }
        chunks.push(frames.len());
        rest = &rest[frames.len()..];
    }
    assert_eq!(source.decoded.into_inner(), sizes.len());
    chunks
}

#[test]
fn large_frames_are_held_by_their_bytes() {
    // 12 megapixels of three 4-byte colours are 144 MB, of which one fits into 256 MiB.
    assert_eq!(chunks(&[[40, 30]; 3]), [1, 1, 1]);
    // 1 megapixel: 12 MB, 22 of them.
    assert_eq!(chunks(&[[10, 10]; 50]), [22, 22, 6]);
    assert_eq!(chunks(&[[1, 1]; 70]), [32, 32, 6]);
    // One that is larger than all that may be held is still decoded.
    assert_eq!(chunks(&[[60, 40]; 2]), [1, 1]);
}

#[test]
fn frames_that_grow_stop_what_is_held() {
    let mut sizes = vec![[1, 1]; 4];
    sizes.extend([[40, 30]; 12]);
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let chunks = one_thread.unwrap().install(|| chunks(&sizes));
    // One large frame leaves room, two do not.
    assert_eq!(chunks[0], 6);
    assert_eq!(chunks.iter().sum::<usize>(), 16);
}

/// Where threads divide the frames among them beforehand, the second half begins while the first
/// still fills the room.
#[test]
fn frames_of_any_sizes_are_decoded_once_by_any_threads() {
    let side = |at: usize| [40, 1, 70, 10, 3][at * at % 5];
    let sizes: Vec<_> = (0..400).map(|at| [side(at), side(at + 1)]).collect();
    for threads in [1, 2, 8] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let chunks = pool.unwrap().install(|| chunks(&sizes));
        assert_eq!(chunks.iter().sum::<usize>(), sizes.len());
    }
}
