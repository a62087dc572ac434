//! What files come to, and how they are refused: one program, so that it is linked once.

mod common;
mod made;

#[cfg(feature = "exr")]
mod exr;
mod folder;
mod friction_photos;
mod images;
#[cfg(feature = "npz")]
mod npz;
mod properties;
mod resized;
mod splits;
mod tables;
mod tactile;
mod twins;
#[cfg(feature = "exr")]
mod write;
