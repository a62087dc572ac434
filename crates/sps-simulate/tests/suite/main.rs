//! What the simulator promises: one program, so that it is linked once.

mod ceilings;
mod reflectance;
mod source;
