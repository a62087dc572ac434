//! Instructions of the kernels, as callgrind counts them: they do not depend on what else the machine does.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use rayon::prelude::*;
use sps_experiment::files::read_text;
use tracing::{info, warn};

use super::kernels::KERNELS;
use super::machine::Machine;

/// Counts every kernel, each in a process of its own; nothing where there is no valgrind.
pub(crate) fn count(machine: &Machine) -> Result<BTreeMap<String, u64>> {
    if machine.valgrind.is_none() {
        warn!("valgrind is not installed: instructions are not counted");
        return Ok(BTreeMap::new());
    }
    info!("counting instructions of {} kernels", KERNELS.len());
    let folder = tempfile::tempdir().context("cannot create a temporary folder")?;
    KERNELS
        .par_iter()
        .map(|(kernel, _)| {
            let count = of(kernel, &folder.path().join(kernel))
                .with_context(|| format!("cannot count the kernel `{kernel}`"))?;
            Ok(((*kernel).to_owned(), count))
        })
        .collect()
}

fn of(kernel: &str, out: &Path) -> Result<u64> {
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--collect-atstart=no"])
        .arg("--toggle-collect=*kernels*counted*")
        .arg(format!("--callgrind-out-file={}", out.display()))
        .arg(std::env::current_exe()?)
        .args(["bench", "--kernel", kernel])
        .env("RAYON_NUM_THREADS", "1")
        .output()
        .context("cannot run valgrind")?;
    let log = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{log}");
    total(&read_text(out)?).context("callgrind gave no total")
}

fn total(profile: &str) -> Option<u64> {
    let total = |line: &str| line.strip_prefix("totals:")?.trim().parse().ok();
    profile.lines().find_map(total).filter(|total| *total > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_the_total() {
        let profile = "version: 1\nevents: Ir\nfl=(1) a.rs\n1 23\n\ntotals: 1234\n";
        assert_eq!(total(profile), Some(1234));
        assert_eq!(total("totals: 0\n"), None);
        assert_eq!(total(""), None);
    }
}
