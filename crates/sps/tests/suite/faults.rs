//! Runs and caches under faults: killed runners and shards, two runners at once, flipped bits, full disks,
//! clocks that were set. What counts as a loss: a result that differs, a trial or an embedding that was on
//! disk and is computed again without a line in the log, a run that cannot be finished.
//!
//! `cargo test --workspace --release --test suite faults -- --ignored --nocapture` does it at length;
//! docs/benchmarks.md shows what came out.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus};
use std::time::{Duration, Instant, SystemTime};

use crate::support::{Mounted, Scratch, copy, end, has_lines, tree, wait};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use serde_json::Value;

/// One method that selects its views, and one whose encoder is trained, through heads of two views.
const METHODS: &str = "\
nvs | NVS | head | views = 2; selector = { kind = 'nvs', evaluations = 200 }
fine-tuned | Fine-tuned | ridge | encoder = { trainable = true, training = { epochs = 2, \
    batch-size = 4, objective = { kind = 'heads', input = { kind = 'late-fusion', views = 2 }, \
    model = { kind = 'cross-modal', adversarial = {} } } } }
";

const JOURNALS: [&str; 2] = ["run/trials.jsonl", "run/selections.jsonl"];

#[test]
fn a_few_faults_lose_nothing() {
    let mut faults = Faults::new();
    faults.kill(5);
    let ends = ["/trials.jsonl", "encoder.safetensors", "/results.json"];
    faults.flip(1, |name| {
        ends.iter().any(|end| name.ends_with(end)) || name.contains("/embeddings/")
    });
    faults.run_in_pairs(1);
    faults.kill_shards(1);
    faults.fill_disks(1);
    faults.set_clocks();
    faults.finish();
}

#[test]
#[ignore = "takes minutes"]
fn a_hundred_kills_and_all_other_faults_lose_nothing() {
    let mut faults = Faults::new();
    faults.kill(100);
    faults.flip(3, |_| true);
    faults.run_in_pairs(10);
    faults.kill_shards(10);
    faults.fill_disks(5);
    faults.set_clocks();
    faults.finish();
}

/// An experiment, what it comes to, and what is done to it.
struct Faults {
    scratch: Scratch,
    expected: Value,
    /// What an undisturbed run takes.
    takes: Duration,
    random: ChaCha8Rng,
    /// How often each fault was tried, and runs were begun.
    counts: BTreeMap<&'static str, usize>,
    losses: Vec<String>,
}

/// The status of a run, and its log.
type Ended = (ExitStatus, String);

/// By their names, with their content.
type Files = BTreeMap<String, Vec<u8>>;

impl Faults {
    fn new() -> Self {
        let mut faults = Self {
            scratch: Scratch::with_methods(METHODS),
            expected: Value::Null,
            takes: Duration::ZERO,
            random: ChaCha8Rng::seed_from_u64(0),
            counts: BTreeMap::new(),
            losses: Vec::new(),
        };
        let begun = Instant::now();
        let (status, log) = faults.run("run");
        assert!(status.success(), "{log}");
        faults.takes = begun.elapsed();
        faults.expected = faults.scratch.results();
        faults
    }

    fn path(&self, name: &str) -> PathBuf {
        self.scratch.path(name)
    }

    /// Counts one more.
    fn count(&mut self, what: &'static str) -> usize {
        let count = self.counts.entry(what).or_default();
        *count += 1;
        *count
    }

    /// A number below `end`.
    fn draw(&mut self, end: usize) -> usize {
        (self.random.next_u64() % end as u64) as usize
    }

    /// A moment within the time of an undisturbed run.
    fn moment(&mut self) -> Duration {
        self.takes * self.draw(1000) as u32 / 1000
    }

    /// Starts a run into a folder, which more arguments may follow.
    fn start(&mut self, run: &str) -> Child {
        self.count("runs");
        let line = format!("experiment @tiny.toml --out @{run}");
        self.scratch.start(&line)
    }

    /// Runs to the end.
    fn run(&mut self, run: &str) -> Ended {
        end(self.start(run))
    }

    fn lose(&mut self, what: String) {
        println!("LOSS: {what}");
        self.losses.push(what);
    }

    /// Notes a loss where a run failed or came to something else.
    fn check(&mut self, doing: &str, run: &str, (status, log): &Ended) {
        if !status.success() || log.contains("panicked") {
            self.lose(format!("{doing}: the run failed: {log}"));
        } else if self.scratch.results_in(run) != self.expected {
            self.lose(format!("{doing}: other results"));
        }
    }

