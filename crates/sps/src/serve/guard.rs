//! Which requests are answered.

use std::net::IpAddr;

use axum::extract::Request;
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, StatusCode, header};

use super::failure::Failure;

/// What is shown without a token: the page, which asks for it, and that the service answers.
const OPEN: [&str; 2] = ["/", "/health"];

/// Refuses a request without the token. Where there is none to give, one that a web page of elsewhere has
/// a browser make: under a name that it made lead here, or from its own address.
pub(super) fn check(token: Option<&blake3::Hash>, request: &Request) -> Result<(), Failure> {
    let headers = request.headers();
    match token {
        Some(_) if OPEN.contains(&request.uri().path()) => Ok(()),
        Some(token) => check_token(token, headers),
        None => check_host(headers),
    }
}

/// Whether the request has the token, or there is none to have.
pub(super) fn is_trusted(token: Option<&blake3::Hash>, request: &Request) -> bool {
    token.is_none_or(|token| check_token(token, request.headers()).is_ok())
}

fn check_token(token: &blake3::Hash, headers: &HeaderMap) -> Result<(), Failure> {
    let given = text(headers, &header::AUTHORIZATION);
    let given = given.and_then(|value| value.strip_prefix("Bearer "));
    // Hashes are compared in constant time.
    match given.map(|given| blake3::hash(given.as_bytes())) {
        Some(hash) if hash == *token => Ok(()),
        given => {
            let found = given.map_or("none", |_| "another");
            let message = format!(
                "token: found {found}, expected that of --token-file, as `Authorization: Bearer TOKEN`"
            );
            Err(Failure::new(StatusCode::UNAUTHORIZED, message))
        }
    }
}

fn check_host(headers: &HeaderMap) -> Result<(), Failure> {
    let forbidden = |message| Err(Failure::new(StatusCode::FORBIDDEN, message));
    let host = text(headers, &header::HOST).unwrap_or_default();
    if !is_loopback(host) {
        return forbidden(format!(
            "the header `host`: found `{host}`, expected an address of this machine alone, or a service \
            with --token-file"
        ));
    }
    match text(headers, &header::ORIGIN) {
        Some(origin) if origin.strip_prefix("http://") != Some(host) => forbidden(format!(
            "the header `origin`: found `{origin}`, expected `http://{host}`"
        )),
        _ => Ok(()),
    }
}

fn is_loopback(host: &str) -> bool {
    let Ok(host) = host.parse::<Authority>() else {
        return false;
    };
    let name = host.host().trim_matches(['[', ']']);
    name.eq_ignore_ascii_case("localhost") || name.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

fn text<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Option<&'a str> {
    let value = headers.get(name)?;
    Some(value.to_str().unwrap_or("no ASCII"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_lead_to_this_machine_alone() {
        let hosts = "localhost LOCALHOST:8080 127.0.0.1 127.8.9.1:1 [::1]:8080";
        for host in hosts.split(' ') {
            assert!(is_loopback(host), "{host}");
        }
        let others = "example.org 127.0.0.1.example.org localhost.example.org:80 10.0.0.1 [::2]";
        for host in others.split(' ').chain([""]) {
            assert!(!is_loopback(host), "{host}");
        }
    }
}
