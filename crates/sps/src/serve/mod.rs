//! A model over HTTP.
//!
//! One thread does what waits for the network. What computes runs on threads of its own, as many at once
//! as the pool has threads; a request whose client has left is computed to its end.

mod answers;
mod body;
mod drained;
mod failure;
mod guard;
mod listen;
mod metrics;
mod multipart;
mod query;
mod sessions;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use axum::Router;
use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{Method, StatusCode};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodRouter, get, post};
use sps_estimator::{Estimator, Watch};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use self::answers::Answered;
use self::body::Photograph;
use self::drained::Drained;
use self::failure::Failure;
pub(crate) use self::listen::run;
use self::metrics::Metrics;
use self::sessions::Sessions;

/// What requests may ask for.
pub(crate) struct Settings {
    /// The hash of what requests must name.
    pub token: Option<blake3::Hash>,
    /// Bytes of a body.
    pub max_body: usize,
    /// Pixels of a photograph.
    pub max_pixels: u64,
    /// For a request to come in.
    pub timeout: Duration,
    /// Requests with a body.
    pub at_once: usize,
    /// Photographs are unfamiliar whose p-value is at most this.
    pub unfamiliar: f64,
}

impl Settings {
    /// Pixels of the photographs of a request once they have the size that they are looked at in. An encoder
    /// takes some 200 bytes for each, a photograph that is read to be resized at most 12.
    fn most_looked_at(&self) -> u64 {
        self.max_pixels / 8
    }
}

/// What every request sees.
struct Service {
    model: Arc<Estimator>,
    settings: Settings,
    /// One for each request with a body.
    places: Arc<Semaphore>,
    /// One for each that is worked on.
    turns: Arc<Semaphore>,
    sessions: Sessions,
    metrics: Metrics,
    /// None of a model that keeps nothing to watch by.
    watch: Option<Mutex<Watch<Arc<Estimator>>>>,
}

type Shared = Arc<Service>;

/// What a lock is around, also where a thread that held it has panicked.
fn locked<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Service {
    fn new(model: Estimator, settings: Settings) -> Self {
        let model = Arc::new(model);
        Self {
            watch: Watch::new(model.clone()).ok().map(Mutex::new),
            model,
            places: Arc::new(Semaphore::new(settings.at_once)),
            turns: Arc::new(Semaphore::new(rayon::current_num_threads())),
            sessions: Sessions::default(),
            metrics: Metrics::default(),
            settings,
        }
    }

    /// Lets a request with a body in.
    fn place(&self) -> Result<OwnedSemaphorePermit, Failure> {
        self.places.clone().try_acquire_owned().map_err(|_| {
            let most = self.settings.at_once;
            let message = format!(
                "found {most} requests that are not answered yet, expected fewer: ask again"
            );
            Failure::new(StatusCode::TOO_MANY_REQUESTS, message)
        })
    }

    /// Lets a request in and answers it by its photographs, once it is its turn.
    async fn work(
        self: Shared,
        request: Request,
        answer: impl FnOnce(&Self, &[Photograph]) -> Answered + Send + 'static,
    ) -> Answered {
        let place = self.place()?;
        let photographs = self.photographs(request).await?;
        let turn = self.turns.clone().acquire_owned().await;
        let work = move || {
            let _until_done = (place, turn);
            answer(&self, &photographs)
        };
        let done = tokio::task::spawn_blocking(work).await;
        done.unwrap_or_else(|error| Err(Failure::internal(&error)))
    }
}

/// Every method and path that is answered.
fn routes() -> [(Method, &'static str, MethodRouter<Shared>); 10] {
    [
        (Method::GET, "/", get(answers::page)),
        (Method::GET, "/health", get(answers::health)),
        (Method::GET, "/model", get(answers::model)),
        (Method::GET, "/metrics", get(answers::metrics)),
        (Method::GET, "/openapi.json", get(answers::openapi)),
        (Method::GET, "/surface/{at}", get(answers::surface)),
        (Method::POST, "/predict", post(answers::predict)),
        (Method::POST, "/map", post(answers::map)),
        (Method::POST, "/session", post(sessions::begin)),
        (Method::POST, "/session/{id}", post(sessions::look)),
    ]
}

fn router(service: Shared) -> Router {
    let add = |router: Router<Shared>, (_, path, handler)| router.route(path, handler);
    routes()
        .into_iter()
        .fold(Router::new(), add)
        .fallback(no_route)
        .method_not_allowed_fallback(no_method)
        .layer(from_fn_with_state(service.clone(), enter))
        .with_state(service)
}

/// What every request passes.
async fn enter(State(service): State<Shared>, request: Request, next: Next) -> Response {
    let began = Instant::now();
    let path = request.extensions().get::<MatchedPath>().cloned();
    let in_flight = service.metrics.enter();
    let allowed = guard::check(service.settings.token.as_ref(), &request);
    let request = request.map(|body| Body::new(Drained(body)));
    let response = match allowed {
        Ok(()) => next.run(request).await,
        Err(failure) => failure.into_response(),
    };
    let path = path.as_ref().map_or("other", MatchedPath::as_str);
    in_flight.answered(path, response.status(), began.elapsed());
    response
}

async fn no_route(request: Request) -> Failure {
    let paths: Vec<&str> = routes().iter().map(|(_, path, _)| *path).collect();
    let (found, paths) = (request.uri().path(), paths.join(", "));
    let message = format!("found the path {found}, expected one of {paths}");
    Failure::new(StatusCode::NOT_FOUND, message)
}

async fn no_method(path: MatchedPath, request: Request) -> Failure {
    let routes = routes();
    let (path, found) = (path.as_str(), request.method());
    let known = routes.iter().find(|(_, known, _)| *known == path);
    let expected = known.map_or(Method::GET, |(method, ..)| method.clone());
    let message = format!("{path}: found {found}, expected {expected}");
    Failure::new(StatusCode::METHOD_NOT_ALLOWED, message)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use serde_json::Value;

    use super::*;

    #[test]
    fn every_route_stands_in_the_description() {
        let described: Value = serde_json::from_str(answers::OPENAPI).unwrap();
        let paths = described["paths"].as_object().unwrap().iter();
        let described: BTreeSet<(String, String)> = paths
            .flat_map(|(path, methods)| {
                let methods = methods.as_object().unwrap().keys();
                methods.map(|method| (method.to_uppercase(), path.clone()))
            })
            .collect();
        let answered = routes().map(|(method, path, _)| (method.to_string(), path.to_owned()));
        assert_eq!(described, BTreeSet::from(answered));
    }
}