    /// As [`Faults::check`]; and no trial was run although it was on disk.
    fn check_once(&mut self, doing: &str, run: &str, ended: &Ended) {
        self.check(doing, run, ended);
        self.check_keys(doing, run);
    }

    /// Notes a loss where a trial is in a journal more than once.
    fn check_keys(&mut self, doing: &str, run: &str) {
        let mut keys = self.scratch.keys(run);
        keys.sort_unstable();
        if let Some([key, ..]) = keys.windows(2).find(|two| two[0] == two[1]) {
            self.lose(format!("{doing}: the trial {key} was run twice"));
        }
    }

    /// A run from nothing to its end.
    fn run_anew(&mut self, doing: &str) {
        self.begin_again();
        let ended = self.run("run");
        self.check(doing, "run", &ended);
    }

    /// As if nothing had ever been run.
    fn begin_again(&self) {
        for folder in ["run", "cache"] {
            let path = self.path(folder);
            if path.exists() {
                fs::remove_dir_all(path).expect("a folder");
            }
        }
    }

    /// Kills runs, the first once trials are on disk and others at random moments, and has them go on, until so
    /// many were killed.
    fn kill(&mut self, kills: usize) {
        self.begin_again();
        let mut before = Files::new();
        let mut killed = 0;
        let journal = self.path(JOURNALS[0]);
        while killed < kills {
            let delay = self.moment();
            let mut run = self.start("run");
            if killed == 0 {
                wait(&mut run, || has_lines(&journal));
            } else {
                std::thread::sleep(delay);
            }
            // Not an error where the run has ended by itself.
            let _ = run.kill();
            let ended = end(run);
            before = self.check_kept(&format!("kill {killed}"), &before);
            let (status, _) = &ended;
            if status.code().is_some() {
                self.check_once("killed before", "run", &ended);
                self.begin_again();
                before.clear();
            } else {
                killed = self.count("kills");
            }
        }
        let ended = self.run("run");
        self.check_once("the last kill", "run", &ended);
    }

    /// Flips bits of each file that `chosen` says, one at a time, so many of each.
    fn flip(&mut self, bits: usize, chosen: impl Fn(&str) -> bool) {
        self.run_anew("before flipping");
        for folder in ["run", "cache"] {
            copy(&self.path(folder), &self.path(&format!("whole-{folder}")));
        }
        for (name, bytes) in self.files() {
            if chosen(&name) && !bytes.is_empty() {
                (0..bits).for_each(|_| self.flip_one(&name, bytes.clone()));
            }
        }
        self.restore();
    }

    fn restore(&self) {
        self.begin_again();
        for folder in ["run", "cache"] {
            copy(&self.path(&format!("whole-{folder}")), &self.path(folder));
        }
    }

    fn flip_one(&mut self, name: &str, mut bytes: Vec<u8>) {
        self.restore();
        let path = self.path(name);
        let (at, bit) = (self.draw(bytes.len()), self.draw(8));
        bytes[at] ^= 1 << bit;
        fs::write(&path, &bytes).expect("a stored file");
        let ended = self.run("run");
        self.count("bits flipped");
        let what = format!("bit {bit} of byte {at} of {name}");
        self.check(&what, "run", &ended);
        let (_, log) = ended;
        if !reported(name, &path, &log) {
            self.lose(format!("{what}: no line in the log: {log}"));
        }
    }

    /// Every file of run and cache.
    fn files(&self) -> Files {
        let mut files = Files::new();
        let folders = ["run", "cache"].into_iter();
        for folder in folders.filter(|folder| self.path(folder).is_dir()) {
            let all = tree(&self.path(folder)).into_iter();
            files.extend(all.map(|(name, bytes)| (format!("{folder}/{}", name.display()), bytes)));
        }
        files.retain(|name, _| self.path(name).is_file());
        files
    }

    /// What is worth keeping: journals, embeddings and trained encoders.
    fn kept(&self) -> Files {
        let mut kept = self.files();
        kept.retain(|name, _| {
            JOURNALS.contains(&name.as_str())
                || name.ends_with(".safetensors") && !name.ends_with("state.safetensors")
        });
        kept
    }

    /// Notes a loss where something is gone of what was kept `before`; what is kept now.
    fn check_kept(&mut self, doing: &str, before: &Files) -> Files {
        let after = self.kept();
        let is_lost = |(name, bytes): &(&String, &Vec<u8>)| match after.get(*name) {
            // A journal may have grown.
            Some(after) if JOURNALS.contains(&name.as_str()) => !after.starts_with(bytes),
            after => after != Some(*bytes),
        };
        if let Some((name, _)) = before.iter().find(is_lost) {
            self.lose(format!("{doing}: {name} is gone or changed"));
        }
        after
    }

