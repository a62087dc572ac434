//! A dataset in a folder: what is read of it, and what is refused with which words.

use std::path::Path;

use crate::common::tiny_path;
use crate::made::{MANIFEST, Made, SURFACES, cases};
use sps_dataset::{
    DatasetErrorKind, DatasetFolder, DecodeSettings, FrameError, FrameErrorKind, FrameIndex,
    JsonLayout, NonFinite, ReadSettings, RollAngle, Source, TactileSettings, decode_frames,
    parse_toml, toccare,
};

fn tiny() -> DatasetFolder {
    DatasetFolder::open(&tiny_path(), &ReadSettings::default()).unwrap()
}

const TABLE: &str = "surface,location,repeat,fRS,cDF\na,0,0,1,2\n";

#[test]
fn the_tiny_dataset_is_what_its_readme_says() {
    let dataset = tiny();
    assert_eq!((dataset.name(), dataset.surfaces().len()), ("tiny", 6));
    let angles: Vec<_> = dataset.view_angles().iter().map(|angle| angle.0).collect();
    assert_eq!(angles, [-45.0, -22.5, 0.0, 22.5, 45.0]);
    assert_eq!(dataset.nearest_view(RollAngle::NADIR), Some(2));
    assert_eq!(dataset.nearest_view(RollAngle(-40.0)), Some(0));
    let surface = &dataset.surfaces()[1];
    let named = [&surface.id, &surface.material, &surface.group];
    assert_eq!(named, ["denim-02", "denim", "denim-bolt"]);
    let inspection = dataset.inspect(&TactileSettings::default());
    assert_eq!((inspection.readings, inspection.groups), (60, 5));
    let two = ["denim", "wood"].map(|name| (name.to_owned(), 2));
    assert_eq!(inspection.materials[..2], two);
    let summary = |property| {
        let mut summaries = inspection.properties.iter();
        summaries.find(|s| s.property == property).unwrap()
    };
    assert_eq!(summary("tCO").missing_cells, 1);
    let tack = summary("aTK");
    assert_eq!((tack.missing_cells, tack.measured), (10, 5));
    assert_eq!(summary("cDF").out_of_range.above, 1);
    assert_eq!(summary("mCO").out_of_range.below, 1);
    assert!(inspection.untouched.is_empty());
}

#[test]
fn inspection_says_how_much_lies_between_groups() {
    let table = "surface,location,repeat,fRS,cDF\n\
                 a,0,0,0,1\nb,0,0,2,\nc,0,0,10,2\nd,0,0,12,\ne,0,0,,3\n";
    let made = Made::long(table);
    let surfaces = "surface,material,group\na,wood,x\nb,wood,x\nc,wood,y\nd,wood,y\ne,wood,z\n";
    made.write("surfaces.csv", surfaces);
    let inspection = made.open().unwrap().inspect(&TactileSettings::default());
    let properties = inspection.properties;
    // Means 1 and 11 of pairs: mean squares 100 and 2, n0 = 2. Of cDF no group has two values.
    let found = properties[0].between_groups.unwrap();
    assert!((found - 98.0 / 102.0).abs() < 1e-12, "{found}");
    assert_eq!(properties[1].between_groups, None);
}

#[test]
fn the_four_forms_of_its_table_agree() {
    let read = |table: &str| {
        let settings: ReadSettings = parse_toml("test".as_ref(), table).unwrap();
        let dataset = DatasetFolder::open(&tiny_path(), &settings).unwrap();
        dataset.tactile().averages(&TactileSettings::default(), 6)
    };
    let order = toccare::ALL.map(|known| known.code);
    let forms = [
        "[table.wide-csv]\nfile = \"wide.csv\"".to_owned(),
        format!("[table.json]\nproperty-order = {order:?}"),
        #[cfg(feature = "npz")]
        format!("[table.npz]\nproperty-order = {order:?}\nstatistics.restore = true"),
    ];
    let long = read("[table.long-csv]");
    for form in forms {
        let other = read(&form);
        for property in toccare::properties() {
            for surface in 0..6 {
                // NumPy's averages, and values standardised and restored in double precision.
                let [one, two] = [&long, &other].map(|table| table.value(surface, &property));
                match (one, two) {
                    (Some(a), Some(b)) => assert!((a - b).abs() < 1e-12, "{form}: {a} {b}"),
                    (a, b) => assert_eq!(a, b, "{form}: {property} of {surface}"),
                }
            }
        }
    }
}

