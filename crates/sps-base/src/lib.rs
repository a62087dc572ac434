#![doc = include_str!("../README.md")]

pub mod files;
#[cfg(feature = "names")]
pub mod names;
#[cfg(feature = "streams")]
pub mod streams;
