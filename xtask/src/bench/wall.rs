//! Wall times: the benches of the crates, run one after the other, as criterion measures them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use sps_experiment::files::read_text;
use tracing::info;

use super::budgets::{Budgets, Ratio};
use super::measured::Wall;
use crate::files::matching;

struct Bench {
    /// The stage of the way of the data that it measures.
    stage: &'static str,
    /// As cargo calls it.
    name: &'static str,
    /// A regular expression for those of its benchmarks that are run here.
    filter: &'static str,
}

const fn bench(stage: &'static str, name: &'static str, filter: &'static str) -> Bench {
    Bench {
        stage,
        name,
        filter,
    }
}

static BENCHES: [Bench; 6] = [
    bench("decode", "decode", ""),
    bench("render", "simulate", RENDERED),
    bench("encoders", "encoders", ""),
    bench("heads", "heads", "short"),
    bench("selectors", "search", ""),
    bench("metrics", "metrics", ""),
];
const RENDERED: &str = "128 px, (ceramic|denim|towel)|PNG|touching";

/// Seconds that criterion takes over a benchmark, unless ten passes take longer.
const WARM_UP: &str = "0.3";
const MEASURING: &str = "1";
/// Three passes of what takes longer than a second.
const QUICK: [&str; 3] = ["--quick", "--measurement-time", MEASURING];
const THOROUGH: [&str; 4] = ["--warm-up-time", WARM_UP, "--measurement-time", MEASURING];

/// Runs every bench; by stage and benchmark.
pub(crate) fn all() -> Result<BTreeMap<String, Wall>> {
    let mut all = BTreeMap::new();
    for bench in &BENCHES {
        all.extend(measure(bench, bench.filter, &THOROUGH)?);
    }
    Ok(all)
}

/// Measures, quickly, what the ratios are made of; likewise.
pub(crate) fn of_ratios(ratios: &[&Ratio]) -> Result<BTreeMap<String, Wall>> {
    let mut all = BTreeMap::new();
    for bench in &BENCHES {
        if let Some(filter) = needed(bench, ratios) {
            all.extend(measure(bench, &filter, &QUICK)?);
        }
    }
    Ok(all)
}

fn measure(bench: &Bench, filter: &str, how: &[&str]) -> Result<BTreeMap<String, Wall>> {
    info!("measuring: {}", bench.stage);
    let folder = tempfile::tempdir().context("cannot create a temporary folder")?;
    run(bench, filter, how, folder.path())?;
    let found = collect(folder.path())?;
    let Bench { stage, name, .. } = bench;
    ensure!(
        !found.is_empty(),
        "the bench `{name}` measured nothing that fits `{filter}`"
    );
    let named = |(id, wall)| (format!("{stage}: {id}"), wall);
    Ok(found.into_iter().map(named).collect())
}

/// A regular expression for the benchmarks of the bench that ratios are made of.
fn needed(bench: &Bench, ratios: &[&Ratio]) -> Option<String> {
    let prefix = format!("{}: ", bench.stage);
    let names = ratios.iter().flat_map(|ratio| [&ratio.of, &ratio.over]);
    let ids = names.filter_map(|name| name.strip_prefix(&prefix));
    let ids: BTreeSet<String> = ids.map(escaped).collect();
    let ids: Vec<String> = ids.into_iter().collect();
    (!ids.is_empty()).then(|| format!("^({})$", ids.join("|")))
}

/// A regular expression for the text itself.
fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    for c in text.chars() {
        if !(c.is_alphanumeric() || matches!(c, ' ' | ',' | '/' | '_')) {
            escaped.push('\\');
        }
        escaped.push(c);
    }
    escaped
}

fn run(bench: &Bench, filter: &str, how: &[&str], folder: &Path) -> Result<()> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command
        .args(["bench", "--locked", "--workspace", "--bench"])
        .args([bench.name, "--", "--noplot"])
        .args(how)
        .env("CRITERION_HOME", folder)
        .stderr(Stdio::inherit());
    if !filter.is_empty() {
        command.arg(filter);
    }
    let output = command.output().context("cannot run `cargo bench`")?;
    ensure!(output.status.success(), "the bench `{}` failed", bench.name);
    Ok(())
}

/// `benchmark.json` of criterion.
#[derive(Deserialize)]
struct Benchmark {
    full_id: String,
    throughput: Option<Throughput>,
}

#[derive(Deserialize)]
struct Throughput {
    #[serde(rename = "Elements")]
    elements: Option<f64>,
}

/// `estimates.json`, in nanoseconds.
#[derive(Deserialize)]
struct Estimates {
    median: Estimate,
}

