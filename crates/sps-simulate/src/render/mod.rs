//! From a surface's layers to a photograph of it.

mod camera;
mod maps;
mod occlusion;
mod resample;
mod shade;
#[cfg(test)]
mod tests;
mod view;

pub(crate) use camera::encode;
pub(crate) use maps::{Texels, prepare, prepare_on};

use super::parameters::Specimen;
use sps_dataset::LinearFrame;
use view::Pose;

/// One photograph of a built surface.
pub(crate) fn photograph(
    specimen: &Specimen,
    texels: &Texels,
    degrees: f64,
    size: usize,
) -> LinearFrame {
    let pose = Pose::draw(specimen, degrees);
    camera::expose(shade::render(texels, &pose, size), specimen, degrees)
}
