//! Whatever bytes a reader is given, it answers: no panic, and never a gigabyte for them.
//!
//! `PROPTEST_CASES=100000 cargo test --release -p sps-dataset --all-features --test fuzz` runs as
//! many cases of each as wanted.

mod common;
#[path = "common/folder.rs"]
mod folder;

use std::sync::{Mutex, PoisonError};

use folder::{MANIFEST, Made, SURFACES};
use peak_alloc::PeakAlloc;
use proptest::prelude::*;
use proptest::sample::{Index, select};
use sps_dataset::{DecodeSettings, FrameErrorKind, Source, TactileSettings, decode_image};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Cases are counted one at a time.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Runs a case on an input of far less than a mebibyte.
fn within_memory(case: impl FnOnce()) {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    MEMORY.reset_peak_usage();
    case();
    let peak = MEMORY.peak_usage_as_mb();
    assert!(peak < 1024.0, "it took {peak} MiB");
}

/// What befalls a file.
#[derive(Clone, Debug)]
enum Damage {
    /// Bits that were turned over.
    Flipped(Vec<(Index, u8)>),
    /// The end is gone.
    Cut(Index),
    /// Four bytes that may be a size, in either order.
    Size(Index, u32, bool),
    /// A stretch that is there twice.
    Repeated(Index, Index),
}

impl Damage {
    fn any() -> impl Strategy<Value = Self> {
        let sizes = vec![
            0,
            1,
            0xff,
            0xffff,
            1 << 20,
            1 << 30,
            i32::MAX as u32,
            u32::MAX,
        ];
        prop_oneof![
            4 => prop::collection::vec((any::<Index>(), 0_u8..8), 1..6).prop_map(Self::Flipped),
            1 => any::<Index>().prop_map(Self::Cut),
            3 => (any::<Index>(), select(sizes), any::<bool>()).prop_map(|(at, size, big)| Self::Size(at, size, big)),
            1 => (any::<Index>(), any::<Index>()).prop_map(|(from, to)| Self::Repeated(from, to)),
        ]
    }

    fn apply(&self, mut bytes: Vec<u8>) -> Vec<u8> {
        if bytes.is_empty() {
            return bytes;
        }
        match self {
            Self::Flipped(bits) => {
                let length = bytes.len();
                for (at, bit) in bits {
                    bytes[at.index(length)] ^= 1 << bit;
                }
            }
            Self::Cut(at) => bytes.truncate(at.index(bytes.len())),
            Self::Size(at, size, big) => {
                let size = if *big {
                    size.to_be_bytes()
                } else {
                    size.to_le_bytes()
                };
                let at = at.index(bytes.len());
                bytes
                    .iter_mut()
                    .skip(at)
                    .zip(size)
                    .for_each(|(byte, new)| *byte = new);
            }
            Self::Repeated(from, to) => {
                let (from, to) = (from.index(bytes.len()), to.index(bytes.len()));
                let stretch = bytes[from.min(to)..from.max(to)].to_vec();
                bytes.splice(to..to, stretch);
            }
        }
        bytes
    }
}

/// Every image file of `tests/data`.
fn images() -> Vec<String> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let mut names = Vec::new();
    for format in ["exr", "png", "jpeg"] {
        for entry in std::fs::read_dir(folder.join(format)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|ending| ending != "f32") {
                let name = path.file_name().unwrap().to_str().unwrap();
                names.push(format!("{format}/{name}"));
            }
        }
    }
    names.sort();
    names
}

