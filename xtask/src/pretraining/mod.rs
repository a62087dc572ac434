//! What an encoder is pretrained on: a world of simulated surfaces and of patterns, and what a
//! teacher sees in it.

mod teacher;
mod world;

pub(crate) use teacher::Teacher;
pub(crate) use world::World;
