use std::path::Path;

use serde::de::DeserializeOwned;
use sps_base::names::UnknownName;

use crate::DatasetError;
use crate::error::{Fault, Place};
use crate::files::line_of;

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
        let span = error.span();
        let place = span.map_or(Place::File, |span| line_of(text.as_bytes(), span.start));
        let message = error.message();
        let fault = match UnknownName::of_serde(message) {
            Some(unknown) => Fault::invalid(unknown.to_string()),
            None => Fault::malformed("TOML", message.trim_end()),
        };
        fault.at(place).of_file(path)
    })
}
