//! Tactile tables in their four forms: what is read, and what is refused with which words.

use crate::made::{Made, cases};
use sps_dataset::{Reading, Source};

fn readings(made: &Made) -> Vec<(usize, u32, u32, Vec<Option<f64>>)> {
    let dataset = made.open().unwrap();
    let readings = dataset.tactile().readings.iter();
    let fields = |r: &Reading| (r.surface, r.location, r.repeat, r.values.clone());
    readings.map(fields).collect()
}

#[test]
fn long_csv_columns_in_any_order_with_missing_cells() {
    let made = Made::long(
        "\u{feff}cDF,surface , repeat,location,fRS\r\n1.5,b,0,2, 7\r\n,a,1,0,-3e0\r\n\r\nNaN,a,0,0,+.5\r\n",
    );
    let expected = vec![
        (1, 2, 0, vec![Some(7.0), Some(1.5)]),
        (0, 0, 1, vec![Some(-3.0), None]),
        (0, 0, 0, vec![Some(0.5), None]),
    ];
    assert_eq!(readings(&made), expected);
}

#[test]
fn long_csv_leaves_out_what_it_is_told_to_and_what_the_dataset_does_not_list() {
    let made = Made::new(
        "[tactile.long-csv]\nfile = \"t.csv\"\nignore-columns = [\"note\"]",
        "t.csv",
        "surface,location,repeat,fRS,note,cDF,aTK\na,0,0,1,\"wet, dusty\",2,3\n",
    );
    assert_eq!(readings(&made), [(0, 0, 0, vec![Some(1.0), Some(2.0)])]);
}

#[test]
fn long_csv_errors_name_line_found_and_expected() {
    let of_rows = r"
        b,0,0,1,soft
            3: found `soft` in column `cDF`, expected a number within 1e9 of 0, or nothing
        b,0,0,inf,2
            3: found `inf` in column `fRS`, expected a number within 1e9 of 0, or nothing
        b,left,0,1,2
            3: found `left` in column `location`, expected a whole number from 0 to 4294967295
        \nA,0,0,1,2
            4: unknown surface `A`, did you mean `a`?
        denim,0,0,1,2
            3: unknown surface `denim`, which is not one of those known
        a,0,0,3,4
            3: location 0, repeat 0 of surface `a` is listed twice, first at line 2
        b,0,0,1
            3: the cells of the line: found 4, expected 5
    ";
    for (row, expected) in cases(of_rows) {
        let table = format!("surface,location,repeat,fRS,cDF\na,0,0,1,2\n{row}\n");
        let expected = format!("tactile.csv, line {expected}");
        assert_eq!(Made::long(&table).refusal(), expected);
    }
    let of_headers = "
        surface,location,repeat,fRS,cDf
            : the columns of the table: found fRS, cDf, expected one for `cDF`, which the dataset lists in \
            its properties (is it `cDf`?)
        surface,location,repeat,fRS
            : the columns of the table: found fRS, expected one for `cDF`, which the dataset lists in \
            its properties
        surface,location,repeat,fRS,fRS
            , line 1: the header: found `fRS` twice, expected it once
        surface;location;repeat;fRS
            , line 1: the header: found `surface;location;repeat;fRS`, expected a column `surface`
    ";
    for (header, expected) in cases(of_headers) {
        assert_eq!(
            Made::long(&header).refusal(),
            format!("tactile.csv{expected}")
        );
    }
    let nothing = "tactile.csv, line 1: the header: found nothing, expected a column `surface`";
    assert_eq!(Made::long("").refusal(), nothing);
    let binary = b"surface,location,repeat,fRS,cDF\na,0,0,\xff,1\n";
    let expected = "tactile.csv, line 2: is not valid CSV: it has bytes that are not UTF-8 text";
    let made = Made::new("", "tactile.csv", binary);
    assert_eq!(made.refusal(), expected);
    assert_eq!(made.open().unwrap_err().line(), Some(2));
}

const WIDE_ORDERED: &str = "[tactile.wide-csv]\nproperty-order = [\"cDF\", \"fRS\"]\n";

#[test]
fn wide_csv_with_named_ignored_and_absent_header() {
    let expected = vec![
        (0, 0, 0, vec![Some(1.0), Some(2.0)]),
        (2, 0, 0, vec![None, Some(4.0)]),
    ];
    for (settings, header) in [
        ("[tactile.wide-csv]", "surface,cDF,fRS\n"),
        (&format!("{WIDE_ORDERED}header = \"ignored\""), "id,x0,x1\n"),
        (&format!("{WIDE_ORDERED}header = \"absent\""), ""),
    ] {
        let made = Made::new(settings, "tactile.csv", format!("{header}a,2,1\nc,4,\n"));
        assert_eq!(readings(&made), expected);
    }
}

#[test]
fn wide_csv_without_an_order_says_so() {
    let refusal = |settings: &str, table| Made::new(settings, "tactile.csv", table).refusal();
    assert_eq!(
        refusal("[tactile.wide-csv]\nheader = \"absent\"", "a,2,1\n"),
        "tactile.csv: the order of its properties is not given: the file does not name its \
         columns, so `property-order` must list the tactile property of each, in order"
    );
    assert_eq!(
        refusal(WIDE_ORDERED, "surface,fRS,cDF\na,2,1\n"),
        "tactile.csv, line 1: the header: found fRS,cDF, expected cDF,fRS, as `property-order` says"
    );
    assert_eq!(
        refusal("[tactile.wide-csv]", "surface,fRS,cDF\na,2,1\na,3,1\n"),
        "tactile.csv, line 3: surface `a` is listed twice, first at line 2"
    );
}

