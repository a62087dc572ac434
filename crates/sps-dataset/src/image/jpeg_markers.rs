/// What the markers of a whole JPEG say about it.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Markers {
    /// Whether there are stray bytes between segments, which viewers skip.
    pub(super) stray_bytes: bool,
}

const END_OF_IMAGE: u8 = 0xd9;
const START_OF_SCAN: u8 = 0xda;

impl Markers {
    /// Walks from marker to marker up to the end of the image; `None` where the file stops short
    /// of it. Decoders fill what is missing with grey instead.
    pub(super) fn scan(bytes: &[u8]) -> Option<Self> {
        let mut markers = Self { stray_bytes: false };
        let mut at = 2;
        loop {
            if *bytes.get(at)? != 0xff {
                markers.stray_bytes = true;
                at += bytes[at..].iter().position(|&byte| byte == 0xff)?;
            }
            while *bytes.get(at)? == 0xff {
                at += 1;
            }
            let marker = bytes[at];
            at += 1;
            match marker {
                END_OF_IMAGE => return Some(markers),
                // Restart marks, stuffing and the temporary mark stand alone.
                0xd0..=0xd7 | 0x00 | 0x01 => continue,
                _ => {}
            }
            let segment = segment(bytes, at)?;
            at += 2 + segment.len();
            if marker == START_OF_SCAN {
                at = end_of_scan(bytes, at)?;
            }
        }
    }
}

/// The content of the segment whose length stands at `at`.
fn segment(bytes: &[u8], at: usize) -> Option<&[u8]> {
    let length = [*bytes.get(at)?, *bytes.get(at + 1)?];
    bytes.get(at + 2..at + usize::from(u16::from_be_bytes(length)).max(2))
}

/// Where the entropy-coded data that begins at `at` ends: the next mark that is no restart.
fn end_of_scan(bytes: &[u8], mut at: usize) -> Option<usize> {
    loop {
        at += bytes.get(at..)?.iter().position(|&byte| byte == 0xff)?;
        if !matches!(bytes.get(at + 1)?, 0x00 | 0xff | 0xd0..=0xd7) {
            return Some(at);
        }
        at += 1;
    }
}
