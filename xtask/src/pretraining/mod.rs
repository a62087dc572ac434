//! What an encoder is pretrained on: a world of simulated surfaces and of patterns, and what a
//! teacher sees in it.

mod config;
mod teacher;
mod world;

pub(crate) use config::Pretraining;
pub(crate) use teacher::Teacher;
pub(crate) use world::World;

/// The hash of the sources that decide what a pretraining comes to: those of a trial, and these.
pub(crate) fn sources() -> String {
    let mut hasher = blake3::Hasher::new();
    for source in [
        sps_experiment::SOURCE_HASH,
        include_str!("../cmd/pretrain.rs"),
        include_str!("teacher.rs"),
        include_str!("world.rs"),
    ] {
        hasher.update(blake3::hash(source.as_bytes()).as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}
