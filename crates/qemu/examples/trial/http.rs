//! The daemon, asked over its socket.

use crate::site::said;
use http_body_util::{BodyExt, Full};
use hyper::Request;
use hyper::body::Bytes;
use hyper::client::conn::http1;
use hyper::header::{CONTENT_TYPE, HOST};
use hyper_util::rt::TokioIo;
use std::path::Path;
use std::time::Duration;
use tokio::net::UnixStream;

/// So long an answer may take; a command lives for 5 s.
const PATIENCE: Duration = Duration::from_secs(120);

/// What is asked.
pub(crate) struct Ask {
    pub(crate) method: &'static str,
    pub(crate) path: String,
    /// JSON, or nothing.
    pub(crate) body: String,
}

/// What is looked at.
pub(crate) fn get(path: &str) -> Ask {
    Ask {
        method: "GET",
        path: path.to_owned(),
        body: String::new(),
    }
}

/// Status and body of the one answer that there is.
pub(crate) fn ask(socket: &Path, ask: &Ask) -> Result<(u16, String), String> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build();
    runtime.map_err(said)?.block_on(async {
        match tokio::time::timeout(PATIENCE, exchange(socket, ask)).await {
            Ok(answer) => answer,
            Err(_) => Err(format!("{} {}: no answer comes", ask.method, ask.path)),
        }
    })
}

async fn exchange(socket: &Path, ask: &Ask) -> Result<(u16, String), String> {
    let stream = UnixStream::connect(socket).await.map_err(said)?;
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await.map_err(said)?;
    // Ends with the answer.
    tokio::spawn(connection);
    let request = Request::builder()
        .method(ask.method)
        .uri(&ask.path)
        .header(HOST, "railbus")
        .header(CONTENT_TYPE, "application/json")
        .body(Full::new(Bytes::from(ask.body.clone())))
        .map_err(said)?;
    let response = sender.send_request(request).await.map_err(said)?;
    let status = response.status().as_u16();
    let body = response.into_body().collect().await.map_err(said)?;
    Ok((
        status,
        String::from_utf8_lossy(&body.to_bytes()).into_owned(),
    ))
}
