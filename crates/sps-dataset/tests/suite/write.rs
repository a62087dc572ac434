//! Writing a dataset: what reads back, what is resumed and what is refused. The source is the tiny
//! dataset, part of which is EXR.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::common::tiny_path;
use sps_dataset::{
    DatasetFolder, DecodeSettings, Description, Frame, FrameFormat, FrameKey, LinearFrame,
    Property, PropertyRange, ReadSettings, RollAngle, Source, SourceError, Surface, TactileTable,
    WriteError, WriteErrorKind, WriteOptions, Written, decode_image, write_dataset,
};
use tempfile::TempDir;

/// The tiny dataset, counting the frames asked of it and failing from one of them on.
struct Counted {
    inner: DatasetFolder,
    surfaces: Vec<Surface>,
    tactile: TactileTable,
    frames: AtomicUsize,
    fail_from: usize,
    ranges: BTreeMap<&'static str, [f64; 2]>,
}

#[derive(Debug, thiserror::Error)]
#[error("the lamp went out")]
struct LampOut;

impl Counted {
    fn new(fail_from: usize) -> Self {
        let inner = open(&tiny_path());
        Self {
            surfaces: inner.surfaces().to_vec(),
            tactile: inner.tactile().clone(),
            inner,
            frames: AtomicUsize::new(0),
            fail_from,
            ranges: BTreeMap::new(),
        }
    }
}

impl Source for Counted {
    fn name(&self) -> &str {
        self.inner.name()
    }

    fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }

    fn view_angles(&self) -> &[RollAngle] {
        self.inner.view_angles()
    }

    fn tactile(&self) -> &TactileTable {
        &self.tactile
    }

    fn describe(&self, property: &Property) -> Description {
        let range = self.ranges.get(property.code()).copied();
        Description {
            range: range.map(|ends| PropertyRange::try_from(ends).unwrap()),
            ..Description::known(property)
        }
    }

    fn frame(&self, surface: usize, view: usize) -> Result<Frame, SourceError> {
        if self.frames.fetch_add(1, Ordering::Relaxed) >= self.fail_from {
            return Err(SourceError::new(LampOut));
        }
        self.inner.frame(surface, view)
    }

    fn frame_key(&self, surface: usize, view: usize) -> Result<FrameKey, SourceError> {
        self.inner.frame_key(surface, view)
    }
}

fn options(format: FrameFormat) -> WriteOptions {
    WriteOptions {
        format,
        description: "A \"copy\",\nin two lines".to_owned(),
        source: "the fixture".to_owned(),
    }
}

/// Writes frames as PNG.
fn write_png(source: &dyn Source, folder: &Path) -> Result<Written, WriteError> {
    write_dataset(source, folder, &options(FrameFormat::Png), |_, _| {})
}

fn open(folder: &Path) -> DatasetFolder {
    DatasetFolder::open(folder, &ReadSettings::default()).unwrap()
}

fn check_copy(folder: &Path, bound: f32) {
    let (original, copy) = (Counted::new(usize::MAX), open(folder));
    assert_eq!(copy.name(), original.name());
    assert_eq!(copy.surfaces(), original.surfaces());
    assert_eq!(copy.view_angles(), original.view_angles());
    assert_eq!(copy.tactile(), original.tactile());
    assert_eq!(copy.manifest().description, "A \"copy\",\nin two lines");
    for index in 0..30 {
        let frame = |source: &DatasetFolder| source.frame(index / 5, index % 5).unwrap();
        let [a, b] = [&original.inner, &copy].map(frame);
        assert_eq!(a.extent(), b.extent());
        let worst = furthest(&a, &b);
        assert!(worst <= bound, "frame {index} is {worst} off");
    }
}

fn frame(width: usize, height: usize, data: Vec<f32>) -> Frame {
    Frame {
        width,
        height,
        data,
    }
}

fn furthest(a: &Frame, b: &Frame) -> f32 {
    let distances = a.data.iter().zip(&b.data).map(|(a, b)| (a - b).abs());
    distances.fold(0.0, f32::max)
}

/// What is in a folder.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().path()).collect()
}

