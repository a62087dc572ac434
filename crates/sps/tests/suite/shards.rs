//! Experiments in shards, and what there is to do before a run.

use std::collections::BTreeSet;
use std::fs;
use std::process::{Child, Output, Stdio};

use crate::support::{Ends, Scratch, copy, expect, kill, texts};
use serde_json::Value;

/// Methods that ask the same networks, one that asks refits, and two on an encoder that is trained.
const METHODS: &str = "\
nvs | NVS | head | views = 2; selector = { kind = 'nvs', evaluations = 200 }
exhaustive | Exhaustive | head | views = 2; selector = { kind = 'exhaustive' }
refit | Refit | kernel-ridge | views = 2; selector = { kind = 'greedy' }; refit = {}
fine-tuned | Fine-tuned | ridge | encoder = { trainable = true, training = { epochs = 2, batch-size = 4 } }
fine-tuned-kernel | Fine-tuned, kernel | kernel-ridge | \
    encoder = { trainable = true, training = { epochs = 2, batch-size = 4 } }
";

/// A shard of the run in the folder of this name.
fn shard(scratch: &Scratch, run: &str, shard: &str) -> assert_cmd::Command {
    scratch.experiment_into(&format!("{run} --shard {shard}"))
}

/// What makes results in the folder `to` of shards below others.
fn merge(scratch: &Scratch, to: &str, runs: &str) -> assert_cmd::Command {
    scratch.experiment_into(&format!("{to} --merge {runs}"))
}

/// Starts a shard of the run in `run`.
fn start(scratch: &Scratch, shard: &str) -> Child {
    let line = format!("experiment @tiny.toml --out @run --shard {shard}");
    let mut command = scratch.process(&line);
    command.stderr(Stdio::piped()).spawn().unwrap()
}

/// Its log, once it has ended well.
fn logged(shard: Child) -> String {
    let Output { status, stderr, .. } = shard.wait_with_output().unwrap();
    let log = String::from_utf8(stderr).unwrap();
    assert!(status.success(), "{log}");
    log
}

/// Keys of the trials of the run in this folder, in their order.
fn keys(scratch: &Scratch, run: &str) -> Vec<String> {
    let text = scratch.read(&format!("{run}/trials.jsonl"));
    let lines = text.lines();
    let lines = lines.filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let keys = lines.filter_map(|line| Some(line["trial"]["key"].as_str()?.to_owned()));
    keys.collect()
}

#[test]
fn shards_come_to_what_one_run_does() {
    let scratch = Scratch::with_methods(METHODS);
    let expected = scratch.ran();
    let all = keys(&scratch, "run");
    for of in [1, 2, 4] {
        let run = format!("run-{of}");
        let mut dealt = Vec::new();
        for number in 1..=of {
            let own = format!("{run}/shards/{number}-of-{of}");
            let name = format!("{number}/{of}");
            shard(&scratch, &run, &name).assert().success();
            assert!(!scratch.path(&own).join("results.json").exists());
            dealt.extend(keys(&scratch, &own));
        }
        // Each trial once.
        assert_eq!(dealt.len(), all.len(), "{of}");
        assert_eq!(dealt.iter().collect::<BTreeSet<_>>(), all.iter().collect());
        // The plain command finds all of it done.
        let merged = format!("merged-{of}");
        let (to, mut command) = if of == 2 {
            (&run, scratch.experiment_into(&run))
        } else {
            (&merged, merge(&scratch, &merged, &format!("@{run}")))
        };
        command.assert().success();
        assert_eq!(scratch.results_in(to), expected, "{of} shards");
        assert_eq!(keys(&scratch, to).len(), all.len());
    }
}

#[test]
fn more_shards_than_items_leave_some_without_work() {
    let scratch = Scratch::new();
    let expected = scratch.ran();
    for number in 1..=6 {
        let name = format!("{number}/6");
        shard(&scratch, "many", &name).assert().success();
    }
    merge(&scratch, "many", "").assert().success();
    assert_eq!(scratch.results_in("many"), expected);
}

