//! Where a page has measured numbers.

use std::ops::Range;

/// What stands between markers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// A table or a paragraph.
    Block,
    /// A number within a sentence.
    Inline,
}

/// An opening marker with what stands between it and the one that closes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Marker {
    /// From 1 on.
    pub line: usize,
    pub form: Form,
    /// What the marker asks for.
    pub words: String,
    /// Of the page, in bytes.
    pub inner: Range<usize>,
}

const FORMS: [(Form, &str, &str); 2] = [
    (Form::Block, "measured:", "/measured"),
    (Form::Inline, "value:", "/value"),
];
const OPEN: &str = "<!-- ";
const CLOSE: &str = "-->";

/// The markers of a page, and lines with what is wrong there.
pub(super) fn markers(text: &str) -> (Vec<Marker>, Vec<(usize, String)>) {
    let text = without_code(text);
    let (mut found, mut problems) = (Vec::new(), Vec::new());
    let mut at = 0;
    while let Some((start, comment)) = next_comment(&text, at) {
        at = start + OPEN.len() + comment.len() + CLOSE.len();
        let line = 1 + text[..start].matches('\n').count();
        let comment = comment.trim();
        if let Some((_, _, stray)) = FORMS.iter().find(|(_, _, closing)| *closing == comment) {
            problems.push((line, format!("`{stray}` closes nothing")));
        }
        let opened = FORMS.iter().find_map(|&(form, opening, closing)| {
            Some((form, comment.strip_prefix(opening)?.trim(), closing))
        });
        let Some((form, words, closing)) = opened else {
            continue;
        };
        match until(&text, at, closing) {
            Some(end) => {
                found.push(Marker {
                    line,
                    form,
                    words: words.to_owned(),
                    inner: at..end,
                });
                at = end + OPEN.len() + closing.len() + 1 + CLOSE.len();
            }
            None => problems.push((line, format!("`{words}` has no `{OPEN}{closing} {CLOSE}`"))),
        }
    }
    (found, problems)
}

/// The next comment from a byte on, with its start.
fn next_comment(text: &str, at: usize) -> Option<(usize, &str)> {
    let start = at + text[at..].find(OPEN)?;
    let inside = &text[start + OPEN.len()..];
    Some((start, &inside[..inside.find(CLOSE)?]))
}

/// Where the closing marker begins; `None` where another marker comes before.
fn until(text: &str, from: usize, closing: &str) -> Option<usize> {
    let rest = &text[from..];
    let length = rest.find(&format!("{OPEN}{closing} {CLOSE}"))?;
    let between = &rest[..length];
    let other = |&(_, opening, closing): &(Form, &str, &str)| {
        between.contains(&format!("{OPEN}{opening}"))
            || between.contains(&format!("{OPEN}{closing}"))
    };
    (!FORMS.iter().any(other)).then_some(from + length)
}

/// The page with as many spaces in place of each byte of code, which may show markers.
fn without_code(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut fenced = false;
    for line in text.split_inclusive('\n') {
        let fence = line.trim_start().starts_with("```");
        if fenced || fence {
            blank(line, &mut out);
        } else {
            let spans: Vec<&str> = line.split('`').collect();
            for (place, span) in spans.iter().enumerate() {
                // A lone backtick opens nothing.
                let code = place % 2 == 1 && place + 1 < spans.len();
                if code {
                    blank(span, &mut out);
                } else {
                    out.push_str(span);
                }
                if place + 1 < spans.len() {
                    out.push('`');
                }
            }
        }
        fenced ^= fence;
    }
    out
}

fn blank(text: &str, out: &mut String) {
    for char in text.chars() {
        match char {
            '\n' => out.push('\n'),
            other => out.extend(std::iter::repeat_n(' ', other.len_utf8())),
        }
    }
}
