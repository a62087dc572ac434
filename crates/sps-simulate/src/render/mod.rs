//! From a surface's layers to a photograph of it.

mod camera;
mod maps;
mod occlusion;
mod resample;
mod shade;
#[cfg(test)]
mod tests;
mod view;

pub(crate) use camera::{Linear, encode, expose};
pub(crate) use maps::{Texels, prepare, prepare_on};
pub(crate) use shade::render;
pub(crate) use view::Pose;
