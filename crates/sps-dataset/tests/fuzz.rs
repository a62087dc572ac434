//! Whatever bytes a reader of images, tables or manifests is given, it answers within its limits;
//! `fixtures/fuzz` says which.

#[path = "suite/common.rs"]
mod common;
#[path = "../../../fixtures/fuzz/mod.rs"]
mod fuzz;
#[path = "suite/made.rs"]
mod made;

use std::path::{Path, PathBuf};

use fuzz::{Damage, damaged, fuzz, nested};
use made::{MANIFEST, Made, SURFACES};
use proptest::prelude::*;
use proptest::sample::select;
use sps_dataset::{DecodeSettings, FrameErrorKind, Source, TactileSettings, decode_image};

/// Every image file of a format in `tests/data`, by name.
fn images(format: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let entries = std::fs::read_dir(folder.join(format)).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    let is_image = |path: &PathBuf| path.extension().is_some_and(|ending| ending != "f32");
    let mut paths: Vec<PathBuf> = paths.filter(is_image).collect();
    paths.sort();
    paths
        .iter()
        .map(|path| std::fs::read(path).unwrap())
        .collect()
}

fn decode(bytes: &[u8]) {
    match decode_image(bytes, &DecodeSettings::default()) {
        Ok(decoded) => {
            let frame = decoded.frame;
            assert_eq!(frame.data.len(), frame.width * frame.height * 3);
            assert!(frame.data.iter().all(|value| (0.0..=1.0).contains(value)));
        }
        Err(FrameErrorKind::Io(error)) => panic!("no file was read: {error}"),
        // A panic inside a decoder is caught; it should have been seen coming.
        Err(error) => assert!(!error.to_string().contains("gave up"), "{error}"),
    }
}

/// Opens a dataset one file of which is in doubt, and looks at all that was read.
fn open(made: &Made) {
    match made.open() {
        Ok(dataset) => {
            let settings = TactileSettings::default();
            let surfaces = dataset.surfaces().len();
            let averages = dataset.tactile().averages(&settings, surfaces);
            for property in averages.properties() {
                let mut values = averages.column(property).into_iter().flatten();
                assert!(values.all(f64::is_finite));
            }
            dataset.inspect(&settings);
        }
        Err(error) => assert!(error.to_string().contains(": ")),
    }
}

/// Settings of a table, its file, and content to be damaged.
type Table = (&'static str, &'static str, Vec<u8>);

/// A table of each form of text.
fn tables() -> Vec<Table> {
    let long =
        "surface,location,repeat,fRS,cDF\na,0,0,1,2\na,0,1,,2.5\n\"b\",4294967295,7,-1e8,1e-7\n";
    let wide = "surface,fRS,cDF\na,1,2\nmean,1,2\nstd,3,4\nc,,5\n";
    let restored = "[tactile.wide-csv]\nstatistics.restore = true";
    let keyed = r#"{"a": [1, 2], "b": [[3, null], [4e5, -6]], "c": [[[7, 8]]], "mean": [1, 2], "std": [3, 4]}"#;
    let ordered = "[tactile.json]\nproperty-order = [\"fRS\", \"cDF\"]\nstatistics.restore = true";
    let records = r#"[{"surface": "a", "location": 1, "repeat": 2, "fRS": 3.5, "cDF": 1}, {"surface": "b", "cDF": null}]"#;
    let listed = "[tactile.json]\nlayout = \"records\"";
    vec![
        ("", "tactile.csv", long.into()),
        (restored, "tactile.csv", wide.into()),
        (ordered, "tactile.json", keyed.into()),
        (listed, "tactile.json", records.into()),
    ]
}

/// Archives, where they can be read.
fn archives() -> Vec<Table> {
    let keyed = "[tactile.npz]\nproperty-order = [\"fRS\", \"cDF\"]";
    let stacked = "[tactile.npz]\nproperty-order = [\"fRS\", \"cDF\"]\n[tactile.npz.layout.stacked]\nsurfaces = \"names\"";
    let archives = [
        (keyed, "keyed-stored"),
        (keyed, "keyed-fortran"),
        (keyed, "keyed-i8"),
        (stacked, "stacked"),
        (stacked, "stacked-bytes"),
    ];
    let archives = archives.into_iter().filter(|_| cfg!(feature = "npz"));
    let read = |(settings, name)| {
        let archive = common::data(&format!("npz/{name}.npz"));
        (settings, "tactile.npz", archive)
    };
    archives.map(read).collect()
}

