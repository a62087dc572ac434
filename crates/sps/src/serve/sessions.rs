//! One photograph after the other, over several requests.

use std::collections::{BTreeMap, VecDeque};
use std::hash::{BuildHasher, RandomState};
use std::sync::{Arc, Mutex};

use axum::extract::{Path, Request, State};
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use sps_estimator::{Estimator, Session};

use super::answers::{Answered, json};
use super::body::{Photograph, single};
use super::failure::Failure;
use super::{Service, Shared, locked};
use crate::answer::Said;

/// Sessions that are kept. Where one more begins, the one goes whose last photograph, or beginning, lies
/// back longest.
const MOST: usize = 64;

type Kept = Arc<Mutex<Session<Arc<Estimator>>>>;

/// By their names; what was used last is last.
#[derive(Default)]
pub(super) struct Sessions(Mutex<VecDeque<(String, Kept)>>);

impl Sessions {
    pub(super) fn count(&self) -> usize {
        locked(&self.0).len()
    }

    fn add(&self, session: Session<Arc<Estimator>>) -> String {
        let name = random();
        let mut kept = locked(&self.0);
        if kept.len() == MOST {
            kept.pop_front();
        }
        kept.push_back((name.clone(), Arc::new(Mutex::new(session))));
        name
    }

    fn find(&self, name: &str) -> Option<Kept> {
        let mut kept = locked(&self.0);
        let at = kept.iter().position(|(known, _)| known == name)?;
        let found = kept.remove(at)?;
        let session = found.1.clone();
        kept.push_back(found);
        Some(session)
    }
}

/// 128 bits that nobody guesses: the standard library keys each of its hashers at random.
pub(super) fn random() -> String {
    let half = || RandomState::new().hash_one(());
    format!("{:016x}{:016x}", half(), half())
}

/// Intervals no wider than so many standard deviations of the readings that the model was fitted on.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Wanted {
    width: f64,
}

pub(super) async fn begin(State(service): State<Shared>, request: Request) -> Answered {
    let _place = service.place()?;
    let body = service.body(request).await?;
    let wanted: Wanted = serde_json::from_slice(&body)
        .map_err(|error| Failure::bad(format!("{error}; expected JSON as {{\"width\": 2.0}}")))?;
    let session = Session::new(service.model.clone(), wanted.width)?;
    let next = session.next_angle();
    let id = service.sessions.add(session);
    let begun = serde_json::json!({ "id": id, "next": next });
    json(StatusCode::CREATED, &begun)
}

/// What is known after a photograph.
#[derive(Serialize)]
struct Known<'a> {
    /// The photographs so far.
    views: usize,
    /// The roll angle to look from next, in degrees.
    next: Option<f64>,
    /// By property, whether its interval is as narrow as asked.
    narrow: BTreeMap<&'a str, bool>,
    #[serde(flatten)]
    said: Said<'a>,
}

pub(super) async fn look(
    State(service): State<Shared>,
    Path(id): Path<String>,
    request: Request,
) -> Answered {
    let scale = service.scale(&request)?;
    let session = service.sessions.find(&id).ok_or_else(|| {
        let message = format!("found no session `{id}`, expected one of the last {MOST}");
        Failure::new(StatusCode::NOT_FOUND, message)
    })?;
    let look = move |service: &Service, photographs: &[Photograph]| {
        single(photographs, "one at a time")?;
        let frames = service.decoded(photographs, scale)?;
        let mut session = session.lock().map_err(|error| Failure::internal(&error))?;
        if session.next_angle().is_none() {
            let message = "found a photograph more, expected none: the session is over";
            return Err(Failure::new(StatusCode::CONFLICT, message));
        }
        let looked = session.look(&frames[0])?;
        let fitted = service.model.fitted();
        let known = Known {
            views: looked.views,
            next: looked.next,
            narrow: fitted.properties().zip(looked.narrow).collect(),
            said: Said::new(&service.model, &looked.answer, service.settings.unfamiliar),
        };
        json(StatusCode::OK, &known)
    };
    service.work(request, look).await
}
