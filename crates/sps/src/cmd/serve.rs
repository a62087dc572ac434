use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use sps_estimator::Estimator;

use crate::answer;
use crate::serve::{self, Settings};

/// Answer over HTTP, with a page to try a model by
#[derive(clap::Args)]
#[command(
    after_help = "The first line printed is the address. SIGTERM or SIGINT end it once the requests that \
    run are answered; a second one ends it at once.\n\nExamples:\n  sps serve models/friction\n  \
    sps serve models/friction --listen 0.0.0.0:8080 --token-file token.txt"
)]
pub struct Args {
    /// A folder that `fit` wrote
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    /// Where to listen; port 0 takes a free one. Other machines reach it only with --token-file
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8080")]
    listen: SocketAddr,
    /// A file whose one line requests must give as `Authorization: Bearer LINE`
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// The largest body of a request, in MiB
    #[arg(long, value_name = "MIB", default_value = "32", value_parser = clap::value_parser!(u64).range(1..=4096))]
    max_body: u64,
    /// The most pixels of a photograph, by what its header says; those of a request may be looked at in an
    /// eighth of that [default: 2^25]
    #[arg(long, value_name = "N", default_value_t = 1 << 25, hide_default_value = true, value_parser = clap::value_parser!(u64).range(8..))]
    max_pixels: u64,
    /// How long a request may take to come in, and a connection may wait for its next one
    #[arg(long, value_name = "SECONDS", default_value = "30", value_parser = clap::value_parser!(u64).range(1..=86400))]
    timeout: u64,
    /// Requests with a body that are taken in at once; as many are worked on as there are threads
    #[arg(long, value_name = "N", default_value = "32", value_parser = clap::value_parser!(u32).range(1..=65536))]
    at_once: u32,
    /// Call a photograph unfamiliar if at most this share of those like the fitted ones look as strange
    #[arg(long, value_name = "P", default_value = "0.05", value_parser = answer::probability)]
    unfamiliar: f64,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let token = args.token_file.as_deref().map(read_token).transpose()?;
    ensure!(
        token.is_some() || args.listen.ip().is_loopback(),
        "--listen: found {}, expected an address of this machine alone, as 127.0.0.1: whom others may \
        reach needs --token-file",
        args.listen
    );
    let settings = Settings {
        token,
        max_body: (args.max_body << 20) as usize,
        max_pixels: args.max_pixels,
        timeout: Duration::from_secs(args.timeout),
        at_once: args.at_once as usize,
        unfamiliar: args.unfamiliar,
    };
    let model = Estimator::load(&args.model)?;
    answer::check_photographs(&model)?;
    serve::run(model, settings, args.listen)
}

/// What is compared is the token's hash: that takes as long whatever a guess begins with.
fn read_token(path: &Path) -> Result<blake3::Hash> {
    let text =
        fs::read_to_string(path).with_context(|| format!("--token-file {}", path.display()))?;
    let token = text.trim_end();
    let (path, lines, bytes) = (path.display(), token.lines().count(), token.len());
    ensure!(
        !token.is_empty() && token.bytes().all(|byte| byte.is_ascii_graphic()),
        "--token-file {path}: found {lines} lines of {bytes} bytes, expected one line of visible ASCII characters"
    );
    Ok(blake3::hash(token.as_bytes()))
}
