//! What the parts of this crate promise: one program, so that it is linked once.

mod files;
mod memory;
#[cfg(feature = "names")]
mod names;
#[cfg(feature = "parallel")]
mod parallel;
#[cfg(feature = "streams")]
mod streams;
