//! Connections, and the end of the service.

use std::io::{self, Write};
use std::net::SocketAddr;
use std::sync::Arc;
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

/// Connections at once; more wait until one ends. Each takes a file descriptor, of which a process
/// commonly has 1024.
const CONNECTIONS: usize = 512;
/// Until a connection is asked for again where there were no descriptors left.
const PAUSE: Duration = Duration::from_millis(50);

/// Serves until the process is told to end.
pub(crate) fn run(model: Estimator, settings: Settings, address: SocketAddr) -> Result<()> {
    keep_on_closed_connections();
    let runtime = runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    runtime.block_on(serve(model, settings, address))
}

async fn serve(model: Estimator, settings: Settings, address: SocketAddr) -> Result<()> {
    let mut signals = Signals::new()?;
    let listener = TcpListener::bind(address)
        .await
        .with_context(|| format!("--listen {address}"))?;
    let bound = listener.local_addr()?;
    writeln!(io::stdout(), "http://{bound}")?;
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new())
        .header_read_timeout(settings.timeout);
    let app = router(Arc::new(Service::new(model, settings)));
    let watched = Arc::new(GracefulShutdown::new());
    let accepting = tokio::spawn(accept(listener, http, app, watched.clone()));
    signals.next().await;
    accepting.abort();
    let _ = accepting.await;
    tokio::spawn(async move {
        signals.next().await;
        std::process::exit(1);
    });
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

/// What tells the process to end.
#[cfg(unix)]
struct Signals([tokio::signal::unix::Signal; 2]);

#[cfg(unix)]
impl Signals {
    fn new() -> Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self([
            signal(SignalKind::terminate())?,
            signal(SignalKind::interrupt())?,
        ]))
    }

    async fn next(&mut self) {
        std::future::poll_fn(|context| {
            let mut polled = self.0.iter_mut().map(|signal| signal.poll_recv(context));
            // Each is polled, so that each wakes.
            let ready = polled.by_ref().filter(std::task::Poll::is_ready).count();
            if ready > 0 {
                std::task::Poll::Ready(())
            } else {
                std::task::Poll::Pending
            }
        })
        .await;
    }
}

/// What tells the process to end.
#[cfg(not(unix))]
struct Signals;

#[cfg(not(unix))]
impl Signals {
    fn new() -> Result<Self> {
        Ok(Self)
    }

    async fn next(&mut self) {
        let _ = tokio::signal::ctrl_c().await;
    }
}

/// Undoes for connections what commands want of pipes: a client that leaves ends no service.
fn keep_on_closed_connections() {
    #[cfg(unix)]
    #[expect(
        unsafe_code,
        reason = "the standard library has no way to ignore a signal"
    )]
    // SAFETY: to ignore a signal is no handler that could run at a wrong time.
    unsafe {
        libc::signal(libc::SIGPIPE, libc::SIG_IGN);
    }
}