#[test]
fn statistics_are_no_surfaces_and_restore_only_when_told() {
    let table = "surface,fRS,cDF\na,-1,2\nmean,40,30\nb,0.5,\nstd,10,20\n";
    let kept = Made::new("[tactile.wide-csv]", "tactile.csv", table);
    let expected = vec![
        (0, 0, 0, vec![Some(-1.0), Some(2.0)]),
        (1, 0, 0, vec![Some(0.5), None]),
    ];
    assert_eq!(readings(&kept), expected);

    let restore = "[tactile.wide-csv]\nstatistics.restore = true";
    let restored = Made::new(restore, "tactile.csv", table);
    let expected = vec![
        (0, 0, 0, vec![Some(30.0), Some(70.0)]),
        (1, 0, 0, vec![Some(45.0), None]),
    ];
    assert_eq!(readings(&restored), expected);

    let refusal = |rows: &str| {
        let table = format!("surface,fRS,cDF\n{rows}");
        Made::new(restore, "tactile.csv", table).refusal()
    };
    assert_eq!(
        refusal("a,-1,2\nmean,40,30\n"),
        "tactile.csv: the file's own statistics: found no entry `std`, expected one number per \
         property, for the values are to be restored by them"
    );
    let gap = "tactile.csv, line 2: the file's own statistics: found a missing";
    assert!(refusal("mean,40,\nstd,1,1\n").starts_with(gap));
    let one_name = format!("{restore}\nstatistics.mean = \"m\"\nstatistics.std = \"m\"");
    let table = "surface,fRS,cDF\na,-1,2\nm,40,30\n";
    let one_name = Made::new(&one_name, "tactile.csv", table);
    let expected =
        "tactile.csv: the file's own statistics: found `m` as mean and std, expected two names";
    assert_eq!(one_name.refusal(), expected);
}

fn json(settings: &str, document: &str) -> Made {
    let settings = format!("[tactile.json]\n{settings}");
    Made::new(&settings, "tactile.json", document)
}

const ORDERED: &str = "property-order = [\"cDF\", \"fRS\"]";

#[test]
fn json_keyed_by_surface_of_values_repeats_and_locations() {
    let objects = json("", r#"{"b": {"cDF": 2, "fRS": 1}, "a": {"fRS": null}}"#);
    let expected = vec![
        (1, 0, 0, vec![Some(1.0), Some(2.0)]),
        (0, 0, 0, vec![None, None]),
    ];
    assert_eq!(readings(&objects), expected);

    let lists = json(
        ORDERED,
        r#"{"a": [2, 1], "b": [[2, 1], [4, null]], "c": [[[6, 5]], [[8, 7]]]}"#,
    );
    let expected = vec![
        (0, 0, 0, vec![Some(1.0), Some(2.0)]),
        (1, 0, 0, vec![Some(1.0), Some(2.0)]),
        (1, 0, 1, vec![None, Some(4.0)]),
        (2, 0, 0, vec![Some(5.0), Some(6.0)]),
        (2, 1, 0, vec![Some(7.0), Some(8.0)]),
    ];
    assert_eq!(readings(&lists), expected);

    let standardised = json(
        &format!("{ORDERED}\nstatistics.restore = true"),
        r#"{"mean": [10, 20], "std": [2, 4], "a": [1, -1]}"#,
    );
    let expected = (0, 0, 0, vec![Some(16.0), Some(12.0)]);
    assert_eq!(readings(&standardised), [expected]);
}

#[test]
fn json_records() {
    let made = json(
        "layout = \"records\"",
        r#"[{"surface": "c", "location": 1, "repeat": 2, "fRS": 3.5}, {"cDF": 1, "surface": "a"}]"#,
    );
    let expected = vec![
        (2, 1, 2, vec![Some(3.5), None]),
        (0, 0, 0, vec![None, Some(1.0)]),
    ];
    assert_eq!(readings(&made), expected);
}

#[test]
fn json_errors_name_the_key() {
    let keyed = r#"
        {"a": {"fRS": "high", "cDF": 1}}
            , key `a`: found `high` in column `fRS`, expected a number within 1e9 of 0, or null
        {"a": {"fRS": 1, "fRS": 2, "cDF": 1}}
            , key `a`: its keys: found `fRS` twice, expected it once
        {"a": {"fRS": 1, "cDF": 1}, "a": {}}
            , key `a`: surface `a` is listed twice, first at key `a`
        {"a": {"fRS": 1}}
            : the columns of the table: found fRS, expected one for `cDF`, which the dataset lists in its properties
        {"a": 3}
            , key `a`: an entry: found 3, expected an object or a list of values, of repeats or of locations
        [1]
            : the document: found a list, expected an object with a key per surface
        {"a": {}\n,}
            , line 2: is not valid JSON: trailing comma at line 2 column 2
    "#;
    let unordered = "tactile.json, key `a`: the order of its properties is not given: the file does not \
        name its columns, so `property-order` must list the tactile property of each, in order";
    assert_eq!(json("", r#"{"a": [1, 2]}"#).refusal(), unordered);
    let listed = r#"
        {"a": [1, 2, 3]}
            , key `a`: the length of a list: found 3, expected 2, one per entry of `property-order`
    "#;
    let records = r#"
        [{"surface": "a", "repeat": 1.5, "fRS": 1, "cDF": 2}]
            , key `[0]`: found `1.5` in column `repeat`, expected a whole number from 0 to 4294967295
        [{"fRS": 1}]
            , key `[0]`: `surface`: found nothing, expected the id of a surface
    "#;
    for (settings, lines) in [
        ("", keyed),
        (ORDERED, listed),
        ("layout = \"records\"", records),
    ] {
        for (document, expected) in cases(lines) {
            let refusal = json(settings, &document).refusal();
            assert_eq!(refusal, format!("tactile.json{expected}"));
        }
    }
}