#[derive(Deserialize)]
struct Estimate {
    point_estimate: f64,
    confidence_interval: Interval,
}

#[derive(Deserialize)]
struct Interval {
    lower_bound: f64,
    upper_bound: f64,
}

/// `sample.json`, in nanoseconds.
#[derive(Deserialize)]
struct Sample {
    iters: Vec<f64>,
    times: Vec<f64>,
}

/// What criterion left in `folder`, by the benchmarks' ids.
fn collect(folder: &Path) -> Result<BTreeMap<String, Wall>> {
    let paths = matching(folder, "**/new/benchmark.json")?;
    paths.iter().map(|path| read(path)).collect()
}

/// A benchmark's id and its times, from its `benchmark.json` and the files beside that.
fn read(path: &Path) -> Result<(String, Wall)> {
    const NANO: f64 = 1e-9;
    let benchmark: Benchmark = json(path)?;
    let Estimates { median } = json(&path.with_file_name("estimates.json"))?;
    let sample: Sample = json(&path.with_file_name("sample.json"))?;
    let passes = sample.times.iter().zip(&sample.iters);
    let each = passes.map(|(time, passes)| NANO * time / passes);
    let elements = benchmark.throughput.and_then(|found| found.elements);
    let interval = median.confidence_interval;
    let wall = Wall {
        median: NANO * median.point_estimate,
        interval: [interval.lower_bound, interval.upper_bound].map(|bound| NANO * bound),
        shortest: each.fold(f64::INFINITY, f64::min),
        elements: elements.unwrap_or(1.0),
    };
    Ok((benchmark.full_id, wall))
}

fn json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let read = serde_json::from_str(&read_text(path)?);
    read.with_context(|| format!("{} is not what criterion writes", path.display()))
}

/// The ratios that have a budget: of the shortest times, since other work on the machine only ever adds to a time.
pub(crate) fn ratios(
    budgets: &Budgets,
    wall: &BTreeMap<String, Wall>,
) -> Result<BTreeMap<String, f64>> {
    let each = |name: &str| {
        let wall = wall.get(name);
        let wall = wall.with_context(|| format!("no benchmark is called `{name}`"))?;
        anyhow::Ok(wall.shortest / wall.elements)
    };
    let ratio = |ratio: &Ratio| Ok((ratio.name.clone(), each(&ratio.of)? / each(&ratio.over)?));
    budgets.ratios.iter().map(ratio).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn ratio(of: &str, over: &str) -> Ratio {
        Ratio {
            name: "r".to_owned(),
            of: of.to_owned(),
            over: over.to_owned(),
            more: 0.4,
        }
    }

    #[test]
    fn guards_run_what_ratios_need() {
        let ratios = [&ratio("metrics: a/b (1)", "decode: c")];
        let of = |bench| BENCHES.iter().find(|one| one.name == bench).unwrap();
        let filter = needed(of("metrics"), &ratios);
        assert_eq!(filter.as_deref(), Some(r"^(a/b \(1\))$"));
        assert_eq!(needed(of("encoders"), &ratios), None);
    }

    #[test]
    fn reads_what_criterion_writes() {
        let folder = tempfile::tempdir().unwrap();
        let new = folder.path().join("group/name/new");
        fs::create_dir_all(&new).unwrap();
        let write = |name, text| fs::write(new.join(name), text).unwrap();
        let benchmark = r#"{"group_id":"g","full_id":"g/n","throughput":{"Elements":8}}"#;
        write("benchmark.json", benchmark);
        let estimates = r#"{"median":{"confidence_interval":{"confidence_level":0.95,"lower_bound":2e9,
            "upper_bound":4e9},"point_estimate":3e9,"standard_error":1.0}}"#;
        write("estimates.json", estimates);
        let sample = r#"{"sampling_mode":"Flat","iters":[1,2],"times":[3e9,5e9]}"#;
        write("sample.json", sample);
        let found = collect(folder.path()).unwrap();
        let wall = found["g/n"];
        assert!((wall.median - 3.0).abs() < 1e-12 && (wall.shortest - 2.5).abs() < 1e-12);
        assert!((wall.interval[1] - 4.0).abs() < 1e-12);
        assert_eq!(wall.elements, 8.0);

        write("estimates.json", r#"{"median":{"point_estimate":3e9}}"#);
        let refused = format!("{:#}", collect(folder.path()).unwrap_err());
        for part in ["estimates.json", "`confidence_interval`"] {
            assert!(refused.contains(part), "{refused}");
        }
    }
}
