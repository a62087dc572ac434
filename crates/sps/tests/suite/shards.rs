//! Experiments in shards, and what there is to do before a run.

use std::collections::BTreeSet;
use std::fs;
use std::process::Child;

use crate::support::{Ends, Scratch, copy, end, expect, has_lines, kill, line};

/// Methods that ask the same networks, one that asks refits, and two on an encoder that is trained.
const METHODS: &str = "\
nvs | NVS | head | views = 2; selector = { kind = 'nvs', evaluations = 200 }
exhaustive | Exhaustive | head | views = 2; selector = { kind = 'exhaustive' }
refit | Refit | kernel-ridge | views = 2; selector = { kind = 'greedy' }; refit = {}
fine-tuned | Fine-tuned | ridge | encoder = { trainable = true, training = { epochs = 2, batch-size = 4 } }
fine-tuned-kernel | Fine-tuned, kernel | kernel-ridge | \
    encoder = { trainable = true, training = { epochs = 2, batch-size = 4 } }
";

/// Starts a shard of the run in `run`.
fn start(scratch: &Scratch, shard: &str) -> Child {
    scratch.start(&format!("experiment @tiny.toml --out @run --shard {shard}"))
}

/// Its log, once it has ended well.
fn logged(shard: Child) -> String {
    let (status, log) = end(shard);
    assert!(status.success(), "{log}");
    log
}

#[test]
fn shards_come_to_what_one_run_does() {
    let scratch = Scratch::with_methods(METHODS);
    let expected = scratch.ran();
    let all = scratch.keys("run");
    for of in [1, 2, 4] {
        let run = format!("run-{of}");
        let mut dealt = Vec::new();
        for number in 1..=of {
            let own = format!("{run}/shards/{number}-of-{of}");
            scratch.run_into(&format!("{run} --shard {number}/{of}"));
            assert!(!scratch.path(&own).join("results.json").exists());
            dealt.extend(scratch.keys(&own));
        }
        // Each trial once.
        assert_eq!(dealt.len(), all.len(), "{of}");
        assert_eq!(dealt.iter().collect::<BTreeSet<_>>(), all.iter().collect());
        // The plain command finds all of it done.
        let (to, line) = if of == 2 {
            (run.clone(), run)
        } else {
            let merged = format!("merged-{of}");
            (merged.clone(), format!("{merged} --merge @{run}"))
        };
        scratch.run_into(&line);
        assert_eq!(scratch.results_in(&to), expected, "{of} shards");
        assert_eq!(scratch.keys(&to).len(), all.len());
    }
}

#[test]
fn more_shards_than_items_leave_some_without_work() {
    let scratch = Scratch::new();
    let expected = scratch.ran();
    for number in 1..=6 {
        scratch.run_into(&format!("many --shard {number}/6"));
    }
    scratch.run_into("many --merge");
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
    let log = scratch.run_into("run --merge @run");
    assert!(log.contains("0 of them encoded now"), "{log}");
    assert_eq!(scratch.results(), expected);
}

#[test]
fn a_shard_that_was_killed_is_run_again_alone() {
    let scratch = Scratch::new();
    scratch.edit("tiny.toml", "epochs = 3", "epochs = 40");
    let expected = scratch.ran();
    fs::remove_dir_all(scratch.path("run")).unwrap();
    scratch.run_into("run --shard 1/2");
    let journal = scratch.path("run/shards/2-of-2/trials.jsonl");
    let child = start(&scratch, "2/2");
    // Once the first trials are on disk.
    let killed = kill(child, || has_lines(&journal));
    let begun = fs::read_to_string(&journal).unwrap();
    if killed {
        let again = "shard 2/2; 2-of-2; has not ended; `--shard 2/2` again";
        scratch.experiment_into("run --merge @run").refused(again);
    }
    scratch.run_into("run --shard 2/2");
    assert!(fs::read_to_string(&journal).unwrap().starts_with(&begun));
    scratch.run_into("run --merge @run");
    assert_eq!(scratch.results(), expected);
}

#[test]
fn two_of_one_number_wait_for_one_another() {
    let scratch = Scratch::new();
    let children = [(); 2].map(|()| start(&scratch, "1/1"));
    let logs = children.map(logged);
    let is_waiting = |log: &&String| log.contains("waiting") && log.contains("1-of-1");
    assert_eq!(logs.iter().filter(is_waiting).count(), 1, "{logs:?}");
    let keys = scratch.keys("run/shards/1-of-1");
    assert_eq!(keys.len(), keys.iter().collect::<BTreeSet<_>>().len());
}

