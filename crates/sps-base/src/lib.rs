#![doc = include_str!("../README.md")]

pub mod files;
pub mod memory;
#[cfg(feature = "names")]
pub mod names;
#[cfg(feature = "parallel")]
pub mod parallel;
#[cfg(feature = "streams")]
pub mod streams;
mod unexpected;

pub use unexpected::Unexpected;
