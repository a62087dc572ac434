//! The photographs that a request brings.

use std::path::PathBuf;

use axum::body::{Body, Bytes};
use axum::extract::Request;
use axum::http::{StatusCode, header};
use http_body_util::BodyExt;
use sps_dataset::Limits;
use sps_estimator::{Frame, Scale};
use tokio::time::timeout;

use super::Service;
use super::failure::Failure;
use super::multipart::{self, parameter};

/// The field of a form that photographs are in, and what one that comes without a name is called.
const PHOTOGRAPH: &str = "photograph";

/// An image file that is not decoded yet.
pub(super) struct Photograph {
    pub name: PathBuf,
    content: Bytes,
}

impl Service {
    /// The whole body, within the limits of size and time.
    pub(super) async fn body(&self, request: Request) -> Result<Bytes, Failure> {
        let within = self.settings.timeout;
        let whole = collect(request.into_body(), self.settings.max_body);
        timeout(within, whole).await.map_err(|_| {
            let message = format!("a body that is not there after {within:?}, expected it by then");
            Failure::new(StatusCode::REQUEST_TIMEOUT, message)
        })?
    }

    /// The photographs of a body: one, or those of a form.
    pub(super) async fn photographs(&self, request: Request) -> Result<Vec<Photograph>, Failure> {
        let media = request.headers().get(header::CONTENT_TYPE);
        let media = media.map_or(Ok("application/octet-stream"), |value| value.to_str());
        let media = media.unwrap_or("no ASCII").to_owned();
        let (kind, _) = media.split_once(';').unwrap_or((&media, ""));
        match kind.trim().to_ascii_lowercase().as_str() {
            "image/png" | "image/jpeg" | "image/x-exr" | "application/octet-stream" => {
                let content = self.body(request).await?;
                let name = PHOTOGRAPH.into();
                Ok(vec![Photograph { name, content }])
            }
            "multipart/form-data" => {
                let found = parameter(&media, "boundary").filter(|found| !found.is_empty());
                let boundary = found.ok_or_else(|| {
                    let message = "expected a `boundary` in it";
                    Failure::bad(format!("content-type: found `{media}`, {message}"))
                })?;
                let form = self.body(request).await?;
                of_form(&form, &boundary)
            }
            _ => {
                let message = format!(
                    "content-type: found `{media}`, expected image/png, image/jpeg, image/x-exr, \
                    application/octet-stream or multipart/form-data"
                );
                Err(Failure::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, message))
            }
        }
    }

    /// Decodes photographs one after the other. All together have no more pixels, as they are looked at,
    /// than [`Settings::most_looked_at`](super::Settings).
    pub(super) fn decoded(
        &self,
        photographs: &[Photograph],
        scale: Scale,
    ) -> Result<Vec<Frame>, Failure> {
        let mut left = self.settings.most_looked_at();
        let decode = |photograph: &Photograph| {
            let found = |failure: Failure| failure.of(&photograph.name.display().to_string());
            let limits = Limits {
                file_bytes: self.settings.max_body as u64,
                // One that keeps its size need not be decoded to know how large it stays.
                pixels: match scale {
                    Scale::Keep => left,
                    _ => self.settings.max_pixels,
                },
            };
            let frame = self.model.decode(&photograph.content, limits, scale);
            let frame = frame.map_err(|error| found(error.into()))?;
            let pixels = (frame.width * frame.height) as u64;
            left = left.checked_sub(pixels).ok_or_else(|| {
                let message = format!(
                    "has {} x {} pixels once it is resized, expected at most {left}",
                    frame.width, frame.height
                );
                found(Failure::new(StatusCode::PAYLOAD_TOO_LARGE, message))
            })?;
            Ok(frame)
        };
        photographs.iter().map(decode).collect()
    }
}

/// The one photograph that there must be, `expected` in words.
pub(super) fn single<'a>(
    photographs: &'a [Photograph],
    expected: &str,
) -> Result<&'a Photograph, Failure> {
    let [photograph] = photographs else {
        let found = photographs.len();
        let message = format!("found {found} photographs, expected {expected}");
        return Err(Failure::bad(message));
    };
    Ok(photograph)
}

async fn collect(mut body: Body, most: usize) -> Result<Bytes, Failure> {
    let too_large = |found: String| {
        let message = format!("a body of {found} bytes, expected at most {most}");
        Failure::new(StatusCode::PAYLOAD_TOO_LARGE, message)
    };
    let declared = axum::body::HttpBody::size_hint(&body).lower();
    if declared > most as u64 {
        return Err(too_large(declared.to_string()));
    }
    let mut whole = Vec::with_capacity(declared as usize);
    while let Some(frame) = body.frame().await {
        let frame =
            frame.map_err(|error| Failure::bad(format!("a body that ends early: {error}")))?;
        let data = frame.into_data().unwrap_or_default();
        if data.len() > most - whole.len() {
            return Err(too_large(format!("more than {most}")));
        }
        whole.extend_from_slice(&data);
    }
    Ok(whole.into())
}

fn of_form(form: &Bytes, boundary: &str) -> Result<Vec<Photograph>, Failure> {
    let parts = multipart::parts(form, boundary)
        .map_err(|problem| Failure::bad(format!("multipart/form-data: found {problem}")))?;
    let photograph = |part: multipart::Part| {
        if part.field != PHOTOGRAPH {
            let message = format!(
                "multipart/form-data: found the part `{}`, expected `{PHOTOGRAPH}`",
                part.field
            );
            return Err(Failure::bad(message));
        }
        let name = part.file_name.filter(|name| !name.is_empty());
        Ok(Photograph {
            name: name.map_or_else(|| PHOTOGRAPH.into(), PathBuf::from),
            content: part.content,
        })
    };
    parts.into_iter().map(photograph).collect()
}
