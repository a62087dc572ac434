//! The page of a report, as a browser lays it out.

use std::fs;
use std::sync::LazyLock;

use crate::support::{Scratch, browser};

const PROBE: &str = include_str!("page/probe.js");
const WIDTHS: [usize; 3] = [800, 1300, 1600];

/// The report of the tiny experiment, with a probe at its end.
static PROBED: LazyLock<Scratch> = LazyLock::new(|| {
    let scratch = Scratch::new();
    scratch.experiment().assert().success();
    let page = scratch.read("run/report.html");
    let end = page.rfind("</body>").unwrap();
    let probe = format!("<script>{PROBE}</script>");
    let page = [&page[..end], &probe, &page[end..]].concat();
    fs::write(scratch.path("probed.html"), page).unwrap();
    scratch
});

/// What a browser makes of the page.
struct Seen {
    page: String,
    /// What the page's scripts printed, errors among them.
    console: Vec<String>,
}

impl Seen {
    fn of(options: &[&str]) -> Option<Self> {
        let profile = tempfile::tempdir().unwrap();
        let mut command = browser(profile.path())?;
        let address = format!("file://{}", PROBED.path("probed.html").display());
        let output = command.args(options).arg(address).output().unwrap();
        let log = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{log}");
        let console = log.lines().filter(|line| line.contains(":CONSOLE"));
        Some(Self {
            page: String::from_utf8(output.stdout).unwrap(),
            console: console.map(str::to_owned).collect(),
        })
    }

    /// What the probe has put there.
    fn found(&self, name: &str) -> &str {
        let begin = format!(" data-{name}=\"");
        let found = self.page.split_once(&begin).and_then(|(_, rest)| {
            let (value, _) = rest.split_once('"')?;
            Some(value)
        });
        found.unwrap_or_else(|| panic!("the probe did not end: {:?}", self.console))
    }
}

/// The files of a folder of the run that end so.
fn files(folder: &str, ending: &str) -> usize {
    let entries = fs::read_dir(PROBED.path("run").join(folder)).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name());
    names
        .filter(|name| name.to_string_lossy().ends_with(ending))
        .count()
}

#[test]
fn nothing_is_cut_or_missing_at_any_width() {
    for width in WIDTHS {
        let Some(seen) = Seen::of(&[&format!("--window-size={width},1000")]) else {
            return;
        };
        assert_eq!(seen.console, [""; 0], "at {width} pixels");
        assert_eq!(seen.found("problems"), "", "at {width} pixels");
        assert_eq!(seen.found("tables"), files("tables", ".csv").to_string());
        assert_eq!(seen.found("figures"), files("figures", ".svg").to_string());
        // Of three surfaces, or two where no more are held out, one view each.
        assert!(["2", "3"].contains(&seen.found("pictures")));
        assert_eq!(seen.found("dark"), "false");
    }
}

#[test]
fn a_dark_page_is_laid_out_like_a_light_one() {
    let Some(seen) = Seen::of(&["--window-size=1300,1000", "--force-dark-mode"]) else {
        return;
    };
    assert_eq!(seen.console, [""; 0]);
    assert_eq!((seen.found("problems"), seen.found("dark")), ("", "true"));
}
