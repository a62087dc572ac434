//! Running `sps` on small data.

#![allow(dead_code, reason = "each test program uses a part")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{self, ExitStatus, Output, Stdio};

use assert_cmd::Command;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tempfile::TempDir;

/// The root of the repository.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Waits for the end of a process: its status, and its log.
pub(crate) fn end(process: process::Child) -> (ExitStatus, String) {
    let Output { status, stderr, .. } = process.wait_with_output().expect("a process");
    (status, String::from_utf8_lossy(&stderr).into_owned())
}

/// Whether a journal has anything yet.
pub(crate) fn has_lines(journal: &Path) -> bool {
    fs::metadata(journal).is_ok_and(|file| file.len() > 0)
}

/// Waits until a process has `begun`, or has ended.
pub(crate) fn wait(child: &mut process::Child, begun: impl Fn() -> bool) {
    while !begun() && child.try_wait().expect("a process").is_none() {
        std::thread::yield_now();
    }
}

/// Kills a process once it has `begun`, or lets it end before that; whether it was killed.
pub(crate) fn kill(mut child: process::Child, begun: impl Fn() -> bool) -> bool {
    wait(&mut child, begun);
    let _ = child.kill();
    child.wait().expect("a process").code().is_none()
}

/// A scratch folder, mostly with a copy of the tiny dataset and an experiment on it.
pub(crate) struct Scratch {
    folder: TempDir,
}

/// SqueezeNet 1.1 has a quarter of the default encoder's weights. Reading, checking and writing weights is most of what
/// a run on a few small frames does.
const CONFIG: &str = r#"
reruns = 2
floors = []
properties = ["fRS", "cDF"]
[split.random]
validation = 0.34
by = "surface"
[data]
from = "folder"
[data.folder]
path = "DATA"
[encoder]
name = "squeezenet1-1"
depths = "last"
weights = "untrained"
[head]
epochs = 3
[report]
level = 0.95
[cache]
folder = "CACHE"
"#;