#[cfg(feature = "exr")]
#[test]
fn frames_of_three_formats_come_in_the_order_asked_for() {
    let dataset = tiny();
    let all: Vec<_> = (0..6)
        .flat_map(|surface| (0..5).rev().map(move |view| FrameIndex { surface, view }))
        .collect();
    let frames = decode_frames(&dataset, &all).unwrap();
    for (index, frame) in all.iter().zip(&frames) {
        let lengths = [frame.width, frame.height, frame.data.len()];
        assert_eq!(lengths, [32, 32, 3072]);
        assert_eq!(frame, &dataset.frame(index.surface, index.view).unwrap());
    }
    // The glazed tile, seen straight down, is brighter than white all over.
    let tile = dataset.decode(5, 2).unwrap();
    assert_eq!(tile.light.clipped, 32 * 32 * 3);
    let mut values = tile.frame.data.iter();
    assert!(values.all(|&value| (value - 1.0).abs() < 1e-6));
}

#[test]
fn the_first_frame_that_fails_is_the_one_reported() {
    let made = Made::long(TABLE);
    let dataset = made.open().unwrap();
    let frames = [2, 0, 1].map(|surface| FrameIndex { surface, view: 0 });
    let refused = decode_frames(&dataset, &frames).unwrap_err();
    let refused: &FrameError = refused.downcast_ref().unwrap();
    assert!(refused.path().ends_with("frames/c"), "{refused}");
}

#[test]
fn frame_keys_follow_the_content_and_what_changes_pixels() {
    let dataset = tiny();
    let key = |i: usize| dataset.frame_key(i / 5, i % 5).unwrap();
    let mut keys: Vec<_> = (0..30).map(key).collect();
    assert_eq!(keys[7], tiny().frame_key(1, 2).unwrap());
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys.len(), 30);

    let key_with = |change: fn(&mut DecodeSettings)| {
        let mut settings = ReadSettings::default();
        change(&mut settings.images);
        let dataset = DatasetFolder::open(&tiny_path(), &settings).unwrap();
        dataset.frame_key(0, 0).unwrap()
    };
    let same = tiny().frame_key(0, 0).unwrap();
    let changes: [fn(&mut DecodeSettings); 4] = [
        |images| images.exposure_stops = 1.0,
        |images| images.background = [0.0; 3],
        |images| images.exr_layer = Some(String::new()),
        |images| images.non_finite = NonFinite::Reject,
    ];
    for change in changes {
        assert_ne!(key_with(change), same);
    }
    // How much a file may ask for changes no pixel.
    assert_eq!(key_with(|images| images.limits.pixels = 1 << 20), same);
}

#[test]
fn frames_to_resize_are_read_at_their_size_with_the_same_pixels() {
    let dataset = tiny();
    for (surface, view) in [(0, 0), (3, 2), (5, 4)] {
        let whole = dataset.frame(surface, view).unwrap();
        let as_it_is = dataset.frame_to_resize(surface, view, None).unwrap();
        assert_eq!(as_it_is, whole);
        let small = dataset.frame_to_resize(surface, view, Some(20)).unwrap();
        assert_eq!(small.width.min(small.height), 20);
        assert_eq!(&small, &*whole.resized(20).unwrap());
    }
    let error = dataset.frame_to_resize(9, 0, Some(20)).unwrap_err();
    assert!(error.to_string().contains("surface 9"), "{error}");
}

#[test]
fn a_missing_folder_or_file_is_named() {
    let nowhere = DatasetFolder::open(Path::new("/nowhere/at all"), &ReadSettings::default());
    let expected = "/nowhere/at all: not a dataset: there is no such folder";
    assert_eq!(nowhere.unwrap_err().to_string(), expected);
    let made = Made::long(TABLE);
    std::fs::remove_file(made.path().join("tactile.csv")).unwrap();
    let refused = made.open().unwrap_err();
    assert!(refused.path().ends_with("tactile.csv"));
    let is_io = matches!(refused.kind(), DatasetErrorKind::Io(_));
    assert!(is_io, "{refused}");
    std::fs::remove_file(made.path().join("dataset.toml")).unwrap();
    let none = "not a dataset: it has no `dataset.toml`";
    assert!(made.refusal().ends_with(none));
    std::fs::create_dir(made.path().join("dataset.toml")).unwrap();
    assert!(made.refusal().starts_with("dataset.toml: cannot be read"));
}

