//! The parts of a form, RFC 7578.

use axum::body::Bytes;
use memchr::memmem;

/// A part of a form.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Part {
    /// The field that it fills.
    pub field: String,
    pub file_name: Option<String>,
    pub content: Bytes,
}

/// The parts of a form whose parts lie between boundaries; else what is wrong with it.
pub(super) fn parts(form: &Bytes, boundary: &str) -> Result<Vec<Part>, String> {
    let delimiter = format!("--{boundary}");
    let between = format!("\r\n{delimiter}");
    let first = form.strip_prefix(delimiter.as_bytes());
    let first = first.or_else(|| Some(parted(form, &between)?.1));
    let mut rest = first.ok_or("no boundary")?;
    let mut parts = Vec::new();
    while !rest.starts_with(b"--") {
        let (padding, part) = parted(rest, "\r\n").ok_or("an end within a boundary")?;
        if !padding.iter().all(|byte| b" \t".contains(byte)) {
            return Err("text after a boundary".to_owned());
        }
        let number = parts.len() + 1;
        let wrong = |what: &str| format!("{what} part {number}");
        let head = parted(part, "\r\n\r\n");
        let (head, part) = head.ok_or_else(|| wrong("an end within the head of"))?;
        let content = parted(part, &between);
        let (content, after) = content.ok_or_else(|| wrong("an end within"))?;
        let names = names(&String::from_utf8_lossy(head));
        let (field, file_name) = names.ok_or_else(|| wrong("no `name` in the head of"))?;
        parts.push(Part {
            field,
            file_name,
            content: form.slice_ref(content),
        });
        rest = after;
    }
    Ok(parts)
}

/// What is before and behind the first `separator`.
fn parted<'a>(bytes: &'a [u8], separator: &str) -> Option<(&'a [u8], &'a [u8])> {
    let at = memmem::find(bytes, separator.as_bytes())?;
    Some((&bytes[..at], &bytes[at + separator.len()..]))
}

/// The names of the field and of the file that the head of a part gives.
fn names(head: &str) -> Option<(String, Option<String>)> {
    let disposition = head.split("\r\n").find_map(|line| {
        let (name, value) = line.split_once(':')?;
        let wanted = name.trim().eq_ignore_ascii_case("content-disposition");
        wanted.then_some(value)
    })?;
    Some((
        parameter(disposition, "name")?,
        parameter(disposition, "filename"),
    ))
}

/// A parameter of a header, as in `form-data; name="photograph"`.
pub(super) fn parameter(header: &str, wanted: &str) -> Option<String> {
    let (_, mut rest) = header.split_once(';')?;
    loop {
        let (name, after) = rest.split_once('=')?;
        let (value, after) = if let Some(quoted) = after.trim_start().strip_prefix('"') {
            unquoted(quoted)?
        } else {
            let end = after.find(';').unwrap_or(after.len());
            (after[..end].trim().to_owned(), &after[end..])
        };
        if name.trim().eq_ignore_ascii_case(wanted) {
            return Some(value);
        }
        rest = after.trim_start().strip_prefix(';')?;
    }
}

/// A text up to its closing quote, and what is behind. A quote within is escaped by a backslash or, by
/// browsers, as %22; other backslashes are those of a file name.
fn unquoted(text: &str) -> Option<(String, &str)> {
    let mut value = String::new();
    let mut letters = text.char_indices().peekable();
    while let Some((at, letter)) = letters.next() {
        match letter {
            '"' => return Some((value.replace("%22", "\""), &text[at + 1..])),
            '\\' => {
                let escaped = letters.next_if(|(_, next)| ['"', '\\'].contains(next));
                value.push(escaped.map_or('\\', |(_, escaped)| escaped));
            }
            letter => value.push(letter),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(form: &str) -> Result<Vec<(String, Option<String>, String)>, String> {
        let parts = parts(&Bytes::from(form.to_owned()), "b")?.into_iter();
        let shown = |part: Part| {
            let content = String::from_utf8_lossy(&part.content).into_owned();
            (part.field, part.file_name, content)
        };
        Ok(parts.map(shown).collect())
    }

    /// The form of RFC 7578, section 4, as `curl -F` and browsers write it, with what RFC 2046 permits around it.
    #[test]
    fn parts_lie_between_boundaries() {
        let form = "before\r\n--b \t\r\nContent-Disposition: form-data; name=\"photograph\"; \
            filename=\"a;b \\\"1\\\".png\"\r\nContent-Type: image/png\r\n\r\nx\r\n--c\r\n\r\n--b\r\n\
            content-type: text/plain\r\ncontent-disposition:form-data;filename*=UTF-8''c;name=width\r\n\r\n\
            \r\n--b--\r\nafter";
        let part = |field: &str, file: Option<&str>, content: &str| {
            let file = file.map(str::to_owned);
            (field.to_owned(), file, content.to_owned())
        };
        let file = Some("a;b \"1\".png");
        let first = part("photograph", file, "x\r\n--c\r\n");
        assert_eq!(found(form), Ok(vec![first, part("width", None, "")]));
        assert_eq!(found("--b--"), Ok(Vec::new()));
    }

    #[test]
    fn damaged_forms_are_refused() {
        let head = "--b\r\nContent-Disposition: form-data; name=\"p\"\r\n\r\n";
        let nameless = "no `name` in the head of part 1";
        for (form, reason) in [
            (String::new(), "no boundary"),
            ("--c--".to_owned(), "no boundary"),
            ("--b".to_owned(), "an end within a boundary"),
            ("--bc\r\n".to_owned(), "text after a boundary"),
            (head[..30].to_owned(), "an end within the head of part 1"),
            (format!("{head}x"), "an end within part 1"),
            (head.replace("name", "no") + "x\r\n--b--", nameless),
            (head.replace("p\"", "p") + "x\r\n--b--", nameless),
        ] {
            assert_eq!(found(&form), Err(reason.to_owned()), "{form:?}");
        }
    }
}