/// Its methods.
const METHODS: &str = "\
ridge | Ridge | ridge
cross-modal | Cross-modal | head | head.model = { kind = \"cross-modal\" }
";

/// Methods, one a line: `ID | LABEL | KIND | KEY = VALUE; KEY = VALUE`.
fn methods(lines: &str) -> String {
    let table = |line: &str| {
        let mut cells = line.split(" | ");
        let mut next = || cells.next().unwrap_or_default();
        let [id, label, kind, more] = [next(), next(), next(), next()];
        let more = more.replace("; ", "\n");
        format!("[[methods]]\nid = \"{id}\"\nlabel = \"{label}\"\nkind = \"{kind}\"\n{more}\n")
    };
    lines.lines().map(table).collect()
}

impl Scratch {
    /// In memory, unless `TMPDIR` is set or less than a gibibyte is free: tests write thousands of files.
    pub(crate) fn empty() -> Self {
        let (memory, disk) = (Path::new("/dev/shm"), std::env::temp_dir());
        let free = rustix::fs::statvfs(memory).map_or(0, |s| s.f_bavail * s.f_frsize);
        let in_memory = free >= 1 << 30 && std::env::var_os("TMPDIR").is_none();
        Self::below(if in_memory { memory } else { &disk })
    }

    /// For a static, whose folder stays after the tests: on the disk, below the folder of what was built.
    pub(crate) fn lasting() -> Self {
        Self::below(env!("CARGO_TARGET_TMPDIR").as_ref()).filled("")
    }

    fn below(path: &Path) -> Self {
        let folder = tempfile::tempdir_in(path).expect("a temporary folder");
        Self { folder }
    }

    pub(crate) fn new() -> Self {
        Self::with("")
    }

    /// The same with tables added to its config.
    pub(crate) fn with(tables: &str) -> Self {
        Self::empty().filled(tables)
    }

    fn filled(self, tables: &str) -> Self {
        copy(&root().join("fixtures/tiny-dataset"), &self.path("data"));
        let path = |name: &str| self.path(name).display().to_string();
        let config = CONFIG.replace("DATA", &path("data"));
        let config = config.replace("CACHE", &path("cache"));
        self.write("tiny.toml", config + &methods(METHODS) + tables);
        self
    }

    /// The same with methods, as [`methods`] has them.
    pub(crate) fn with_methods(lines: &str) -> Self {
        Self::with(&methods(lines))
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Replaces `from` by `to` in a file of the scratch folder.
    pub(crate) fn edit(&self, name: &str, from: &str, to: &str) {
        let text = self.read(name);
        assert!(text.contains(from), "{name} has no `{from}`");
        self.write(name, text.replacen(from, to, 1));
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).expect("a file");
    }

    /// A text file of the scratch folder.
    pub(crate) fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).expect("a text file")
    }

    /// The same of JSON.
    pub(crate) fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).expect("JSON")
    }

    /// The bytes of a file of the scratch folder.
    pub(crate) fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).expect("a file")
    }

    /// The words of a line, in which `@NAME` is the path of a file of the scratch folder.
    pub(crate) fn words(&self, line: &str) -> Vec<String> {
        let folder = format!("{}/", self.folder.path().display());
        let words = line.split_whitespace();
        words.map(|word| word.replace('@', &folder)).collect()
    }

    /// The command with the words of such a line.
    pub(crate) fn sps(&self, line: &str) -> Command {
        self.process(line).into()
    }

    /// The same as a process to start, which prints nothing.
    pub(crate) fn process(&self, line: &str) -> process::Command {
        let mut command = process::Command::new(env!("CARGO_BIN_EXE_sps"));
        command.current_dir(root()).env_remove("RUST_LOG");
        command.stdout(Stdio::null()).stderr(Stdio::null());
        command.args(self.words(line));
        command
    }

    /// The command with the words of such a line, run in the scratch folder.
    pub(crate) fn inside(&self, line: &str) -> Command {
        let mut command = self.sps(line);
        command.current_dir(self.path("."));
        command
    }

    /// Starts such a process, its log to be read.
    pub(crate) fn start(&self, line: &str) -> process::Child {
        let mut process = self.process(line);
        process.stderr(Stdio::piped()).spawn().expect("a process")
    }

    /// Keys of the trials of the run in a folder, in their order.
    pub(crate) fn keys(&self, run: &str) -> Vec<String> {
        let journal = self.bytes(&format!("{run}/trials.jsonl"));
        // Half a line that a kill has left is no trial.
        let lines = journal.split(|byte| *byte == b'\n');
        let lines = lines.filter_map(|line| serde_json::from_slice::<Value>(line).ok());
        let keys = lines.filter_map(|line| Some(line["trial"]["key"].as_str()?.to_owned()));
        keys.collect()
    }

    /// Has the config simulate its surfaces.
    pub(crate) fn simulates(&self, settings: &str) {
        let simulator = format!("from = \"simulator\"\nsimulated = {{ {settings} }}");
        self.edit("tiny.toml", "from = \"folder\"", &simulator);
    }

    /// Changes the readings of surfaces.
    pub(crate) fn change_readings(&self, change: impl Fn(&str, f64) -> f64) {
        let table = self.read("data/tactile.csv");
        let line = |line: &str| {
            let cells: Vec<&str> = line.split(',').collect();
            let cell = |(at, cell): (usize, &&str)| match cell.parse() {
                Ok(reading) if at > 2 => change(cells[0], reading).to_string(),
                _ => (*cell).to_owned(),
            };
            let changed: Vec<String> = cells.iter().enumerate().map(cell).collect();
            changed.join(",") + "\n"
        };
        let changed: String = table.lines().map(line).collect();
        self.write("data/tactile.csv", changed);
    }

    /// `experiment` on the scratch config, into the folder `run`.
    pub(crate) fn experiment(&self) -> Command {
        self.experiment_into("run")
    }

    /// `experiment` on the scratch config, into a folder of this name; options may follow.
    pub(crate) fn experiment_into(&self, run: &str) -> Command {
        self.sps(&format!("experiment @tiny.toml --out @{run}"))
    }

    /// The same to its end: its log.
    pub(crate) fn run_into(&self, run: &str) -> String {
        self.experiment_into(run).logged()
    }

    /// The folder after such a run.
    pub(crate) fn after_a_run() -> Self {
        let scratch = Self::new();
        scratch.ran();
        scratch
    }

    /// The same to its end, into the folder `run`: its results without what depends on the clock.
    pub(crate) fn ran(&self) -> Value {
        self.ran_with(&[])
    }

    /// The same with settings of the config.
    pub(crate) fn ran_with(&self, settings: &[&str]) -> Value {
        self.experiment().set(settings).assert().success();
        self.results()
    }

    /// `experiment` on the scratch config fails with a message that has every part.
    pub(crate) fn is_refused(&self, parts: &str) {
        self.experiment().refused(parts);
    }

    /// `results.json` of the run without what depends on the clock.
    pub(crate) fn results(&self) -> Value {
        self.results_in("run")
    }

    /// The same of the run in a folder of this name.
    pub(crate) fn results_in(&self, run: &str) -> Value {
        let mut results = self.json(&format!("{run}/results.json"));
        let whole = results.as_object_mut().expect("results");
        // The config names the folder of the cache.
        for key in ["cpu", "threads", "config_hash"] {
            assert!(whole.remove(key).is_some());
        }
        for method in results["methods"].as_array_mut().expect("methods") {
            let method = method.as_object_mut().expect("a method");
            // `peak_memory_bytes` too: more threads hold more at once.
            let keys = "decode_seconds_per_surface encode_seconds_per_surface head_seconds_per_surface \
                predict_seconds_per_surface train_seconds encoder_train_seconds peak_memory_bytes";
            for key in keys.split(' ') {
                assert!(method.remove(key).is_some());
            }
            let selections = method["selections"].as_object_mut().expect("selections");
            let of_properties = selections.values_mut().filter_map(Value::as_array_mut);
            of_properties.flatten().for_each(|selection| {
                selection["seconds"].take();
            });
        }
        results
    }
}

