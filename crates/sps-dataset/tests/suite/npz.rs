//! Archives that NumPy wrote (`data/make_npz.py`), against the formula of their content.

use crate::common::data;
use crate::made::{Made, cases};
use sps_dataset::{DatasetFolder, ReadSettings, Source, read_npy};

fn npz(settings: &str, archive: &str) -> Made {
    let tactile = format!("[tactile.npz]\nproperty-order = [\"fRS\", \"cDF\"]\n{settings}");
    Made::new(&tactile, "tactile.npz", data(&format!("npz/{archive}.npz")))
}

/// Compares every reading with `100 s + 10 l + 2 r + p`.
fn check(archive: &str, made: &Made, touches: usize, modulus: u32) {
    let dataset = made.open();
    let dataset = dataset.unwrap_or_else(|error| panic!("{archive}: {error}"));
    let readings = &dataset.tactile().readings;
    assert_eq!(readings.len(), 3 * touches, "{archive}");
    for reading in readings {
        let first = 100 * reading.surface as u32 + 10 * reading.location + 2 * reading.repeat;
        let expected = [first, first + 1].map(|value| Some(f64::from(value % modulus)));
        assert_eq!(reading.values, expected, "{archive}: {reading:?}");
    }
}

#[test]
fn every_dtype_and_both_orders() {
    for archive in "f4 f8 f8-big i8 i4-big i2 u2 stored fortran".split(' ') {
        let archive = format!("keyed-{archive}");
        check(&archive, &npz("", &archive), 6, u32::MAX);
    }
    check("u1", &npz("", "keyed-u1"), 6, 200);
    check("repeats", &npz("", "keyed-repeats"), 3, u32::MAX);
    check("single", &npz("", "keyed-single"), 1, u32::MAX);
}

/// NumPy itself writes `<` or `>` for it.
#[test]
fn a_dtype_in_native_order() {
    let header = "{'descr': '=f8', 'fortran_order': False, 'shape': (2,), }\n";
    let length = (header.len() as u16).to_le_bytes();
    let numbers = [1.5_f64, -2.0].map(f64::to_ne_bytes).concat();
    let array = [b"\x93NUMPY\x01\0", &length[..], header.as_bytes(), &numbers].concat();
    assert_eq!(read_npy(&array, 2), Ok((vec![2], vec![1.5, -2.0])));
}

#[test]
fn one_array_for_all_surfaces() {
    let named = "[tactile.npz.layout.stacked]\nsurfaces = \"names\"";
    for archive in ["stacked", "stacked-bytes", "stacked-shuffled"] {
        check(archive, &npz(named, archive), 6, u32::MAX);
    }
    let unnamed = npz("[tactile.npz.layout.stacked]", "stacked");
    check("unnamed", &unnamed, 6, u32::MAX);
}

#[test]
fn what_cannot_be_read_is_named() {
    let keyed = "
        pickled
            , key `a`: is not valid NPY: its items are pickled Python objects, expected plain numbers: \
            save it again as an array of floats
        infinite
            , key `b`: found `inf` in column `cDF`, expected a number within 1e9 of 0, or NaN
        records
            , key `a`: is not valid NPY: its items are records of several fields, expected numbers or texts
        half
            , key `a`: is not valid NPY: its items are of dtype `<f2`, expected i1 to i8, u1 to u8, \
            f4 or f8, or U or S
        stacked
            , key `values`: the axes of a surface: found [3, 2, 3, 2], expected (properties), \
            (repeats, properties) or (locations, repeats, properties) with 2 properties, as in `property-order`
    ";
    for (archive, expected) in cases(keyed) {
        let refusal = npz("", &archive).refusal();
        assert_eq!(refusal, format!("tactile.npz{expected}"));
    }
    let no_order = Made::new("[tactile.npz]", "tactile.npz", data("npz/keyed-f8.npz"));
    let expected = "tactile.npz: the order of its properties is not given";
    assert!(no_order.refusal().starts_with(expected));
    let unknown = npz("[tactile.npz.layout.stacked]\nvalues = \"data\"", "stacked");
    let expected = "tactile.npz: its arrays: found values, names, expected an array `data`";
    assert_eq!(unknown.refusal(), expected);
    let read = npz("", "keyed-f8").open().unwrap();
    assert_eq!(read.tactile().properties, ["fRS", "cDF"]);
}

#[test]
fn an_archive_that_unpacks_beyond_the_limit_is_refused() {
    let made = npz("", "large");
    let refusal = |table_bytes: u64| {
        let settings = ReadSettings {
            table_bytes,
            ..ReadSettings::default()
        };
        let opened = DatasetFolder::open(made.path(), &settings);
        opened.unwrap_err().to_string()
    };
    let bytes = refusal(10_000);
    let expected = "is not valid NPZ: its arrays unpack to more than the limit of 10000 bytes";
    assert!(bytes.ends_with(expected), "{bytes}");
    // 10000 values of 8 bytes; each is reckoned at 64.
    let values = refusal(100_000);
    let expected = "its header says shape [100, 50, 2], more than the limit of 1562 items";
    assert!(values.ends_with(expected), "{values}");
}