fn open_damaged((settings, file, table): Table, damages: &[Damage]) {
    open(&Made::new(settings, file, damaged(table, damages)));
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

/// Images of a format, damaged.
fn broken(format: &str) -> impl Strategy<Value = Vec<u8>> {
    (select(images(format)), Damage::some()).prop_map(|(file, damages)| damaged(file, &damages))
}

#[test]
fn exr() {
    fuzz("exr", &broken("exr"), |bytes| decode(&bytes));
}

#[test]
fn png() {
    fuzz("png", &broken("png"), |bytes| decode(&bytes));
}

#[test]
fn jpeg() {
    fuzz("jpeg", &broken("jpeg"), |bytes| decode(&bytes));
}

/// With the chunks' checksums made right again, so that the damage is looked at.
#[test]
fn png_chunks() {
    fuzz("png chunks", &broken("png"), |mut bytes| {
        sign_chunks(&mut bytes);
        decode(&bytes);
    });
}

/// Found by the target above: colours that are cut, and more than 256.
#[test]
fn png_palettes_of_any_length() {
    let whole = common::data("png/palette4.png");
    let place = whole.windows(4).position(|name| name == b"PLTE").unwrap();
    let length = u32::from_be_bytes(whole[place - 4..place].try_into().unwrap()) as usize;
    let (head, tail) = (&whole[..place - 4], &whole[place + 4 + length..]);
    for bytes in (0..=3 * 16 + 2).chain(764..=772) {
        let size = (bytes as u32).to_be_bytes();
        let mut png = [head, &size, b"PLTE", &vec![7; bytes], tail].concat();
        sign_chunks(&mut png);
        match decode_image(&png, &DecodeSettings::default()) {
            Ok(_) => assert!(bytes % 3 == 0 && bytes <= 768, "{bytes}"),
            Err(error) => assert!(!error.to_string().contains("gave up"), "{bytes}: {error}"),
        }
    }
}

/// Puts the checksum of each chunk behind it: CRC-32 of its name and content.
fn sign_chunks(png: &mut [u8]) {
    let mut at = 8;
    while let Some(length) = png.get(at..).and_then(|rest| rest.first_chunk::<4>()) {
        let length = u32::from_be_bytes(*length) as usize;
        let end = at.saturating_add(length + 8);
        if end.saturating_add(4) > png.len() {
            return;
        }
        let sum = crc32(&png[at + 4..end]).to_be_bytes();
        png[end..end + 4].copy_from_slice(&sum);
        at = end + 4;
    }
}

fn crc32(bytes: &[u8]) -> u32 {
    let step = |sum: u32| (sum >> 1) ^ if sum & 1 == 1 { 0xedb8_8320 } else { 0 };
    let of_byte = |sum: u32, byte: &u8| (0..8).fold(sum ^ u32::from(*byte), |sum, _| step(sum));
    !bytes.iter().fold(u32::MAX, of_byte)
}

#[test]
fn noise_as_an_image() {
    fuzz("noise as an image", &noise(), |bytes| decode(&bytes));
}

#[test]
fn tables_of_each_form() {
    let input = (select(tables()), Damage::some());
    fuzz("csv and json", &input, |(table, damages)| {
        open_damaged(table, &damages);
    });
    nested("csv and json", |text| {
        for (settings, file, _) in tables() {
            open(&Made::new(settings, file, &text));
        }
    });
}

#[test]
#[cfg(feature = "npz")]
fn archives_of_arrays() {
    let input = (select(archives()), Damage::some());
    fuzz("npz", &input, |(table, damages)| {
        open_damaged(table, &damages);
    });
}

/// With an array damaged inside an archive that is whole, so that the damage is looked at.
#[test]
#[cfg(feature = "npz")]
fn arrays_in_an_archive() {
    use std::io::{Cursor, Read, Write};
    let index = any::<proptest::sample::Index>();
    let input = (select(archives()), index, Damage::some());
    fuzz("npy", &input, |(table, which, damages)| {
        let (settings, file, archive) = table;
        let mut archive = zip::ZipArchive::new(Cursor::new(archive)).unwrap();
        let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let which = which.index(archive.len());
        for index in 0..archive.len() {
            let mut array = archive.by_index(index).unwrap();
            let mut content = Vec::new();
            array.read_to_end(&mut content).unwrap();
            if index == which {
                content = damaged(content, &damages);
            }
            let name = array.name().unwrap().into_owned();
            let options = zip::write::SimpleFileOptions::default();
            writer.start_file(name, options).unwrap();
            writer.write_all(&content).unwrap();
        }
        let bytes = writer.finish().unwrap().into_inner();
        open(&Made::new(settings, file, bytes));
    });
}

#[test]
fn noise_as_a_table() {
    let input = (select([tables(), archives()].concat()), noise());
    fuzz("noise as a table", &input, |(table, bytes)| {
        let (settings, file, _) = table;
        open(&Made::new(settings, file, bytes));
    });
}

#[test]
fn manifests_and_surfaces() {
    let table = "surface,location,repeat,fRS,cDF\na,0,0,1,2\n";
    let open_with = |file: &str, content: &[u8]| {
        let made = Made::new("", "tactile.csv", table);
        made.write(file, content);
        open(&made);
    };
    let more = "[tactile.json]\nlayout = \"keyed\"\nstatistics.mean = \"m\"\n";
    let files = vec![
        ("dataset.toml", format!("{MANIFEST}{more}")),
        ("surfaces.csv", SURFACES.to_owned()),
    ];
    let input = (Damage::some(), select(files));
    fuzz("toml and surfaces", &input, |(damages, (file, whole))| {
        open_with(file, &damaged(whole.into_bytes(), &damages));
    });
    nested("toml", |text| open_with("dataset.toml", text.as_bytes()));
}

#[test]
fn noise_as_a_manifest() {
    let input = ("\\PC{0,200}", noise());
    fuzz("noise as a manifest", &input, |(text, bytes)| {
        let made = Made::new("", "tactile.csv", "");
        made.write("dataset.toml", text);
        open(&made);
        made.write("dataset.toml", bytes);
        open(&made);
    });
}