/// The method of this id in results.
pub(crate) fn method<'a>(results: &'a Value, id: &str) -> &'a Value {
    let mut methods = results["methods"].as_array().expect("methods").iter();
    let found = methods.find(|method| method["id"] == id);
    found.unwrap_or_else(|| panic!("no method {id}"))
}

/// Copies a folder.
pub(crate) fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder") {
        let path = entry.expect("an entry").path();
        let target = to.join(path.file_name().expect("a name"));
        if path.is_dir() {
            copy(&path, &target);
        } else {
            fs::copy(&path, &target).expect("a copy");
        }
    }
}

/// How a command is asked, and how it ends.
pub(crate) trait Ends {
    /// The same with settings of the config.
    fn set(&mut self, settings: &[&str]) -> &mut Self;

    /// What it prints, and its log, where it ends with this status.
    fn ended(&mut self, status: i32) -> [String; 2];

    /// The message where it fails as it should.
    fn message(&mut self) -> String {
        let [_, log] = self.ended(1);
        assert!(!log.contains("panicked"), "{log}");
        let error = log.find("error: ").expect("an error message");
        log[error..].trim_end().to_owned()
    }

    /// What it prints where it succeeds.
    fn said(&mut self) -> String {
        let [said, _] = self.ended(0);
        said
    }

    /// Its log where it succeeds.
    fn logged(&mut self) -> String {
        let [_, log] = self.ended(0);
        log
    }

    /// What it prints where it succeeds: JSON, and nothing beside it.
    fn json(&mut self) -> Value {
        serde_json::from_str(&self.said()).expect("JSON alone")
    }

    /// Fails as it should, with a message that has every part.
    fn refused(&mut self, parts: &str) {
        expect(&self.message(), parts);
    }
}

impl Ends for Command {
    fn set(&mut self, settings: &[&str]) -> &mut Self {
        self.args(settings.iter().flat_map(|setting| ["--set", setting]))
    }

    fn ended(&mut self, status: i32) -> [String; 2] {
        let ended = self.assert().code(status);
        let Output { stdout, stderr, .. } = ended.get_output().clone();
        [stdout, stderr].map(|text| String::from_utf8(text).expect("UTF-8"))
    }
}