#[test]
fn shards_in_folders_of_their_own_with_caches_of_their_own_are_merged() {
    let scratch = Scratch::with_methods(METHODS);
    let expected = scratch.ran();
    for (number, run) in [(1, "here"), (2, "there")] {
        let settings = format!("--set cache.folder=@cache-{run}");
        scratch.run_into(&format!("{run} --shard {number}/2 {settings}"));
    }
    // As if brought from the machines; entries are named by what they hold.
    fs::remove_dir_all(scratch.path("cache")).unwrap();
    for cache in ["cache-here", "cache-there"] {
        copy(&scratch.path(cache), &scratch.path("cache"));
    }
    scratch.run_into("merged --merge @here @there");
    assert_eq!(scratch.results_in("merged"), expected);
}

#[test]
fn shards_that_do_not_belong_together_are_named() {
    let scratch = Scratch::new();
    let refused = |parts: &str| {
        let message = scratch.experiment_into("run --merge @run").message();
        expect(&message, parts);
        assert!(!scratch.path("run/results.json").exists());
        message
    };
    // Said before data are looked for.
    let [data, away] = ["data", "away"].map(|name| scratch.path(name));
    fs::rename(&data, &away).unwrap();
    refused("--merge; run: no shards here; --shard K/N");
    fs::rename(&away, &data).unwrap();
    scratch.run_into("run --shard 1/3");
    refused("shards are missing: 2/3, 3/3");
    scratch.run_into("run --shard 2/2");
    refused("shard 2/2; shard 1/3; do not belong together");
    fs::remove_dir_all(scratch.path("run/shards/1-of-3")).unwrap();

    let other = |more: &str| scratch.run_into(&format!("run --shard 1/2 {more}"));
    other("--set seed=1");
    refused("shard 1/2; another config; `seed` is 1, here 0");
    other("--only ridge");
    let message = refused("shard 1/2; other methods");
    let methods = "ridge; here ridge, cross-modal";
    assert!(message.contains(methods), "{message}");
    other("");
    let table = scratch.read("data/tactile.csv");
    scratch.edit("data/tactile.csv", ",0.37,0.11,", ",0.37,0.12,");
    refused("shard 1/2; other data; data_hash");
    scratch.write("data/tactile.csv", table);

    let manifest = "run/shards/2-of-2/shard.json";
    let mut changed = scratch.json(manifest);
    changed["source_hash"] = "0123".into();
    let changed = changed.to_string();
    scratch.write(manifest, &changed);
    // Its checksum no longer fits.
    refused("shard 2/2; has not ended");
    let checksum = format!("{}\n", blake3::hash(changed.as_bytes()));
    scratch.write("run/shards/2-of-2/shard.json.blake3", checksum);
    refused("shard 2/2; other sources: `0123`");
    scratch.run_into("run --shard 2/2");
    scratch.run_into("run --merge @run");
}

#[test]
fn a_merge_does_no_work_of_a_shard() {
    let scratch = Scratch::new();
    scratch.run_into("run --shard 1/1");
    let journal = "run/shards/1-of-1/trials.jsonl";
    let text = scratch.read(journal);
    scratch.write(journal, text.split_once('\n').unwrap().1);
    let none = "method `; rerun ; in none of the shards";
    scratch.experiment_into("run --merge @run").refused(none);
    // The shard mends it, or the plain command does.
    scratch.experiment().assert().success();
}

#[test]
fn a_number_that_is_no_shard_is_refused() {
    let scratch = Scratch::new();
    for text in ["0/2", "3/2", "2"] {
        let mut shard = scratch.experiment_into(&format!("run --shard {text}"));
        let [_, log] = shard.ended(2);
        expect(&log, "is not K/N");
    }
}

#[test]
fn a_dry_run_counts_and_writes_nothing() {
    let scratch = Scratch::with_methods(METHODS);
    let before = scratch.experiment().arg("--dry-run").said();
    assert!(!scratch.path("run").exists() && !scratch.path("cache").exists());
    assert_eq!(line(&before, "ridge"), "0 4", "{before}");
    assert_eq!(line(&before, "nvs"), "0 4 0 4", "{before}");
    assert!(before.contains("to encode") && before.contains("to be trained on 2 splits"));
    assert!(!before.contains("nothing is missing"), "{before}");

    scratch.run_into("run --shard 1/2");
    let part = scratch.experiment().arg("--dry-run").said();
    assert_eq!(line(&part, "ridge"), "2 2", "{part}");
    assert_eq!(line(&part, "nvs"), "2 2 2 2", "{part}");
    assert!(part.contains("to be trained on 1 split"), "{part}");
    let own = scratch.experiment_into("run --shard 1/2 --dry-run").said();
    assert_eq!(line(&own, "ridge"), "2 0", "{own}");

    scratch.experiment().assert().success();
    let journal = scratch.read("run/trials.jsonl");
    let after = scratch.experiment().arg("--dry-run").said();
    assert_eq!(line(&after, "exhaustive"), "4 0 4 0", "{after}");
    assert!(after.contains("nothing is missing"), "{after}");
    assert_eq!(scratch.read("run/trials.jsonl"), journal);
}
