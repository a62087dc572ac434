//! What an experiment runs on.

use std::fs;

/// The name of the processor, or else its architecture.
pub fn processor() -> String {
    processor_info("model name").unwrap_or_else(|| std::env::consts::ARCH.to_owned())
}

/// What Linux tells of the first processor under a key of `/proc/cpuinfo`, such as `cpu family`.
pub fn processor_info(key: &str) -> Option<String> {
    let text = fs::read_to_string("/proc/cpuinfo").ok()?;
    let mut told = text.lines().filter_map(|line| line.split_once(':'));
    let (_, value) = told.find(|(told, _)| told.trim() == key)?;
    Some(value.trim().to_owned())
}
