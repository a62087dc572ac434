//! Connections, and the end of the service.

use std::io::{self, Write};
use std::net::SocketAddr;
use std::sync::Arc;
#[cfg(unix)]
use std::task::Poll;
use std::time::Duration;

use anyhow::{Context, Result};
use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use sps_estimator::Estimator;
use tokio::net::TcpListener;
use tokio::runtime;
use tokio::sync::Semaphore;

use super::{Service, Settings, router};
use crate::end_on_closed_pipes;

/// Connections at once; more wait until one ends. Each takes a file descriptor, of which a process commonly has 1024.
const CONNECTIONS: usize = 512;
/// Until a connection is asked for again where there were no descriptors left.
const PAUSE: Duration = Duration::from_millis(50);

/// Serves until the process is told to end.
pub(crate) fn run(model: Estimator, settings: Settings, address: SocketAddr) -> Result<()> {
    // A client that leaves ends no service.
    end_on_closed_pipes(false);
    let runtime = runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    runtime.block_on(serve(model, settings, address))
}

async fn serve(model: Estimator, settings: Settings, address: SocketAddr) -> Result<()> {
    let told = told_to_end()?;
    let listener = TcpListener::bind(address).await;
    let listener = listener.with_context(|| format!("--listen {address}"))?;
    let bound = listener.local_addr()?;
    writeln!(io::stdout(), "http://{bound}")?;
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new())
        .header_read_timeout(settings.timeout);
    let app = router(Arc::new(Service::new(model, settings)));
    let watched = Arc::new(GracefulShutdown::new());
    let accepting = tokio::spawn(accept(listener, http, app, watched.clone()));
    told.await;
    // Answers are finished even where a second signal, which ends at once, cannot be listened for.
    if let Ok(again) = told_to_end() {
        tokio::spawn(async move {
            again.await;
            std::process::exit(1);
        });
    }
    accepting.abort();
    let _ = accepting.await;
    // Nothing else holds it once no more connections come.
    if let Some(connections) = Arc::into_inner(watched) {
        connections.shutdown().await;
    }
    Ok(())
}

async fn accept(
    listener: TcpListener,
    http: http1::Builder,
    app: Router,
    watched: Arc<GracefulShutdown>,
) {
    let places = Arc::new(Semaphore::new(CONNECTIONS));
    loop {
        let place = places.clone().acquire_owned().await;
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        let _ = stream.set_nodelay(true);
        let service = TowerToHyperService::new(app.clone());
        let connection = watched.watch(http.serve_connection(TokioIo::new(stream), service));
        tokio::spawn(async move {
            let _until_closed = place;
            // One connection's error does not concern the others.
            let _ = connection.await;
        });
    }
}

/// Waits until the process is told to end after this call.
#[cfg(unix)]
fn told_to_end() -> io::Result<impl Future<Output = ()>> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate())?;
    let mut interrupt = signal(SignalKind::interrupt())?;
    Ok(std::future::poll_fn(move |context| {
        // Both are polled, so that each wakes.
        match (terminate.poll_recv(context), interrupt.poll_recv(context)) {
            (Poll::Pending, Poll::Pending) => Poll::Pending,
            _ => Poll::Ready(()),
        }
    }))
}

#[cfg(not(unix))]
fn told_to_end() -> io::Result<impl Future<Output = ()>> {
    Ok(async {
        let _ = tokio::signal::ctrl_c().await;
    })
}
