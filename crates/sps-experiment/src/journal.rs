//! The finished trials of a run, one checked line each.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use tracing::warn;

/// Identifies what a trial is computed from: equal keys mean equal outcomes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(crate) struct TrialKey(pub String);

impl TrialKey {
    /// The key of what is computed from `inputs`.
    pub(crate) fn of(inputs: &impl Serialize) -> Result<Self> {
        let hash = blake3::hash(&serde_json::to_vec(inputs)?);
        Ok(Self(hash.to_hex()[..32].to_owned()))
    }
}

pub(crate) trait Record: Clone + Serialize + DeserializeOwned {
    fn key(&self) -> &TrialKey;
}

/// What one trial (a method, a property, a rerun) came to.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Outcome {
    pub key: TrialKey,
    pub method: String,
    pub property: String,
    pub rerun: usize,
    /// Mean truth over the training part, the reference of R².
    pub training_mean: f64,
    /// Names of the surfaces held out, in the order of the two lists below.
    pub surfaces: Vec<String>,
    pub truth: Vec<f64>,
    pub estimate: Vec<f64>,
    /// Indices of the views that the method looks at.
    pub views: Vec<usize>,
    /// Of methods that make an interval for each of `surfaces`: these, in that order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stops: Vec<Stop>,
    /// Of a network, the loss of its estimates in training, epoch by epoch.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub course: Vec<f64>,
    pub train_seconds: f64,
    /// Why there is no estimate: `surfaces` and the lists beside it are then empty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failed: Option<String>,
}

/// The interval of an estimate: where looking at one view after the other ended, or as another system
/// gave it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Stop {
    /// How many views were looked at; 0 where the interval was given.
    pub views: usize,
    /// The interval around the estimate.
    pub low: f64,
    pub high: f64,
    /// Its width in standard deviations of the training readings; none where the interval was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width: Option<f64>,
}

impl Record for Outcome {
    fn key(&self) -> &TrialKey {
        &self.key
    }
}

/// Records by their keys, as `trials.jsonl`: append-only, a checksum on each line, so that a run killed at any moment, or a
/// file damaged later, costs the damaged lines and no other.
pub(crate) struct Journal<R> {
    path: PathBuf,
    /// None where it is only looked at.
    file: Option<File>,
    records: HashMap<TrialKey, R>,
}

#[derive(Serialize, Deserialize)]
struct Line<'a> {
    check: String,
    #[serde(borrow)]
    trial: &'a RawValue,
}

fn check(trial: &str) -> String {
    blake3::hash(trial.as_bytes()).to_hex()[..16].to_owned()
}

fn cannot_open(path: &Path) -> String {
    format!("cannot open {}", path.display())
}

impl<R: Record> Journal<R> {
    /// Opens or creates the journal at `path` and reads what it holds.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let mut options = OpenOptions::new();
        let file = options.read(true).append(true).create(true).open(path);
        let file = file.with_context(|| cannot_open(path))?;
        Ok(Self {
            path: path.to_owned(),
            records: read(&file, path)?,
            file: Some(file),
        })
    }

    /// The path of another file or folder where the journal lies.
    pub(crate) fn beside(&self, name: &str) -> PathBuf {
        self.path.with_file_name(name)
    }

    /// What the journal at `path` holds, to look at alone; nothing where there is none.
    pub(crate) fn look(path: &Path) -> Result<Self> {
        let records = match File::open(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => HashMap::new(),
            file => read(&file.with_context(|| cannot_open(path))?, path)?,
        };
        Ok(Self {
            path: path.to_owned(),
            file: None,
            records,
        })
    }

    /// Knows what another journal holds, too, without writing it down.
    pub(crate) fn know(&mut self, other: Self) {
        for (key, record) in other.records {
            self.records.entry(key).or_insert(record);
        }
    }

    /// Adds those of the records of another journal that it lacks.
    pub(crate) fn adopt(&mut self, other: Self) -> Result<()> {
        let new = other.records.into_iter();
        let new = new.filter(|(key, _)| !self.records.contains_key(key));
        let mut new: Vec<R> = new.map(|(_, record)| record).collect();
        new.sort_by(|one, other| one.key().0.cmp(&other.key().0));
        self.append(new)
    }

    pub(crate) fn get(&self, key: &TrialKey) -> Option<&R> {
        self.records.get(key)
    }

    /// Adds finished trials; when this returns they are on disk. Several processes may add to one file.
    pub(crate) fn append(&mut self, records: Vec<R>) -> Result<()> {
        let mut text = String::new();
        for record in &records {
            let trial = &serde_json::value::to_raw_value(record)?;
            let check = check(trial.get());
            let line = Line { check, trial };
            text.push_str(&serde_json::to_string(&line)?);
            text.push('\n');
        }
        let failed = || format!("cannot add to {}", self.path.display());
        let file = self.file.as_mut();
        let file = file.context("it is only looked at").with_context(failed)?;
        file.lock().with_context(failed)?;
        let added = add(file, &text);
        file.unlock().with_context(failed)?;
        added.with_context(failed)?;
        let keyed = records.into_iter();
        let keyed = keyed.map(|record| (record.key().clone(), record));
        self.records.extend(keyed);
        Ok(())
    }
}

