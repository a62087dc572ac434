//! The real dataset that this crate was made for, where it is at hand.

use std::path::Path;

use sps_dataset::{
    DatasetFolder, FrameIndex, ReadSettings, RollAngle, Source, TactileSettings, decode_frames,
};

#[test]
fn every_photograph_decodes_to_its_size_and_has_one_measured_property() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = folder.join("../../../shared/data/friction-photos");
    if !folder.is_dir() {
        println!("skipped: {} is not there", folder.display());
        return;
    }
    let dataset = DatasetFolder::open(&folder, &ReadSettings::default()).unwrap();
    assert_eq!(dataset.surfaces().len(), 323);
    assert_eq!(dataset.nearest_view(RollAngle::NADIR), Some(0));
    let all = (0..323).map(|surface| FrameIndex { surface, view: 0 });
    let frames = decode_frames(&dataset, &all.collect::<Vec<_>>()).unwrap();
    for frame in frames {
        assert_eq!((frame.width, frame.height), (128, 128));
        assert!(frame.data.iter().all(|value| (0.0..=1.0).contains(value)));
    }

    let averages = dataset.tactile().averages(&TactileSettings::default(), 323);
    assert_eq!(averages.properties(), ["fRS"]);
    // The first rows of its table.
    assert_eq!(averages.value(0, "fRS"), Some(16.0273));
    assert_eq!(averages.value(1, "fRS"), Some(16.4166));
    assert!(averages.column("fRS").iter().all(Option::is_some));
    assert_eq!(averages.value(0, "cDF"), None);
}
