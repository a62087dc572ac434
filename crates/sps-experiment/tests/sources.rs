//! What of the sources tells trials of other code apart.

#[path = "../build/sources.rs"]
mod sources;

use std::fs;
use std::path::Path;

use tempfile::TempDir;

const LIB: &str = r"
//! A crate.
mod inner;
#[cfg(test)]
mod tests;
/// What it does.
pub fn twice(x: f64) -> f64 {
    #[cfg(test)]
    if x < 0.0 {
        return 0.0;
    }
    // Not three times.
    2.0 * x
}
#[cfg(test)]
use std::fs::{self, File};
";

/// Files beside [`LIB`], and whether they decide.
const OTHERS: [(&str, bool); 7] = [
    ("a/src/tests.rs", false),
    ("a/src/tests/more.rs", false),
    ("a/tests/all.rs", false),
    ("a/src/inner.rs", true),
    ("a/src/data.toml", true),
    ("sps-experiment/src/embeddings/embedder.rs", true),
    ("sps-experiment/src/report.rs", false),
];

/// A repository with one crate and what else is hashed.
struct Repository(TempDir);

impl Repository {
    fn new() -> Self {
        let repository = Self(tempfile::tempdir().unwrap());
        for name in sources::WATCHED {
            if name.contains('.') {
                repository.write(name, "");
            } else {
                fs::create_dir_all(repository.0.path().join(name)).unwrap();
            }
        }
        repository.write("crates/a/src/lib.rs", LIB);
        for (name, _) in OTHERS {
            repository.write(&format!("crates/{name}"), "1");
        }
        repository
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.0.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn hash(&self) -> String {
        sources::hash(self.0.path(), &sources::WATCHED).unwrap()
    }

    /// Whether other text in a file makes another hash.
    fn matters(&self, name: &str, from: &str, to: &str) -> bool {
        let (path, before) = (self.0.path().join(name), self.hash());
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{name} has no `{from}`");
        fs::write(&path, text.replace(from, to)).unwrap();
        let after = self.hash();
        fs::write(&path, text).unwrap();
        assert_eq!(self.hash(), before);
        after != before
    }
}

#[test]
fn what_is_compiled_decides_and_comments_layout_and_tests_do_not() {
    let repository = Repository::new();
    for (from, to, decides) in [
        ("Not three times", "By a factor of two", false),
        ("What it does", "Twice", false),
        ("A crate", "The crate", false),
        ("x < 0.0", "x < 1.0", false),
        ("{self, File}", "File", false),
        ("    2.0 * x", "2.0*x", false),
        ("2.0", "3.0", true),
        ("2.0 * x", "2.0 + x", true),
        ("mod inner;", "mod tests;", true),
        ("pub fn", "#[inline] pub fn", true),
        ("#[cfg(test)]\nmod tests;", "mod tests;", true),
    ] {
        let matters = repository.matters("crates/a/src/lib.rs", from, to);
        assert_eq!(matters, decides, "{from}");
    }
    for (name, decides) in OTHERS {
        let matters = repository.matters(&format!("crates/{name}"), "1", "2");
        assert_eq!(matters, decides, "{name}");
    }
    repository.write("Cargo.lock", "[package]");
    assert_ne!(repository.hash(), Repository::new().hash());
}

/// Every file of this repository can be read.
#[test]
fn the_sources_have_a_hash() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let hash = sources::hash(&package.join("../.."), &sources::WATCHED);
    assert_eq!(hash.unwrap().len(), 16);
    // A package has its own lock file beside them.
    let hash = sources::hash(package, &sources::PACKAGED[1..]);
    assert_eq!(hash.unwrap().len(), 16);
}