    /// Two runners in one folder at once, and two that share a cache.
    fn run_in_pairs(&mut self, pairs: usize) {
        for _ in 0..pairs {
            for runs in [["run", "run"], ["run", "other-run"]] {
                self.begin_again();
                let _ = fs::remove_dir_all(self.path("other-run"));
                let both = runs.map(|run| self.start(run));
                let [first, second] = both.map(end);
                self.count("pairs of runners");
                self.check_once("the first of two", runs[0], &first);
                self.check_once("the second of two", runs[1], &second);
                let waited = [&first, &second].map(|(_, log)| log.contains("waiting"));
                if runs[0] == runs[1] && waited == [false; 2] {
                    self.lose("two runners: none waited for the other".to_owned());
                }
            }
        }
    }

    /// Two shards at once, one of which is killed at a random moment and run again, so many times.
    fn kill_shards(&mut self, kills: usize) {
        for _ in 0..kills {
            self.begin_again();
            let delay = self.moment();
            let whole = self.start("run --shard 1/2");
            let mut killed = self.start("run --shard 2/2");
            std::thread::sleep(delay);
            // Not an error where it has ended by itself.
            let _ = killed.kill();
            end(killed);
            self.count("shards killed");
            let again = self.run("run --shard 2/2");
            for (what, ended) in [("the other shard", end(whole)), ("the shard again", again)] {
                let (status, log) = ended;
                if !status.success() {
                    self.lose(format!("{what}: {log}"));
                }
            }
            let merged = self.run("run --merge");
            self.check_once("a killed shard", "run", &merged);
            for shard in ["1-of-2", "2-of-2"] {
                self.check_keys(shard, &format!("run/shards/{shard}"));
            }
        }
    }

    /// Runs on disks that become full, and goes on when there is room.
    fn fill_disks(&mut self, disks: usize) {
        for _ in 0..disks {
            // A run takes some 90 KiB, a cache 50 MiB.
            for (folder, most) in [("run", 80), ("cache", 8000)] {
                self.begin_again();
                let size = 4 + self.draw(most);
                let path = self.path(folder);
                let Some(disk) = Mounted::new(&path, &format!("size={size}k")) else {
                    return;
                };
                let (status, log) = self.run("run");
                let full = log.contains("No space left") && status.code() == Some(1);
                if !full && !status.success() {
                    self.lose(format!("{size} KiB for {folder}: {log}"));
                }
                let before = self.kept();
                disk.remount("size=400m");
                let ended = self.run("run");
                if full {
                    self.count("full disks");
                }
                self.check_once("after a full disk", "run", &ended);
                self.check_kept(&format!("{size} KiB for {folder}"), &before);
            }
        }
    }

    /// As if the clock had been set, back or forward, after everything was stored.
    fn set_clocks(&mut self) {
        self.run_anew("before setting the clock");
        let before = self.kept();
        let year = Duration::from_secs(365 * 24 * 3600);
        for time in [SystemTime::now() + year, SystemTime::UNIX_EPOCH] {
            for name in self.files().keys() {
                let file = File::options().append(true).open(self.path(name));
                let file = file.expect("a stored file");
                file.set_modified(time).expect("a time");
            }
            let ended = self.run("run");
            self.count("clocks set");
            self.check_once("after the clock was set", "run", &ended);
            let (_, log) = ended;
            let nothing = log.matches(" 0 of them encoded now").count();
            let encoded = log.matches("of them encoded now").count();
            if nothing != encoded || self.kept() != before {
                self.lose(format!("the clock was set: work done again: {log}"));
            }
        }
    }

    fn finish(self) {
        println!("{:?}, losses: {}", self.counts, self.losses.len());
        assert!(self.losses.is_empty(), "{:#?}", self.losses);
    }
}

/// Whether the log tells of the damage to a file, as far as there is something to tell.
fn reported(name: &str, path: &Path, log: &str) -> bool {
    // TensorBoard's files are for people: nothing reads them again, and each record of theirs has a
    // checksum that TensorBoard knows.
    if name.contains("tfevents") {
        return true;
    }
    // A checksum that no longer fits speaks against its file, unless it was that of the content before the last.
    if let Some(of) = name.strip_suffix(".blake3") {
        return log.contains(of) || log.matches("trained before").count() == 2;
    }
    if name == "run/checksums" {
        return log.contains("checksum does not match");
    }
    log.contains(&path.display().to_string())
}
