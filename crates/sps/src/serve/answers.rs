//! What each route answers, but for sessions.

use std::collections::BTreeMap;
use std::path::PathBuf;

use axum::body::Body;
use axum::extract::{Path, Request, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use sps_estimator::{About, Described, Estimator, FittedOn, Scale, Sight};

use super::body::{Photograph, single};
use super::failure::Failure;
use super::{Service, Shared, guard, locked, sessions};
use crate::answer::{self, Line, Said};
use crate::map::Wanted;

pub(super) const OPENAPI: &str = include_str!("openapi.json");
const PAGE: &str = include_str!("page.html");
/// In the page, what marks its own script and style.
const NONCE: &str = "NONCE";

pub(super) type Answered = Result<Response, Failure>;

/// A line of JSON.
pub(super) fn json(status: StatusCode, content: &impl Serialize) -> Answered {
    let text = serde_json::to_string(content).map_err(|error| Failure::internal(&error))?;
    Ok((status, typed("application/json", text + "\n")).into_response())
}

fn typed(media: &'static str, content: impl Into<Body>) -> Response {
    let headers = [
        (header::CONTENT_TYPE, media),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::CACHE_CONTROL, "no-store"),
    ];
    (headers, content.into()).into_response()
}

/// The page, which runs no script but its own and asks nobody but this service.
pub(super) async fn page() -> Response {
    let nonce = sessions::random();
    let policy = format!(
        "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src 'self'; \
        img-src blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    );
    let headers = [
        (header::CONTENT_SECURITY_POLICY, policy),
        (header::REFERRER_POLICY, "no-referrer".to_owned()),
    ];
    let page = typed("text/html; charset=utf-8", PAGE.replace(NONCE, &nonce));
    (headers, page).into_response()
}

/// That it answers and, for those with the token, whether surfaces still look as those of the fit did.
pub(super) async fn health(State(service): State<Shared>, request: Request) -> Answered {
    let trusted = guard::is_trusted(service.settings.token.as_ref(), &request);
    let watch = service.watch.as_ref().filter(|_| trusted).map(|watch| {
        let watch = locked(watch);
        let (seen, evidence, alarm) = (watch.seen(), watch.evidence(), watch.alarm());
        serde_json::json!({ "surfaces": seen, "evidence": evidence, "alarm": alarm })
    });
    let health = serde_json::json!({ "status": "ok", "watch": watch });
    json(StatusCode::OK, &health)
}

pub(super) async fn openapi() -> Response {
    typed("application/json", OPENAPI)
}

pub(super) async fn metrics(State(service): State<Shared>) -> Response {
    let text = service.metrics.text(service.sessions.count());
    typed("text/plain; version=0.0.4; charset=utf-8", text)
}

/// What is known of the model.
#[derive(Serialize)]
struct Model<'a> {
    about: &'a About,
    properties: Vec<Property<'a>>,
    /// The numbers of photographs of a surface that it can be asked with.
    views: Vec<usize>,
    level: f64,
    fitted_on: FittedOn,
    no_interval: BTreeMap<&'a str, &'a str>,
    no_familiar: Option<&'a str>,
    unfamiliar: f64,
    /// Whether `/surface/{at}` has something to show.
    keeps_photographs: bool,
}

#[derive(Serialize)]
struct Property<'a> {
    #[serde(rename = "property")]
    code: &'a str,
    #[serde(flatten)]
    described: Described,
    /// Of the readings that it was fitted on.
    deviation: f64,
}

impl<'a> Model<'a> {
    fn of(model: &'a Estimator, unfamiliar: f64) -> Self {
        let (about, fitted) = (model.about(), model.fitted());
        let properties = fitted.properties().zip(fitted.deviations());
        let properties = properties.map(|(code, deviation)| Property {
            code,
            described: about.describe(code),
            deviation,
        });
        Self {
            about,
            properties: properties.collect(),
            views: fitted.steps().collect(),
            level: fitted.level().get(),
            fitted_on: fitted.fitted_on(),
            no_interval: model.no_interval(),
            no_familiar: fitted.no_familiar(),
            unfamiliar,
            keeps_photographs: model
                .shown(0)
                .is_some_and(|shown| !shown.photograph.is_empty()),
        }
    }
}