#[test]
fn manifest_errors_name_the_line_and_the_nearest_key() {
    let keys = "`name`, `description`, `source`, `origin`, `properties`, `view-angles-deg`, `ranges`, \
        `tactile`, `property`";
    let edited = format!(
        r#"
        properties | propertes
            2: unknown key `propertes`, did you mean `properties`? Expected one of {keys}
        fRS | f RS
            2: is not valid TOML: `f RS` cannot be the code of a property, expected 1 to 64 of {letters}
        cDF | fRS
            2: is not valid TOML: property `fRS` is listed twice
        [0.0] | []
            3: is not valid TOML: a dataset has at least one view
        [0.0] | [0.0, nan]
            3: is not valid TOML: a view angle is a finite number of degrees
        [0.0] | "level"
            3: is not valid TOML: invalid type: string "level", expected a list of degrees or {range}
        [0.0] | {{ from = -45, to = 45, cuont = 3 }}
            3: unknown key `cuont`, did you mean `count`? Expected one of `from`, `to`, `count`
        [0.0] | {{ from = -45, to = 45, count = 1000000000000 }}
            3: is not valid TOML: a sequence has at most 1000000 views
        "#,
        letters = "a to z, A to Z, 0 to 9, `-` and `_`, for example `f-RS`",
        range = "{ from = DEGREES, to = DEGREES, count = VIEWS }",
    );
    let refusal = |manifest: String| {
        let made = Made::long(TABLE);
        made.write("dataset.toml", manifest);
        made.refusal()
    };
    for (edit, expected) in cases(&edited) {
        let (from, to) = edit.split_once(" | ").unwrap();
        let expected = format!("dataset.toml, line {expected}");
        assert_eq!(refusal(MANIFEST.replace(from, to)), expected);
    }
    let added = r#"
        [tactile.wide-cvs]
            4: unknown value `wide-cvs`, did you mean `wide-csv`? Expected one of `long-csv`, `wide-csv`, `npz`, `json`
        [tactile.json]\nlayout = "record"
            5: unknown value `record`, did you mean `records`? Expected one of `keyed`, `records`
    "#;
    for (lines, expected) in cases(added) {
        let expected = format!("dataset.toml, line {expected}");
        assert_eq!(refusal(format!("{MANIFEST}{lines}\n")), expected);
    }
    let broken = refusal("name = ".to_owned());
    assert!(broken.starts_with("dataset.toml, line 1: is not valid TOML: "));
    assert_eq!(JsonLayout::default(), JsonLayout::Keyed);
}

#[test]
fn the_table_may_not_be_outside_the_folder() {
    let outside = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(outside.path(), TABLE).unwrap();
    let absolute = outside.path().to_str().unwrap();
    let up = "../".repeat(20) + absolute;
    let others = ["../tactile.csv", "a/../../tactile.csv", "C:tactile.csv", ""];
    for file in [absolute, &up].into_iter().chain(others) {
        let tactile = format!("[tactile.long-csv]\nfile = '{file}'\n");
        let made = Made::new(&tactile, "tactile.csv", TABLE);
        let refused = made.open().unwrap_err();
        let found = format!("found `{file}`, expected a path below the dataset's folder");
        assert!(matches!(refused.kind(), DatasetErrorKind::Invalid(_)));
        let message = refused.to_string();
        let expected = format!("tactile table: {found}");
        assert!(message.contains(&expected), "{message}");
    }
    let inside = "[tactile.long-csv]\nfile = \"tables/a.csv\"\n";
    let made = Made::new(inside, "tactile.csv", TABLE);
    std::fs::create_dir(made.path().join("tables")).unwrap();
    made.write("tables/a.csv", TABLE);
    made.open().unwrap();
}

