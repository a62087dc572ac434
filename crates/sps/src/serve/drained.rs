//! Bodies of requests that are refused before all of them has come.

use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::Error;
use axum::body::{Body, Bytes, HttpBody};
use http_body_util::BodyExt;
use hyper::body::{Frame, SizeHint};

/// How long what comes after a refusal is read and thrown away.
const AT_MOST: Duration = Duration::from_secs(2);

/// A body that is read on for a while if it is let go of before its end. A connection that is closed with
/// bytes unread loses the answer on its way to a client that still sends.
pub(super) struct Drained(pub Body);

impl HttpBody for Drained {
    type Data = Bytes;
    type Error = Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Error>>> {
        Pin::new(&mut self.0).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.0.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.0.size_hint()
    }
}

impl Drop for Drained {
    fn drop(&mut self) {
        if self.0.is_end_stream() {
            return;
        }
        let mut rest = std::mem::take(&mut self.0);
        tokio::spawn(tokio::time::timeout(AT_MOST, async move {
            while let Some(Ok(_)) = rest.frame().await {}
        }));
    }
}