#[test]
fn png_reads_back_within_half_a_level() {
    let folder = TempDir::new().unwrap();
    let written = write_png(&Counted::new(usize::MAX), folder.path()).unwrap();
    assert_eq!((written.written, written.already_there), (6, 0));
    check_copy(folder.path(), 0.5 / 255.0 + 1e-6);
}

#[test]
fn exr_reads_back_within_the_documented_bound() {
    let folder = TempDir::new().unwrap();
    let (source, options) = (Counted::new(usize::MAX), options(FrameFormat::Exr));
    write_dataset(&source, folder.path(), &options, |_, _| {}).unwrap();
    check_copy(folder.path(), 3e-4);
    // Every display value there can be, not only those of a picture.
    let ramp = (0..30_000).map(|i| i as f32 / 29_999.0);
    let ramp = frame(100, 100, ramp.collect());
    let bytes = FrameFormat::Exr.encode(&ramp).unwrap();
    let back = decode_image(&bytes, &DecodeSettings::default()).unwrap();
    let worst = furthest(&ramp, &back.frame);
    assert!(worst <= 3e-4, "{worst}");
}

#[test]
fn light_is_kept_by_exr_and_shown_by_png() {
    let light = LinearFrame {
        width: 2,
        height: 1,
        data: vec![0.0, 0.18, 3.5, -0.5, 1.0, 0.5],
    };
    // IEC 61966-2-1: linear 0.18 encodes to 0.46136, and 0.5 to 0.73536.
    let png = FrameFormat::Png.encode_linear(&light).unwrap();
    let shown = decode_image(&png, &DecodeSettings::default()).unwrap();
    let bytes: Vec<f32> = shown.frame.data.iter().map(|v| v * 255.0).collect();
    assert_eq!(bytes, [0.0, 118.0, 255.0, 0.0, 255.0, 188.0]);
    let exr = FrameFormat::Exr.encode_linear(&light).unwrap();
    let shown = decode_image(&exr, &DecodeSettings::default()).unwrap();
    let counts = shown.light;
    assert_eq!((counts.clipped, counts.negative), (1, 1));
    let darker = DecodeSettings {
        exposure_stops: -3.0,
        ..DecodeSettings::default()
    };
    // 3.5 / 8 is 0.4375, which encodes to 0.69258.
    let shown = decode_image(&exr, &darker).unwrap().frame.data[2];
    assert!((shown - 0.69258).abs() < 1e-4, "{shown}");
    let empty = LinearFrame {
        width: 1,
        height: 1,
        data: Vec::new(),
    };
    assert!(FrameFormat::Exr.encode_linear(&empty).is_err());
    assert!(FrameFormat::Png.encode_linear(&empty).is_err());
}

#[test]
fn stopped_and_started_again_it_goes_on_from_finished_surfaces() {
    let folder = TempDir::new().unwrap();
    let stopped = write_png(&Counted::new(14), folder.path()).unwrap_err();
    let WriteErrorKind::Frame { error, .. } = stopped.kind() else {
        panic!("{stopped}");
    };
    assert!(error.is::<LampOut>());
    assert!(stopped.to_string().ends_with("the lamp went out"));
    assert!(!folder.path().join("dataset.toml").exists());
    let finished = entries(&folder.path().join("frames"));
    for surface in &finished {
        assert_eq!(entries(surface).len(), 5, "{}", surface.display());
    }

    let rest = Counted::new(usize::MAX);
    let calls = AtomicUsize::new(0);
    let count = |_, total| {
        assert_eq!(total, 6);
        calls.fetch_add(1, Ordering::Relaxed);
    };
    let written = write_dataset(&rest, folder.path(), &options(FrameFormat::Png), count).unwrap();
    let expected = Written {
        written: 6 - finished.len(),
        already_there: finished.len(),
    };
    assert_eq!((written, calls.into_inner()), (expected, 6));
    assert_eq!(rest.frames.into_inner(), 5 * (6 - finished.len()));
    check_copy(folder.path(), 0.5 / 255.0 + 1e-6);

    // Once more does nothing, and a frame that was lost is made again.
    std::fs::remove_file(folder.path().join("frames/oak-01/003.png")).unwrap();
    let again = Counted::new(usize::MAX);
    let written = write_png(&again, folder.path()).unwrap();
    assert_eq!((written.written, again.frames.into_inner()), (1, 5));
    check_copy(folder.path(), 0.5 / 255.0 + 1e-6);
}

