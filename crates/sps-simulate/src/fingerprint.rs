//! Names for the content of a frame.

use std::sync::LazyLock;

use sps_dataset::{FrameKey, RollAngle};

use super::material::Material;
use super::parameters::Specimen;
use super::render;

/// The hash of a tiny picture of every kind of every material: it changes with any change of the
/// simulator that could change a frame.
static PROBE: LazyLock<[u8; 32]> = LazyLock::new(|| {
    const SIZE: usize = 12;
    const MAP: usize = 64;
    let mut hasher = blake3::Hasher::new_derive_key("sps-dataset simulate probe 1");
    for material in Material::all() {
        for (index, profile) in material.kinds().iter().enumerate() {
            let specimen = Specimen {
                profile,
                ..Specimen::of_material(0, index, material)
            };
            let texels = render::prepare_on(&specimen, SIZE, MAP);
            let image = render::photograph(&specimen, &texels, 20.0, SIZE);
            hasher.update(&render::encode(&image));
        }
    }
    *hasher.finalize().as_bytes()
});

/// Equal keys mean equal pixels.
pub(crate) fn frame_key(specimen: &Specimen, angle: RollAngle, size: usize) -> FrameKey {
    let mut hasher = blake3::Hasher::new_derive_key("sps-dataset simulate frame 1");
    hasher.update(&*PROBE);
    hasher.update(&specimen.seed.to_le_bytes());
    hasher.update(&specimen.index.to_le_bytes());
    hasher.update(&angle.0.to_bits().to_le_bytes());
    hasher.update(&(size as u64).to_le_bytes());
    *hasher.finalize().as_bytes()
}