/// Adds lines to a file that is locked, or nothing.
fn add(file: &mut File, lines: &str) -> io::Result<()> {
    let before = file.metadata()?.len();
    let mut last = [b'\n'];
    if before > 0 {
        file.seek(SeekFrom::End(-1))?;
        file.read_exact(&mut last)?;
    }
    // Nothing may be glued to the half line that a kill has left.
    let between = if last == [b'\n'] { "" } else { "\n" };
    let written = file.write_all(format!("{between}{lines}").as_bytes());
    let written = written.and_then(|()| file.sync_data());
    if written.is_err() {
        file.set_len(before)?;
    }
    written
}

fn read<R: Record>(mut file: &File, path: &Path) -> Result<HashMap<TrialKey, R>> {
    let failed = || format!("cannot read {}", path.display());
    let mut records = HashMap::new();
    let mut damaged = Vec::new();
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(0)).with_context(failed)?;
    let mut reader = BufReader::new(file);
    for number in 1.. {
        bytes.clear();
        if reader.read_until(b'\n', &mut bytes).with_context(failed)? == 0 {
            break;
        }
        match parse::<R>(&bytes) {
            Some(record) => drop(records.insert(record.key().clone(), record)),
            None => damaged.push(number),
        }
    }
    if !damaged.is_empty() {
        let (path, count) = (path.display(), damaged.len());
        warn!("{path}: {count} of the lines are damaged ({damaged:?}); their trials run again");
    }
    Ok(records)
}

