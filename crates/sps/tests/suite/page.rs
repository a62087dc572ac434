//! The page of a report, as a browser lays it out.

use std::fs;

use crate::devtools::Tab;
use crate::support::Scratch;

const PROBE: &str = include_str!("page/probe.js");

#[test]
fn nothing_is_cut_or_missing_at_any_width_light_or_dark() {
    let Some(mut tab) = Tab::open() else { return };
    let scratch = Scratch::after_a_run();
    let page = format!("file://{}", scratch.path("run/report.html").display());
    let files = |folder: &str, ending: &str| {
        let entries = fs::read_dir(scratch.path(folder)).unwrap();
        let paths = entries.map(|entry| entry.unwrap().path());
        let found = paths.filter(|path| path.extension() == Some(ending.as_ref()));
        found.count()
    };
    for scheme in ["light", "dark"] {
        for width in [800, 1300, 1600] {
            tab.show(&page, width, scheme);
            let seen = tab.value(PROBE);
            assert_eq!(tab.problems(), [""; 0], "at {width} pixels, {scheme}");
            assert_eq!(seen["problems"], "", "at {width} pixels, {scheme}");
            assert_eq!(seen["tables"], files("run/tables", "csv"));
            assert_eq!(seen["figures"], files("run/figures", "svg"));
            // Of three surfaces, or two where no more are held out, one view each.
            assert!([2, 3].contains(&seen["pictures"].as_u64().unwrap()));
            assert_eq!(seen["dark"], scheme == "dark");
        }
    }
}