#[test]
fn shards_at_once_share_one_cache() {
    let scratch = Scratch::with_methods(METHODS);
    let expected = scratch.ran();
    fs::remove_dir_all(scratch.path("run")).unwrap();
    fs::remove_dir_all(scratch.path("cache")).unwrap();
    let children = ["1/3", "2/3", "3/3"].map(|shard| start(&scratch, shard));
    for child in children {
        logged(child);
    }
    let log = merge(&scratch, "run", "@run").logged();
    assert!(log.contains("0 of them encoded now"), "{log}");
    assert_eq!(scratch.results(), expected);
}

#[test]
fn a_shard_that_was_killed_is_run_again_alone() {
    let scratch = Scratch::new();
    scratch.edit("tiny.toml", "epochs = 3", "epochs = 40");
    let expected = scratch.ran();
    fs::remove_dir_all(scratch.path("run")).unwrap();
    shard(&scratch, "run", "1/2").assert().success();
    let journal = scratch.path("run/shards/2-of-2/trials.jsonl");
    let child = start(&scratch, "2/2");
    // Once the first trials are on disk.
    let killed = kill(child, || {
        fs::metadata(&journal).is_ok_and(|file| file.len() > 0)
    });
    let begun = fs::read_to_string(&journal).unwrap();
    if killed {
        let refused = merge(&scratch, "run", "@run").message();
        let again = "`--shard 2/2` again";
        expect(&refused, &["shard 2/2", "2-of-2", "has not ended", again]);
    }
    shard(&scratch, "run", "2/2").assert().success();
    assert!(fs::read_to_string(&journal).unwrap().starts_with(&begun));
    merge(&scratch, "run", "@run").assert().success();
    assert_eq!(scratch.results(), expected);
}

#[test]
fn two_of_one_number_wait_for_one_another() {
    let scratch = Scratch::new();
    let children = [(); 2].map(|()| start(&scratch, "1/1"));
    let logs = children.map(logged);
    let is_waiting = |log: &&String| log.contains("waiting") && log.contains("1-of-1");
    assert_eq!(logs.iter().filter(is_waiting).count(), 1, "{logs:?}");
    let keys = keys(&scratch, "run/shards/1-of-1");
    assert_eq!(keys.len(), keys.iter().collect::<BTreeSet<_>>().len());
}

#[test]
fn shards_in_folders_of_their_own_with_caches_of_their_own_are_merged() {
    let scratch = Scratch::with_methods(METHODS);
    let expected = scratch.ran();
    for (number, run) in [(1, "here"), (2, "there")] {
        let settings = format!("--set cache.folder=@cache-{run}");
        let mut part = shard(&scratch, run, &format!("{number}/2 {settings}"));
        part.assert().success();
    }
    // As if brought from the machines; entries are named by what they hold.
    fs::remove_dir_all(scratch.path("cache")).unwrap();
    for cache in ["cache-here", "cache-there"] {
        copy(&scratch.path(cache), &scratch.path("cache"));
    }
    let mut merge = merge(&scratch, "merged", "@here @there");
    merge.assert().success();
    assert_eq!(scratch.results_in("merged"), expected);
}