fn parse<R: Record>(bytes: &[u8]) -> Option<R> {
    let line: Line<'_> = serde_json::from_slice(bytes).ok()?;
    if check(line.trial.get()) != line.check {
        return None;
    }
    serde_json::from_str(line.trial.get()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fuzz::{Damage, damaged, fuzz, nested};
    use std::fs;
    use tempfile::TempDir;

    fn outcome(key: &str, estimate: f64) -> Outcome {
        Outcome {
            key: TrialKey(key.to_owned()),
            method: "ridge".to_owned(),
            property: "fRS".to_owned(),
            rerun: 0,
            training_mean: 0.1 + 0.2,
            surfaces: vec!["s0".to_owned()],
            truth: vec![1.0 / 3.0],
            estimate: vec![estimate],
            views: vec![49],
            train_seconds: 0.5,
            ..Outcome::default()
        }
    }

    fn keys(journal: &Journal<Outcome>) -> Vec<&str> {
        let mut keys: Vec<&str> = journal.records.keys().map(|key| key.0.as_str()).collect();
        keys.sort_unstable();
        keys
    }

    /// A journal in a folder of its own, and its content.
    fn stored(outcomes: &[Outcome]) -> (TempDir, PathBuf, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trials.jsonl");
        let mut journal = Journal::open(&path).unwrap();
        journal.append(outcomes.to_vec()).unwrap();
        let whole = fs::read(&path).unwrap();
        (folder, path, whole)
    }

    #[test]
    fn what_was_appended_comes_back_to_the_bit() {
        let wanted = outcome("a", std::f64::consts::PI * 1e-7);
        let (_folder, path, _) = stored(std::slice::from_ref(&wanted));
        let journal = Journal::open(&path).unwrap();
        assert_eq!(journal.get(&wanted.key), Some(&wanted));
    }

    #[test]
    fn what_another_journal_holds_is_added_once() {
        let outcomes = ["a", "b"].map(|key| outcome(key, 0.5));
        let (folder, path, _) = stored(&outcomes[..1]);
        let other = folder.path().join("other.jsonl");
        let both = || Journal::<Outcome>::look(&other).unwrap();
        assert!(both().records.is_empty() && !other.exists());
        let mut others = Journal::open(&other).unwrap();
        others.append(outcomes.to_vec()).unwrap();
        let mut knowing = Journal::<Outcome>::look(&path).unwrap();
        knowing.know(both());
        assert_eq!(keys(&knowing), ["a", "b"]);
        assert!(knowing.append(vec![outcome("c", 0.5)]).is_err());
        let mut journal = Journal::open(&path).unwrap();
        for _ in 0..2 {
            journal.adopt(both()).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap().lines().count(), 2);
        }
    }

    #[test]
    fn a_file_cut_anywhere_keeps_every_whole_line_and_can_grow() {
        let (_folder, path, whole) = stored(&[outcome("a", 1.0), outcome("b", 2.0)]);
        let first = whole.iter().position(|byte| *byte == b'\n').unwrap() + 1;
        for cut in 0..whole.len() {
            fs::write(&path, &whole[..cut]).unwrap();
            let mut journal = Journal::open(&path).unwrap();
            // A line that lacks nothing but its newline is whole.
            let expected = usize::from(cut + 1 >= first) + usize::from(cut + 1 >= whole.len());
            assert_eq!(journal.records.len(), expected, "cut at {cut}");
            journal.append(vec![outcome("c", 3.0)]).unwrap();
            let again = Journal::<Outcome>::open(&path).unwrap();
            assert_eq!(again.records.len(), expected + 1, "cut at {cut}");
        }
    }

    /// Another process writes to the file, and is killed, while this one has it open.
    #[test]
    fn two_processes_may_add_to_one_journal() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("selections.jsonl");
        let [mut one, mut two] = [(); 2].map(|()| Journal::open(&path).unwrap());
        let mut other = OpenOptions::new().append(true).open(&path).unwrap();
        other.lock().unwrap();
        let added = std::thread::spawn(move || one.append(vec![outcome("a", 1.0)]));
        (0..10_000).for_each(|_| std::thread::yield_now());
        other.write_all(b"{\"check\":\"0123").unwrap();
        assert_eq!(fs::read(&path).unwrap().len(), 14, "the lock was not kept");
        other.unlock().unwrap();
        added.join().unwrap().unwrap();
        two.append(vec![outcome("b", 2.0)]).unwrap();
        let journal = Journal::<Outcome>::open(&path).unwrap();
        assert_eq!(keys(&journal), ["a", "b"]);
        assert_eq!(fs::read_to_string(&path).unwrap().lines().count(), 3);
    }

    #[test]
    fn a_flipped_bit_costs_its_line_alone() {
        let (_folder, path, whole) = stored(&[outcome("a", 1.0), outcome("b", 2.0)]);
        let first = whole.iter().position(|byte| *byte == b'\n').unwrap();
        for at in 0..first {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            fs::write(&path, &bytes).unwrap();
            assert_eq!(keys(&Journal::open(&path).unwrap()), ["b"], "bit at {at}");
        }
    }

    #[test]
    fn any_damage_to_a_journal_costs_lines_and_changes_none() {
        let outcomes = ["a", "b", "c"].map(|key| outcome(key, 0.1));
        let (_folder, path, whole) = stored(&outcomes);
        fuzz("journals", &Damage::some(), |damages| {
            fs::write(&path, damaged(whole.clone(), &damages)).unwrap();
            let journal = Journal::<Outcome>::open(&path).unwrap();
            for record in journal.records.values() {
                assert!(outcomes.contains(record));
            }
        });
    }

    /// Trials that are damaged under a checksum that is right.
    #[test]
    fn any_damage_to_a_trial_is_survived() {
        let (_folder, path, _) = stored(&[]);
        let open = |trial: &str| {
            let line = format!("{{\"check\":\"{}\",\"trial\":{trial}}}", check(trial));
            fs::write(&path, line).unwrap();
            Journal::<Outcome>::open(&path).unwrap()
        };
        let trial = serde_json::to_string(&outcome("a", 0.1)).unwrap();
        fuzz("trials", &Damage::some(), |damages| {
            let trial = damaged(trial.clone().into_bytes(), &damages);
            open(&String::from_utf8_lossy(&trial));
        });
        nested("trials", |text| assert!(open(&text).records.is_empty()));
    }
}
