//! What a request asks for behind the `?`.

use std::num::NonZeroU64;

use axum::extract::Request;
use axum::http::StatusCode;
use sps_base::names::UnknownName;

use super::Service;
use super::failure::Failure;

/// Which size photographs are looked at in, and which property is mapped.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Query {
    pub resize: Option<u64>,
    pub keep_size: bool,
    pub property: Option<String>,
}

impl Service {
    /// What is asked for by some of `known` keys.
    pub(super) fn query(&self, request: &Request, known: &[&str]) -> Result<Query, Failure> {
        let query = Query::parse(request.uri().query().unwrap_or_default(), known)?;
        let (pixels, most) = (query.resize.unwrap_or(0), self.settings.most_looked_at());
        if pixels.saturating_mul(pixels) > most {
            let message = format!("resize: found {pixels}, expected at most {most} pixels in all");
            return Err(Failure::new(StatusCode::PAYLOAD_TOO_LARGE, message));
        }
        Ok(query)
    }
}

impl Query {
    fn parse(text: &str, known: &[&str]) -> Result<Self, Failure> {
        let mut query = Self::default();
        for (key, value) in form_urlencoded::parse(text.as_bytes()) {
            let expected = |what| Failure::bad(format!("{key}: found `{value}`, expected {what}"));
            match (key.as_ref(), value.as_ref()) {
                (key, _) if !known.contains(&key) => {
                    let error = UnknownName::new("parameter", key, known.iter().copied());
                    return Err(Failure::bad(error.to_string()));
                }
                ("resize", value) => {
                    let pixels = value.parse::<NonZeroU64>();
                    let pixels = pixels.map_err(|_| expected("pixels, at least 1"))?;
                    query.resize = Some(pixels.get());
                }
                ("keep-size", "" | "true") => query.keep_size = true,
                ("keep-size", _) => return Err(expected("no value")),
                (_, value) => query.property = Some(value.to_owned()),
            }
        }
        if query.resize.is_some() && query.keep_size {
            return Err(Failure::bad(
                "found `resize` and `keep-size`, expected one of them",
            ));
        }
        Ok(query)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: [&str; 3] = ["resize", "keep-size", "property"];

    #[test]
    fn keys_and_values() {
        let parse = |text| Query::parse(text, &KNOWN).unwrap();
        assert_eq!(parse(""), Query::default());
        assert!(parse("keep-size").keep_size);
        let query = parse("property=f%52S&resize=64");
        assert_eq!(query.property.as_deref(), Some("fRS"));
        assert_eq!(query.resize, Some(64));
        let refused = "resize=0 resize= resize=-1 keep-size=no size=3 resize=1&keep-size";
        for text in refused.split(' ') {
            assert!(Query::parse(text, &KNOWN).is_err(), "{text}");
        }
    }
}
