use std::path::Path;

use serde::de::DeserializeOwned;

use crate::{DatasetError, DatasetErrorKind, Place, UnknownName};

/// Reads a TOML text into `T`; an error names the line and, for an unknown key, the nearest valid
/// one.
///
/// `path` is only for the message. Works for any config that denies unknown fields, so that a
/// runner can read its own the same way.
///
/// # Errors
/// Where the text is not TOML or does not fit `T`.
///
/// ```
/// use std::path::Path;
///
/// #[derive(Debug, serde::Deserialize)]
/// #[serde(rename_all = "kebab-case", deny_unknown_fields)]
/// struct Config {
///     image_size: u32,
/// }
///
/// let error = sps_dataset::parse_toml::<Config>(Path::new("run.toml"), "# size\nimage-sise = 8");
/// assert_eq!(
///     error.unwrap_err().to_string(),
///     "run.toml, line 2: unknown key `image-sise`, did you mean `image-size`? \
///      Expected one of `image-size`",
/// );
/// ```
pub fn parse_toml<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, DatasetError> {
    toml::from_str(text).map_err(|error| {
        let place = error
            .span()
            .map_or(Place::File, |span| Place::Line(line_of(text, span.start)));
        DatasetError::new(path, place, kind_of(error.message()))
    })
}

fn line_of(text: &str, byte: usize) -> u64 {
    let before = text.as_bytes().iter().take(byte);
    1 + before.filter(|&&byte| byte == b'\n').count() as u64
}

fn kind_of(message: &str) -> DatasetErrorKind {
    UnknownName::of_serde(message).map_or_else(
        || DatasetErrorKind::Malformed {
            format: "TOML",
            reason: message.trim_end().to_owned(),
        },
        DatasetErrorKind::UnknownName,
    )
}