#[test]
fn surface_errors_name_the_line() {
    let refusal = |surfaces: &str| {
        let made = Made::long(TABLE);
        made.write("surfaces.csv", surfaces);
        made.refusal()
    };
    let rows = r"
        a,silk,x
            surface `a` is listed twice, first at line 2
        ../up,silk,x
            a surface's id: found `../up`, expected a name that does not begin with a dot
        up/../../there,silk,x
            a surface's id: found `up/../../there`, expected a name without slashes, colons and control characters
        ,silk,x
            a surface's id: found ``, expected a name
        d,silk
            the cells of the line: found 2, expected 3
    ";
    for (row, expected) in cases(rows) {
        let expected = format!("surfaces.csv, line 5: {expected}");
        assert_eq!(refusal(&format!("{SURFACES}{row}\n")), expected);
    }
    let headers = "
        surface,group,material
            , line 1: the header: found surface,group,material, expected surface,material,group
        surface,material,group
            : its rows: found none, expected at least one surface
    ";
    for (header, expected) in cases(headers) {
        assert_eq!(refusal(&header), format!("surfaces.csv{expected}"));
    }
    let nothing = "line 1: the header: found nothing, expected surface,material,group";
    assert_eq!(refusal(""), format!("surfaces.csv, {nothing}"));
}

#[test]
fn frame_errors_name_the_file() {
    let made = Made::long(TABLE);
    let frames = made.path().join("frames/a");
    std::fs::create_dir_all(&frames).unwrap();
    let dataset = made.open().unwrap();
    let refusal = |surface, view| dataset.frame(surface, view).unwrap_err().to_string();
    let none = "frames/a: has no frame for view 0: looked for 000.png, 000.jpg, 000.jpeg, 000.exr";
    assert!(refusal(0, 0).ends_with(none));
    assert!(refusal(3, 0).ends_with(": there is no surface 3: the dataset has 3, counted from 0"));
    assert!(refusal(0, 1).ends_with(": there is no view 1: the dataset has 1, counted from 0"));

    let png = std::fs::read(tiny_path().join("frames/oak-02/000.png")).unwrap();
    std::fs::write(frames.join("000.png"), &png[..png.len() / 2]).unwrap();
    assert!(refusal(0, 0).contains("frames/a/000.png: is not a whole PNG image: "));
    std::fs::write(frames.join("000.jpeg"), &png).unwrap();
    let two = "frames/a: has two frames for view 0: `000.png` and `000.jpeg`";
    assert!(refusal(0, 0).ends_with(two));
    std::fs::remove_file(frames.join("000.png")).unwrap();
    // Told by its content, not by its name.
    assert_eq!(dataset.frame(0, 0).unwrap(), tiny().frame(3, 0).unwrap());

    let mut settings = ReadSettings::default();
    settings.images.limits.file_bytes = 100;
    let limited = DatasetFolder::open(made.path(), &settings).unwrap();
    let refused = limited.frame(0, 0).unwrap_err();
    let refused: &FrameError = refused.downcast_ref().unwrap();
    let FrameErrorKind::FileTooLarge { limit: 100, .. } = refused.kind() else {
        panic!("{refused}");
    };
}

#[cfg(feature = "exr")]
#[test]
fn inspection_finds_broken_and_unknown_frames() {
    let made = Made::long(TABLE);
    for (surface, frame) in [
        ("a", "oak-02/000.png"),
        ("b", "tile-01/002.exr"),
        ("x", "oak-01/001.jpg"),
    ] {
        let folder = made.path().join("frames").join(surface);
        std::fs::create_dir_all(&folder).unwrap();
        let from = tiny_path().join("frames").join(frame);
        let ending = from.extension().unwrap();
        std::fs::copy(&from, folder.join("000").with_extension(ending)).unwrap();
    }
    let dataset = made.open().unwrap();
    let seen = std::sync::atomic::AtomicUsize::new(0);
    let frames = dataset.inspect_frames(|| {
        seen.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    });
    assert_eq!((frames.expected, seen.into_inner()), (3, 3));
    assert_eq!(frames.sizes, [(32, 32, 2)]);
    assert_eq!(frames.light.clipped, 32 * 32 * 3);
    assert_eq!(frames.broken.len(), 1);
    let broken = &frames.broken[0];
    assert_eq!((&*broken.surface, broken.view), ("c", 0));
    assert_eq!(frames.unknown_folders, ["x"]);
    let inspection = dataset.inspect(&TactileSettings::default());
    assert_eq!(inspection.untouched, ["b", "c"]);
    assert_eq!(inspection.properties[0].quantiles, Some([1.0; 5]));
    assert_eq!(inspection.properties[0].repeat_std, None);
}
