//! Your own photographs and touches as a `Source`: written as a dataset, read again and inspected.
//!
//! `cargo run --release -p sps-dataset --example own_source -- NEW_FOLDER`, or without a folder in a
//! temporary one.

use sps_dataset::{
    DatasetFolder, Frame, FrameFormat, FrameKey, InvalidCode, ReadSettings, Reading, RollAngle,
    Source, SourceError, Surface, TactileSettings, TactileTable, WriteOptions, write_dataset,
};

const SIZE: usize = 64;

/// Stripes: the narrower, the smoother.
struct Stripes {
    surfaces: Vec<Surface>,
    angles: Vec<RollAngle>,
    tactile: TactileTable,
}

impl Stripes {
    fn new() -> Result<Self, InvalidCode> {
        let named = |id: &str| Surface {
            id: id.to_owned(),
            material: "paper".to_owned(),
            group: id.to_owned(),
        };
        let touched = |surface: usize| Reading {
            surface,
            location: 0,
            repeat: 0,
            values: vec![Some(60.0 - 10.0 * surface as f64)],
        };
        Ok(Self {
            surfaces: ["wide", "middle", "narrow"].map(named).to_vec(),
            angles: [-30.0, 0.0, 30.0].map(RollAngle).to_vec(),
            tactile: TactileTable {
                properties: vec!["fRS".parse()?],
                readings: (0..3).map(touched).collect(),
            },
        })
    }
}

impl Source for Stripes {
    fn name(&self) -> &'static str {
        "stripes"
    }

    fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }

    fn view_angles(&self) -> &[RollAngle] {
        &self.angles
    }

    fn tactile(&self) -> &TactileTable {
        &self.tactile
    }

    fn frame(&self, surface: usize, view: usize) -> Result<Frame, SourceError> {
        // Seen at an angle, stripes are narrower.
        let width = 12.0 / (surface + 1) as f32 * (self.angles[view].0 as f32).to_radians().cos();
        let pixel = |at: usize| 0.5 + 0.4 * ((at % SIZE) as f32 / width).sin();
        Ok(Frame {
            width: SIZE,
            height: SIZE,
            data: (0..SIZE * SIZE).flat_map(|at| [pixel(at); 3]).collect(),
        })
    }

    fn frame_key(&self, surface: usize, view: usize) -> Result<FrameKey, SourceError> {
        let mut key = [0; 32];
        key[..2].copy_from_slice(&[surface as u8, view as u8]);
        Ok(key)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let temporary = tempfile::tempdir()?;
    let folder = std::env::args_os().nth(1);
    let folder = folder.map_or_else(|| temporary.path().join("stripes"), Into::into);
    let options = WriteOptions {
        format: FrameFormat::Png,
        description: "Three drawn surfaces".to_owned(),
        source: "computed".to_owned(),
    };
    let written = write_dataset(&Stripes::new()?, &folder, &options, |_, _| {})?;
    println!("{} surfaces in {}", written.written, folder.display());

    let dataset = DatasetFolder::open(&folder, &ReadSettings::default())?;
    let nadir = dataset.nearest_view(RollAngle::NADIR).ok_or("no view")?;
    for (at, surface) in dataset.surfaces().iter().enumerate() {
        let frame = dataset.frame(at, nadir)?;
        println!("{}: {} x {} pixels", surface.id, frame.width, frame.height);
    }
    for summary in dataset.inspect(&TactileSettings::default()).properties {
        println!("{}: {:?}", summary.property, summary.quantiles);
    }
    Ok(())
}
