//! The program, as people and other programs run it: one test program, so that it is linked once.

mod devtools;
mod support;
mod tables;

mod cluster;
mod compare;
mod errors;
mod experiment;
mod faults;
mod help;
mod importing;
mod multi_view;
mod own_photographs;
#[cfg(unix)]
mod pipes;
mod predict;
mod predictions;
mod readme;
mod reports;
mod shards;
mod simulate;
mod speed_error;
mod splits;
mod suggest;
mod training;