#[test]
fn what_a_killed_run_left_half_written_is_removed_or_written_again() {
    let folder = TempDir::new().unwrap();
    let source = Counted::new(usize::MAX);
    write_png(&source, folder.path()).unwrap();
    let (left, file) = (
        folder.path().join("frames/.writing-1-0"),
        folder.path().join(".writing-1-0"),
    );
    std::fs::create_dir(&left).unwrap();
    std::fs::write(left.join("000.png"), b"half").unwrap();
    std::fs::write(&file, b"half").unwrap();
    let plan = folder.path().join(".write-plan");
    let whole = std::fs::read(&plan).unwrap();
    std::fs::write(&plan, &whole[..whole.len() / 2]).unwrap();
    write_png(&source, folder.path()).unwrap();
    assert!(!left.exists() && !file.exists());
    assert_eq!(std::fs::read(&plan).unwrap(), whole);
}

#[test]
fn two_datasets_or_processes_do_not_mix() {
    let folder = TempDir::new().unwrap();
    let source = Counted::new(usize::MAX);
    write_png(&source, folder.path()).unwrap();
    let other = WriteOptions {
        source: "another".to_owned(),
        ..options(FrameFormat::Png)
    };
    let refused = write_dataset(&source, folder.path(), &other, |_, _| {}).unwrap_err();
    assert!(matches!(refused.kind(), WriteErrorKind::Occupied(_)));

    let foreign = TempDir::new().unwrap();
    std::fs::write(foreign.path().join("dataset.toml"), "name = \"theirs\"").unwrap();
    let refused = write_png(&source, foreign.path()).unwrap_err();
    assert!(matches!(refused.kind(), WriteErrorKind::Occupied(_)));

    let lock = std::fs::File::open(folder.path().join(".write-plan")).unwrap();
    lock.lock().unwrap();
    let refused = write_png(&source, folder.path()).unwrap_err();
    assert!(matches!(refused.kind(), WriteErrorKind::InUse));
}

/// A child has the files of its parent until it becomes its own program.
#[cfg(unix)]
#[test]
fn a_child_that_another_thread_starts_does_not_keep_the_folder() {
    let folder = TempDir::new().unwrap();
    let source = Counted::new(usize::MAX);
    let (done, refused) = std::sync::mpsc::channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            while refused.try_recv() == Err(std::sync::mpsc::TryRecvError::Empty) {
                let _ = std::process::Command::new("true").status();
            }
        });
        let write = |_| write_png(&source, folder.path());
        let written: Result<Vec<_>, _> = (0..200).map(write).collect();
        drop(done);
        written.unwrap();
    });
}

#[test]
fn a_file_where_a_folder_belongs_is_an_error() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let refused = write_png(&Counted::new(0), file.path()).unwrap_err();
    assert!(matches!(refused.kind(), WriteErrorKind::Io(_)));
}

#[test]
fn a_frame_without_pixels_is_refused() {
    let encode = |frame| FrameFormat::Png.encode(&frame);
    let refused = encode(frame(0, 3, Vec::new())).unwrap_err();
    let expected =
        "the frame cannot be encoded: it has 0 values for 0 x 3 pixels, expected three for each";
    assert_eq!(refused.to_string(), expected);
    assert!(encode(frame(2, 2, vec![0.0; 11])).is_err());
}

/// A file system of 48 KiB, less than half of what the dataset needs; unmounted when dropped.
#[cfg(target_os = "linux")]
struct TinyDisk(TempDir);

