//! What of the sources decides results: the crates beneath this one, and what of this one stands between
//! data and outcomes, as the compiler reads them. Comments, layout and tests decide nothing.

use std::collections::BTreeSet;
use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use proc_macro2::{Delimiter, Ident, TokenStream, TokenTree};

/// Files, and folders of files, below the root of the repository; of `crates`, what is in
/// `crates/*/src` of those that are not [`IN_PART`].
pub(crate) const WATCHED: [&str; 9] = [
    "Cargo.lock",
    CRATES,
    "crates/sps-experiment/src/cells.rs",
    "crates/sps-experiment/src/data",
    "crates/sps-experiment/src/embeddings",
    "crates/sps-experiment/src/encoder.rs",
    "crates/sps-experiment/src/run",
    "crates/sps-experiment/src/sequences.rs",
    "crates/sps-experiment/src/training",
];

/// The same in a package of this crate, which pins the others by its `Cargo.lock`.
pub(crate) const PACKAGED: [&str; 2] = ["Cargo.lock", "src"];

const CRATES: &str = "crates";

/// Crates of which nothing decides results but what is watched by name.
const IN_PART: [&str; 3] = ["sps", "sps-experiment", "sps-report"];

/// The hash of what is `watched` below `root`.
///
/// # Errors
/// A file that cannot be read, or is no Rust.
pub(crate) fn hash(root: &Path, watched: &[&str]) -> Result<String, Box<dyn Error>> {
    let mut files = Vec::new();
    for &watched in watched {
        if watched == CRATES {
            for entry in fs::read_dir(root.join(CRATES))? {
                let entry = entry?;
                if !IN_PART.iter().any(|name| entry.file_name() == *name) {
                    list(entry.path().join("src"), &mut files)?;
                }
            }
        } else {
            list(root.join(watched), &mut files)?;
        }
    }
    files.sort();
    let (mut contents, mut tests) = (Vec::new(), BTreeSet::new());
    for file in files {
        let mut content = fs::read(&file)?;
        if file.extension().is_some_and(|extension| extension == "rs") {
            let tokens = String::from_utf8(content)?.parse::<TokenStream>();
            let tokens = tokens.map_err(|error| format!("{}: {error}", file.display()))?;
            let text = code(tokens, &mut |name| {
                tests.insert(module(&file, &name.to_string()));
            });
            content = text.into_bytes();
        }
        contents.push((file, content));
    }
    let mut hasher = blake3::Hasher::new();
    for (file, content) in contents {
        let mut within = file.ancestors().map(|path| path.with_extension(""));
        if !within.any(|module| tests.contains(&module)) {
            let name = file.strip_prefix(root)?.as_os_str().as_encoded_bytes();
            hasher.update(blake3::hash(name).as_bytes());
            hasher.update(blake3::hash(&content).as_bytes());
        }
    }
    Ok(hasher.finalize().to_hex()[..16].to_owned())
}

/// The file at `path`, or all files below it.
fn list(path: PathBuf, files: &mut Vec<PathBuf>) -> io::Result<()> {
    if !path.is_dir() {
        files.push(path);
        return Ok(());
    }
    for entry in fs::read_dir(path)? {
        list(entry?.path(), files)?;
    }
    Ok(())
}

/// Where the module `name` is that `file` declares: `NAME.rs` or the folder `NAME`, without ending.
fn module(file: &Path, name: &str) -> PathBuf {
    match file.file_stem().and_then(|stem| stem.to_str()) {
        Some("lib" | "main" | "mod") => file.with_file_name(name),
        _ => file.with_extension("").join(name),
    }
}

/// The code without comments, layout and what is compiled for tests alone; modules of tests that
/// are files of their own go to `tests`.
fn code(tokens: TokenStream, tests: &mut dyn FnMut(&Ident)) -> String {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let (mut rest, mut text) = (&tokens[..], String::new());
    while let Some((token, after)) = rest.split_first() {
        rest = match attribute(rest) {
            Some((attribute, after)) if attribute.starts_with("doc ") => after,
            Some((attribute, after)) if attribute == "cfg (test)" => skip_item(after, tests),
            _ => after,
        };
        if rest.len() < after.len() {
            continue;
        }
        let _ = match token {
            TokenTree::Group(group) => {
                let inner = code(group.stream(), tests);
                write!(text, "{:?} {inner}end ", group.delimiter())
            }
            other => write!(text, "{other} "),
        };
    }
    text
}

/// What stands in the brackets of an attribute that the tokens begin with, and what comes after.
fn attribute(tokens: &[TokenTree]) -> Option<(String, &[TokenTree])> {
    match tokens {
        [sign, rest @ ..] if is(sign, '#') => match rest {
            [sign, TokenTree::Group(group), after @ ..] if is(sign, '!') => Some((group, after)),
            [TokenTree::Group(group), after @ ..] => Some((group, after)),
            _ => None,
        },
        _ => None,
    }
    .map(|(group, after)| (group.stream().to_string(), after))
}

/// What comes after the first item or statement. Where its end is in doubt it ends early: to hash
/// what decides nothing costs time, the other way round it costs results.
fn skip_item<'t>(tokens: &'t [TokenTree], tests: &mut dyn FnMut(&Ident)) -> &'t [TokenTree] {
    let in_braces = |token: &TokenTree| match token {
        TokenTree::Group(group) => group.delimiter() == Delimiter::Brace,
        _ => false,
    };
    let is_last = |token: &TokenTree| in_braces(token) || is(token, ';') || is(token, ',');
    let end = tokens.iter().position(is_last);
    let (item, after) = tokens.split_at(end.map_or(tokens.len(), |end| end + 1));
    if let [.., TokenTree::Ident(word), TokenTree::Ident(name), end] = item
        && word == "mod"
        && is(end, ';')
    {
        tests(name);
    }
    match after {
        [end, after @ ..] if item.last().is_some_and(in_braces) && is(end, ';') => after,
        _ => after,
    }
}

fn is(token: &TokenTree, sign: char) -> bool {
    matches!(token, TokenTree::Punct(punct) if punct.as_char() == sign)
}