pub(super) async fn model(State(service): State<Shared>) -> Answered {
    let model = Model::of(&service.model, service.settings.unfamiliar);
    json(StatusCode::OK, &model)
}

/// All photographs are of one surface, which is called after the first.
pub(super) async fn predict(State(service): State<Shared>, request: Request) -> Answered {
    let scale = service.scale(&request)?;
    let answer = move |service: &Service, photographs: &[Photograph]| {
        let frames = service.decoded(photographs, scale)?;
        let values = service.model.embedder().embed(&frames)?;
        let answer = service.model.predict_embedded(&values, frames.len())?;
        service.watch(&values)?;
        let images = photographs.iter().map(|one| one.name.clone());
        let images: Vec<PathBuf> = images.collect();
        let surface = images.first().map(|name| name.display().to_string());
        let line = Line {
            surface: &surface.unwrap_or_default(),
            images: &images,
            said: Said::new(&service.model, &answer, service.settings.unfamiliar),
        };
        json(StatusCode::OK, &line)
    };
    service.work(request, answer).await
}

impl Service {
    /// Takes the embeddings of a surface's photographs in, the first of them where the model looks at one.
    fn watch(&self, values: &[f32]) -> Result<(), Failure> {
        let views = self.model.about().angles.len() * self.model.embedder().width();
        if let Some((watch, values)) = self.watch.as_ref().zip(values.get(..views)) {
            locked(watch).see(values)?;
        }
        Ok(())
    }

    /// The size that a request wants photographs to have.
    pub(super) fn scale(&self, request: &Request) -> Result<Scale, Failure> {
        let query = self.query(request, &["resize", "keep-size"])?;
        answer::scale(&self.model, query.resize, query.keep_size)
            .map_err(|error| Failure::bad(format!("resize, keep-size: {error:#}")))
    }
}

/// The small photograph that the model keeps of a surface.
pub(super) async fn surface(State(service): State<Shared>, Path(at): Path<usize>) -> Answered {
    let shown = service.model.shown(at);
    let kept = shown.filter(|shown| !shown.photograph.is_empty());
    let shown = kept.ok_or_else(|| {
        let message =
            format!("found no photograph of surface {at}, expected one that the model keeps");
        Failure::new(StatusCode::NOT_FOUND, message)
    })?;
    Ok(typed("image/png", shown.photograph.clone()))
}

pub(super) async fn map(State(service): State<Shared>, request: Request) -> Answered {
    let query = service.query(&request, &["property", "resize"])?;
    let property = query.property.ok_or_else(|| {
        let known: Vec<&str> = service.model.fitted().properties().collect();
        let known = known.join(", ");
        Failure::bad(format!("property: found none, expected one of {known}"))
    })?;
    let unfamiliar = service.settings.unfamiliar;
    let wanted = Wanted::new(&service.model, &property, Sight::Within, unfamiliar)
        .map_err(|error| Failure::bad(format!("{error:#}")))?;
    let accepted = request.headers().get(header::ACCEPT);
    let accepted = accepted.and_then(|value| value.to_str().ok());
    let as_numbers = accepted.is_some_and(|media| media.contains("application/json"));
    let draw = move |service: &Service, photographs: &[Photograph]| {
        let photograph = single(photographs, "one to map")?;
        let resize = query.resize.map(|pixels| pixels as usize);
        let scale = resize.map_or(Scale::Keep, Scale::ShorterSide);
        let frames = service.decoded(photographs, scale)?;
        let mapped = wanted.of(&service.model, &frames[0])?;
        if as_numbers {
            return json(StatusCode::OK, &mapped.numbers(&service.model));
        }
        let picture = mapped.png(&frames[0], &photograph.name);
        let picture = picture.map_err(|error| Failure::internal(&format!("{error:#}")))?;
        Ok(typed("image/png", picture))
    };
    service.work(request, draw).await
}