#[cfg(target_os = "linux")]
impl TinyDisk {
    fn mount() -> Option<Self> {
        let folder = TempDir::new().unwrap();
        let mut mount = std::process::Command::new("mount");
        mount.args("-t tmpfs -o size=48k tmpfs".split(' '));
        mount.arg(folder.path()).stderr(std::process::Stdio::null());
        let mounted = mount.status();
        let is_there = mounted.is_ok_and(|status| status.success());
        is_there.then_some(Self(folder))
    }
}

#[cfg(target_os = "linux")]
impl Drop for TinyDisk {
    fn drop(&mut self) {
        let mut umount = std::process::Command::new("umount");
        let _ = umount.arg(self.0.path()).status();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_whole_surfaces_only() {
    let Some(disk) = TinyDisk::mount() else {
        println!("skipped: no right to mount a tmpfs here");
        return;
    };
    let source = Counted::new(usize::MAX);
    let refused = write_png(&source, disk.0.path()).unwrap_err();
    assert!(matches!(refused.kind(), WriteErrorKind::StorageFull(_)));
    assert!(!disk.0.path().join("dataset.toml").exists());
    for surface in entries(&disk.0.path().join("frames")) {
        let frames = entries(&surface);
        assert_eq!(frames.len(), 5, "{}", surface.display());
        for frame in frames {
            sps_dataset::read_image(&frame, &DecodeSettings::default()).unwrap();
        }
    }
}

#[test]
fn declared_ranges_are_kept() {
    let ranged = |ranges: &[(&'static str, [f64; 2])]| Counted {
        ranges: ranges.iter().copied().collect(),
        ..Counted::new(usize::MAX)
    };
    let source = ranged(&[("fRS", [0.0, 100.0]), ("cDF", [-0.1, f64::INFINITY])]);
    let folder = TempDir::new().unwrap();
    write_png(&source, folder.path()).unwrap();
    let written = open(folder.path());
    for property in &written.tactile().properties {
        assert_eq!(written.describe(property), source.describe(property));
    }

    // One of its surfaces deforms by more than 100.
    let folder = TempDir::new().unwrap();
    let refused = write_png(&ranged(&[("cDF", [0.0, 100.0])]), folder.path());
    let message = refused.unwrap_err().to_string();
    assert!(message.contains(": tactile.csv, line "), "{message}");
    assert!(message.contains(": cDF of `"), "{message}");
    assert!(message.contains(", outside 0 to 100, "), "{message}");
    assert!(entries(folder.path()).is_empty());
}

#[test]
fn what_could_not_be_read_again_is_not_written() {
    let folder = TempDir::new().unwrap();
    let mut source = Counted::new(usize::MAX);
    let first = source.tactile.readings[0].clone();
    source.tactile.readings.push(first);
    let refused = write_png(&source, folder.path()).unwrap_err();
    let message = refused.to_string();
    let expected = "of surface `denim-01` is listed twice, first at line 2";
    assert!(message.ends_with(expected), "{message}");
    let mut source = Counted::new(usize::MAX);
    source.tactile.readings[0].values[0] = Some(f64::NAN);
    let refused = write_png(&source, folder.path()).unwrap_err();
    let message = refused.to_string();
    assert!(
        message.ends_with("of `denim-01` at NaN, expected a number, or none"),
        "{message}"
    );
    let twice = "listed twice";
    for (id, expected) in [
        ("", "expected a name"),
        ("../denim-01", "that does not begin with a dot"),
        ("denim-01\n", "slashes, colons and control characters"),
        (" denim-01", "neither begins nor ends with white space"),
        ("oak-02", twice),
    ] {
        let mut source = Counted::new(usize::MAX);
        let surface = &mut source.surfaces[0];
        surface.id = id.to_owned();
        // Without text the whole line would be skipped.
        if id.is_empty() {
            surface.material.clear();
            surface.group.clear();
        }
        let refused = write_png(&source, folder.path()).unwrap_err();
        let is_unsuitable = matches!(refused.kind(), WriteErrorKind::Unsuitable(_));
        assert!(is_unsuitable, "{id:?}: {refused}");
        let message = refused.to_string();
        let says = message.ends_with(expected) || expected == twice && message.contains(twice);
        assert!(says, "{id:?}: {message}");
    }
    assert!(entries(folder.path()).is_empty());
}
