//! One HTTP request over a Unix socket, and its response.

use http_body_util::{BodyExt, Full, Limited};
use hyper::body::{Bytes, Incoming};
use hyper::client::conn::http1;
use hyper::header::{CONTENT_TYPE, HOST, IF_MATCH};
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use railbus_api::fleet::TRANSIT_HEADER;
use railbus_api::problem::{Problem, codes};
use std::path::Path;
use std::time::Duration;
use tokio::net::UnixStream;

/// Maximum size of a response.
const ANSWER_MAX: usize = 8 << 20;
/// Maximum length of a line in a stream.
const LINE_MAX: usize = 64 << 10;
/// Timeout of the daemon: commands live 5 s, and pulses begin within that.
const PATIENCE: Duration = Duration::from_secs(30);

/// A response whose head has arrived.
pub(super) struct Answer {
    response: Response<Incoming>,
    /// The request was not just a query: without its response the result is unknown.
    acts: bool,
}

/// A response stream, line by line.
#[derive(Debug)]
pub(super) struct Lines {
    body: Incoming,
    buffer: Vec<u8>,
}

/// A request.
pub(super) struct Asked<'a> {
    pub(super) method: Method,
    pub(super) path: &'a str,
    pub(super) body: Vec<u8>,
    /// The `If-Match` of the content to be changed.
    pub(super) seen: Option<String>,
    /// The `Idempotency-Key` of a command.
    pub(super) key: Option<&'a str>,
}

/// Sends the request, and waits for the head of the response.
pub(super) async fn send(
    socket: &Path,
    method: Method,
    path: &str,
    body: Vec<u8>,
) -> Result<Answer, Problem> {
    let asked = Asked {
        method,
        path,
        body,
        seen: None,
        key: None,
    };
    send_asked(socket, asked).await
}

/// The same for a request in parts.
pub(super) async fn send_asked(socket: &Path, asked: Asked<'_>) -> Result<Answer, Problem> {
    let failed = |reason: String| {
        let problem = Problem::new(codes::DAEMON).with("reason", reason);
        problem.with("socket", socket.display().to_string())
    };
    let acts = asked.method != Method::GET;
    let stream = UnixStream::connect(socket).await;
    let stream = stream.map_err(|error| failed(error.to_string()))?;
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream))
        .await
        .map_err(|error| failed(error.to_string()))?;
    // Ends with the response body, or with the daemon.
    tokio::spawn(connection);
    let request = Request::builder()
        .method(asked.method)
        .uri(asked.path)
        .header(HOST, "localhost")
        .header(CONTENT_TYPE, "application/json");
    let request = match asked.seen {
        Some(mark) => request.header(IF_MATCH, format!("\"{mark}\"")),
        None => request,
    };
    let request = match asked.key {
        Some(key) => request.header("idempotency-key", key),
        None => request,
    };
    let request = request
        .body(Full::new(Bytes::from(asked.body)))
        .map_err(|error| failed(error.to_string()))?;
    match tokio::time::timeout(PATIENCE, sender.send_request(request)).await {
        Ok(Ok(response)) => Ok(Answer { response, acts }),
        Ok(Err(error)) => Err(failed(error.to_string()).perhaps_acted(acts)),
        Err(_) => Err(failed("no answer within 30 s".to_owned()).perhaps_acted(acts)),
    }
}

impl Answer {
    /// How long it was on its way from a site to the centre of its fleet, in milliseconds.
    pub(super) fn transit_ms(&self) -> Option<u64> {
        let header = self.response.headers().get(TRANSIT_HEADER)?;
        header.to_str().ok()?.parse().ok()
    }

    /// The request was not just a query.
    pub(super) const fn acts(&self) -> bool {
        self.acts
    }

    /// The whole body; an error if the daemon reports a problem.
    pub(super) async fn whole(self) -> Result<Bytes, Problem> {
        let status = self.response.status();
        let acts = self.acts;
        let failed = |reason: String| {
            let problem = Problem::new(codes::DAEMON).with("reason", reason);
            problem.perhaps_acted(acts)
        };
        let body = Limited::new(self.response.into_body(), ANSWER_MAX);
        let body = body.collect().await;
        let body = body.map_err(|error| failed(error.to_string()))?.to_bytes();
        if status.is_success() {
            return Ok(body);
        }
        let told = serde_json::from_slice(&body);
        Err(told.unwrap_or_else(|_| match status {
            StatusCode::NOT_FOUND => Problem::new(codes::NO_SUCH_PAGE),
            _ => failed(format!("HTTP status {status}")),
        }))
    }

    /// The body line by line; an error if the daemon reports a problem.
    pub(super) async fn lines(self) -> Result<Lines, Problem> {
        if !self.response.status().is_success() {
            return Err(match self.whole().await {
                Err(problem) => problem,
                Ok(_) => Problem::new(codes::DAEMON),
            });
        }
        Ok(Lines {
            body: self.response.into_body(),
            buffer: Vec::new(),
        })
    }
}

impl Lines {
    /// The next line; `None` at the end.
    pub(super) async fn next(&mut self) -> Option<Result<String, Problem>> {
        let failed = |reason: String| Problem::new(codes::DAEMON).with("reason", reason);
        loop {
            if let Some(at) = self.buffer.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = self.buffer.drain(..=at).collect();
                return Some(Ok(String::from_utf8_lossy(&line).trim().to_owned()));
            }
            if self.buffer.len() > LINE_MAX {
                return Some(Err(failed("a line without an end".to_owned())));
            }
            match self.body.frame().await? {
                Ok(frame) => {
                    let data = frame.into_data().unwrap_or_default();
                    self.buffer.extend_from_slice(&data);
                }
                Err(error) => return Some(Err(failed(error.to_string()))),
            }
        }
    }
}