#[test]
fn shards_that_do_not_belong_together_are_named() {
    let scratch = Scratch::new();
    let refused = |parts: &[&str]| {
        merge(&scratch, "run", "@run").refused(parts);
        assert!(!scratch.path("run/results.json").exists());
    };
    // Said before data are looked for.
    let [data, away] = ["data", "away"].map(|name| scratch.path(name));
    fs::rename(&data, &away).unwrap();
    refused(&["--merge", "run: no shards here", "--shard K/N"]);
    fs::rename(&away, &data).unwrap();
    shard(&scratch, "run", "1/3").assert().success();
    refused(&["shards are missing: 2/3, 3/3"]);
    shard(&scratch, "run", "2/2").assert().success();
    refused(&["shard 2/2", "shard 1/3", "do not belong together"]);
    fs::remove_dir_all(scratch.path("run/shards/1-of-3")).unwrap();

    let other = |more: &str| {
        let mut part = shard(&scratch, "run", &format!("1/2 {more}"));
        part.assert().success();
    };
    other("--set seed=1");
    refused(&["shard 1/2", "another config", "`seed` is 1, here 0"]);
    other("--only ridge");
    let methods = "ridge; here ridge, cross-modal";
    refused(&["shard 1/2", "other methods", methods]);
    other("");
    let table = scratch.read("data/tactile.csv");
    scratch.edit("data/tactile.csv", ",0.37,0.11,", ",0.37,0.12,");
    refused(&["shard 1/2", "other data", "data_hash"]);
    scratch.write("data/tactile.csv", table);

    let manifest = scratch.path("run/shards/2-of-2/shard.json");
    let text = fs::read_to_string(&manifest).unwrap();
    let mut whole: Value = serde_json::from_str(&text).unwrap();
    whole["source_hash"] = "0123".into();
    let bytes = serde_json::to_vec(&whole).unwrap();
    fs::write(&manifest, &bytes).unwrap();
    // Its checksum no longer fits.
    refused(&["shard 2/2", "has not ended"]);
    let checksum = manifest.with_file_name("shard.json.blake3");
    fs::write(checksum, format!("{}\n", blake3::hash(&bytes))).unwrap();
    refused(&["shard 2/2", "other sources: `0123`"]);
    shard(&scratch, "run", "2/2").assert().success();
    merge(&scratch, "run", "@run").assert().success();
}

#[test]
fn a_merge_does_no_work_of_a_shard() {
    let scratch = Scratch::new();
    shard(&scratch, "run", "1/1").assert().success();
    let journal = scratch.path("run/shards/1-of-1/trials.jsonl");
    let text = fs::read_to_string(&journal).unwrap();
    fs::write(&journal, text.split_once('\n').unwrap().1).unwrap();
    merge(&scratch, "run", "@run").refused(&["method `", "rerun ", "in none of the shards"]);
    // The shard mends it, or the plain command does.
    scratch.experiment().assert().success();
}

#[test]
fn a_number_that_is_no_shard_is_refused() {
    let scratch = Scratch::new();
    for text in ["0/2", "3/2", "2"] {
        let refused = shard(&scratch, "run", text).assert().code(2);
        expect(&texts(&refused)[1], &["is not K/N"]);
    }
}

/// The words of the line that begins with this one, after it.
fn line(said: &str, first: &str) -> Vec<String> {
    let lines = said.lines().map(str::split_whitespace);
    let mut found = lines.filter_map(|mut words| (words.next()? == first).then_some(words));
    let words = found.next().expect("a line");
    words.map(str::to_owned).collect()
}

#[test]
fn a_dry_run_counts_and_writes_nothing() {
    let scratch = Scratch::with_methods(METHODS);
    let before = scratch.experiment().arg("--dry-run").said();
    assert!(!scratch.path("run").exists() && !scratch.path("cache").exists());
    assert_eq!(line(&before, "ridge"), ["0", "4"], "{before}");
    assert_eq!(line(&before, "nvs"), ["0", "4", "0", "4"], "{before}");
    assert!(before.contains("to encode") && before.contains("to be trained on 2 splits"));
    assert!(!before.contains("nothing is missing"), "{before}");

    shard(&scratch, "run", "1/2").assert().success();
    let part = scratch.experiment().arg("--dry-run").said();
    assert_eq!(line(&part, "ridge"), ["2", "2"], "{part}");
    assert_eq!(line(&part, "nvs"), ["2", "2", "2", "2"], "{part}");
    assert!(part.contains("to be trained on 1 split"), "{part}");
    let own = shard(&scratch, "run", "1/2").arg("--dry-run").said();
    assert_eq!(line(&own, "ridge"), ["2", "0"], "{own}");

    scratch.experiment().assert().success();
    let journal = fs::read(scratch.path("run/trials.jsonl")).unwrap();
    let after = scratch.experiment().arg("--dry-run").said();
    let done = ["4", "0", "4", "0"];
    assert_eq!(line(&after, "exhaustive"), done, "{after}");
    assert!(after.contains("nothing is missing"), "{after}");
    assert_eq!(fs::read(scratch.path("run/trials.jsonl")).unwrap(), journal);
}