/// The words of the line of a table that begins with this one, after it.
pub(crate) fn line(said: &str, first: &str) -> String {
    let mut lines = said.lines().map(str::trim_start);
    let found = lines.find_map(|line| line.strip_prefix(first)?.strip_prefix([' ', '\t']));
    let words: Vec<&str> = found.expect(said).split_whitespace().collect();
    words.join(" ")
}

/// Every part is in the message; parts have `; ` between them, so none has it within itself.
pub(crate) fn expect(message: &str, parts: &str) {
    for part in parts.split("; ") {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
}

/// The lines of a table of cases: what stands before ` | `, where `\n` ends a line, and the parts behind it.
pub(crate) fn cases(lines: &str) -> impl Iterator<Item = (String, &str)> {
    lines.trim().lines().map(|line| {
        let (before, parts) = line.split_once(" | ").expect("a case");
        (before.replace(r"\n", "\n"), parts)
    })
}

/// The rows of a table in CSV.
pub(crate) fn rows<T: DeserializeOwned>(text: &str) -> Vec<T> {
    let mut table = csv::Reader::from_reader(text.as_bytes());
    table.deserialize().map(|row| row.expect("a row")).collect()
}

/// Everything below a folder, with the bytes of files.
pub(crate) fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = PathBuf::from(path.file_name().expect("a name"));
        if path.is_dir() {
            let below = tree(&path).into_iter();
            found.extend(below.map(|(below, bytes)| (name.join(below), bytes)));
            found.insert(name, Vec::new());
        } else {
            found.insert(name, fs::read(&path).expect("a file"));
        }
    }
    found
}

/// A file system of its own, gone with the value; none where that is not permitted.
pub(crate) struct Mounted<'a>(&'a Path);

impl<'a> Mounted<'a> {
    pub(crate) fn new(path: &'a Path, options: &str) -> Option<Self> {
        fs::create_dir_all(path).unwrap();
        if Self::mount(&["-t", "tmpfs", "-o", options, "tmpfs"], path) {
            return Some(Self(path));
        }
        println!("skipped: file systems cannot be mounted here");
        None
    }

    pub(crate) fn remount(&self, options: &str) {
        let options = format!("remount,{options}");
        assert!(Self::mount(&["-o", &options], self.0));
    }

    fn mount(options: &[&str], path: &Path) -> bool {
        let mut command = process::Command::new("mount");
        let done = command.args(options).arg(path).output();
        done.is_ok_and(|output| output.status.success())
    }
}

impl Drop for Mounted<'_> {
    fn drop(&mut self) {
        let _ = process::Command::new("umount").arg(self.0).status();
    }
}

/// A scratch folder whose dataset is simulated.
pub(crate) fn simulated(options: &str) -> Scratch {
    let scratch = Scratch::new();
    fs::remove_dir_all(scratch.path("data")).expect("the tiny dataset");
    let line = format!("simulate {options} --out @data");
    scratch.sps(&line).assert().success();
    scratch
}

/// A scratch folder with a model in `model`, its config with `more` set.
pub(crate) fn fitted(more: &[&str]) -> Scratch {
    fitted_in(Scratch::new(), more)
}

/// The same, where the dataset may be another.
pub(crate) fn fitted_in(scratch: Scratch, more: &[&str]) -> Scratch {
    calibrates(&scratch);
    scratch.edit("tiny.toml", "validation = 0.34", "validation = 0.2");
    fit(&scratch, more).assert().success();
    scratch
}

/// Has half of the surfaces calibrate intervals at a level of a half.
pub(crate) fn calibrates(scratch: &Scratch) {
    let set = "[train]\ncalibration = 0.5\nlevel = 0.5\n[cache]";
    scratch.edit("tiny.toml", "[cache]", set);
}

/// The command that fits the model.
pub(crate) fn fit(scratch: &Scratch, more: &[&str]) -> Command {
    let mut fit = scratch.sps("fit --config @tiny.toml --out @model");
    fit.set(more);
    fit
}
