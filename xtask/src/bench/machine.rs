//! What a measurement was made with.

use std::process::Command;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use sps_experiment::machine::{processor, processor_info};

/// What numbers depend on beside the code.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Machine {
    pub processor: String,
    pub cores: usize,
    /// The widest vectors that the kernels use.
    pub vectors: String,
    /// As `rustc -V` prints it.
    pub rustc: String,
    /// As `valgrind --version` prints it; none where it is not installed.
    pub valgrind: Option<String>,
}

impl Machine {
    pub(crate) fn here() -> Result<Self> {
        Ok(Self {
            processor: processor_model(),
            cores: std::thread::available_parallelism()?.get(),
            vectors: vectors().to_owned(),
            rustc: version("rustc", "-V").context("cannot run `rustc -V`")?,
            valgrind: version("valgrind", "--version"),
        })
    }

    /// Why instruction counts of `self` and `other` are not compared, if so.
    pub(crate) fn other_instructions(&self, other: &Self) -> Option<String> {
        let of = |machine: &Self| {
            let valgrind = machine.valgrind.as_deref().unwrap_or("no valgrind");
            format!("{} under {valgrind}", machine.rustc)
        };
        let (one, two) = (of(self), of(other));
        (one != two).then(|| format!("the baseline is of {one}, here is {two}"))
    }

    /// Why ratios of wall times of `self` and `other` are not compared, if so.
    pub(crate) fn other_ratios(&self, other: &Self) -> Option<String> {
        let of = |machine: &Self| {
            let (processor, vectors) = (&machine.processor, &machine.vectors);
            format!("{} cores of {processor} with {vectors}", machine.cores)
        };
        let (one, two) = (of(self), of(other));
        (one != two).then(|| format!("the baseline is of {one}, here are {two}"))
    }
}

/// The processor's name, family and model: virtual machines give several generations one name, and one may be twice as
/// fast as another.
fn processor_model() -> String {
    let numbers = ["cpu family", "model"].into_iter();
    let numbers = numbers.filter_map(|key| Some(format!(", {key} {}", processor_info(key)?)));
    processor() + &numbers.collect::<String>()
}

/// The first line that `program` prints; none where it cannot be run.
fn version(program: &str, argument: &str) -> Option<String> {
    let output = Command::new(program).arg(argument).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    let line = text.lines().next()?;
    output.status.success().then(|| line.trim().to_owned())
}

#[cfg(target_arch = "x86_64")]
fn vectors() -> &'static str {
    if is_x86_feature_detected!("avx512bf16") {
        "AVX512-BF16"
    } else if is_x86_feature_detected!("avx512f") {
        "AVX-512"
    } else if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        "AVX2"
    } else {
        "SSE2"
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn vectors() -> &'static str {
    std::env::consts::ARCH
}