fn decode(bytes: &[u8]) {
    within_memory(|| {
        let decoded = decode_image(bytes, &DecodeSettings::default());
        match decoded {
            Ok(decoded) => {
                let frame = decoded.frame;
                assert_eq!(frame.data.len(), frame.width * frame.height * 3);
                assert!(frame.data.iter().all(|value| (0.0..=1.0).contains(value)));
            }
            Err(FrameErrorKind::Io(error)) => panic!("no file was read: {error}"),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    });
}

/// Opens a dataset one file of which is in doubt, and looks at all that was read.
fn open(made: &Made) {
    within_memory(|| match made.open() {
        Ok(dataset) => {
            let averages = dataset
                .tactile()
                .averages(&TactileSettings::default(), dataset.surfaces().len());
            for &property in averages.properties() {
                assert!(
                    averages
                        .column(property)
                        .iter()
                        .flatten()
                        .all(|value| value.is_finite())
                );
            }
            dataset.inspect(&TactileSettings::default());
        }
        Err(error) => assert!(error.to_string().contains(": ")),
    });
}

/// Form, settings and file of each kind of table, with content to be damaged.
fn tables() -> Vec<(&'static str, &'static str, Vec<u8>)> {
    let long =
        "surface,location,repeat,fRS,cDF\na,0,0,1,2\na,0,1,,2.5\n\"b\",4294967295,7,-1e8,1e-7\n";
    let wide = "surface,fRS,cDF\na,1,2\nmean,1,2\nstd,3,4\nc,,5\n";
    let keyed = r#"{"a": [1, 2], "b": [[3, null], [4e5, -6]], "c": [[[7, 8]]], "mean": [1, 2], "std": [3, 4]}"#;
    let records = r#"[{"surface": "a", "location": 1, "repeat": 2, "fRS": 3.5, "cDF": 1}, {"surface": "b", "cDF": null}]"#;
    let json = "[tactile.json]\nproperty-order = [\"fRS\", \"cDF\"]\nstatistics.restore = true";
    vec![
        ("", "tactile.csv", long.into()),
        (
            "[tactile.wide-csv]\nstatistics.restore = true",
            "tactile.csv",
            wide.into(),
        ),
        (json, "tactile.json", keyed.into()),
        (
            "[tactile.json]\nlayout = \"records\"",
            "tactile.json",
            records.into(),
        ),
    ]
}

#[cfg(feature = "npz")]
fn archives() -> Vec<(&'static str, &'static str, Vec<u8>)> {
    let keyed = "[tactile.npz]\nproperty-order = [\"fRS\", \"cDF\"]";
    let stacked = "[tactile.npz]\nproperty-order = [\"fRS\", \"cDF\"]\n[tactile.npz.layout.stacked]\nsurfaces = \"names\"";
    let archive = |settings, name: &str| {
        (
            settings,
            "tactile.npz",
            common::data(&format!("npz/{name}.npz")),
        )
    };
    vec![
        archive(keyed, "keyed-stored"),
        archive(keyed, "keyed-fortran"),
        archive(keyed, "keyed-i8"),
        archive(stacked, "stacked"),
        archive(stacked, "stacked-bytes"),
    ]
}

#[cfg(not(feature = "npz"))]
fn archives() -> Vec<(&'static str, &'static str, Vec<u8>)> {
    Vec::new()
}

/// Bytes that look like the beginning of something.
fn noise() -> impl Strategy<Value = Vec<u8>> {
    let starts: Vec<&[u8]> = vec![
        b"",
        b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
        b"\xff\xd8\xff\xe0\0\x10JFIF\0",
        b"\xff\xd8\xff\xdb",
        b"\x76\x2f\x31\x01\x02\0\0\0",
        b"\x76\x2f\x31\x01\x02\x10\0\0channels\0chlist\0",
        b"PK\x03\x04",
        b"surface,location,repeat,fRS,cDF\n",
        b"{\"a\": [",
    ];
    (select(starts), prop::collection::vec(any::<u8>(), 0..2000))
        .prop_map(|(start, rest)| [start, rest.as_slice()].concat())
}

proptest! {
    #[test]
    fn damaged_images(name in select(images()), damages in prop::collection::vec(Damage::any(), 1..3)) {
        let whole = common::data(&name);
        decode(&damages.iter().fold(whole, |bytes, damage| damage.apply(bytes)));
    }

    #[test]
    fn noise_as_an_image(bytes in noise()) {
        decode(&bytes);
    }

    #[test]
    fn damaged_tables(
        (settings, file, table) in select([tables(), archives()].concat()),
        damages in prop::collection::vec(Damage::any(), 1..3),
    ) {
        let table = damages.iter().fold(table, |bytes, damage| damage.apply(bytes));
        open(&Made::new(settings, file, table));
    }

    #[test]
    fn noise_as_a_table(
        (settings, file, _) in select([tables(), archives()].concat()),
        bytes in noise(),
    ) {
        open(&Made::new(settings, file, bytes));
    }

    #[test]
    fn damaged_manifests_and_surfaces(damage in Damage::any(), of_manifest in any::<bool>()) {
        let made = Made::new("", "tactile.csv", "surface,location,repeat,fRS,cDF\na,0,0,1,2\n");
        if of_manifest {
            let whole = format!("{MANIFEST}[tactile.json]\nlayout = \"keyed\"\nstatistics.mean = \"m\"\n");
            made.write("dataset.toml", damage.apply(whole.into_bytes()));
        } else {
            made.write("surfaces.csv", damage.apply(SURFACES.as_bytes().to_vec()));
        }
        open(&made);
    }

    #[test]
    fn noise_as_a_manifest(text in "\\PC{0,200}", bytes in noise()) {
        let made = Made::new("", "tactile.csv", "");
        made.write("dataset.toml", text);
        open(&made);
        made.write("dataset.toml", bytes);
        open(&made);
    }
}
