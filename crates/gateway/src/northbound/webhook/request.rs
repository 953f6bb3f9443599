//! One event on its way: a POST, signed where there is a secret, over TLS where the address says
//! so. No redirect is followed: an event goes where the configuration says, or nowhere.

use super::target;
use crate::access::secret::{Secret, hex};
use hmac::{Hmac, KeyInit, Mac};
use http_body_util::Full;
use hyper::body::Bytes;
use hyper::client::conn::http1;
use hyper::header::{CONNECTION, CONTENT_TYPE, HOST, RETRY_AFTER, USER_AGENT};
use hyper::{Request, Uri};
use hyper_util::rt::TokioIo;
use jiff::Timestamp;
use railbus_api::problem::{Problem, codes};
use rustls::pki_types::ServerName;
use rustls::{ClientConfig, RootCertStore};
use sha2::Sha256;
use std::pin::pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;

/// How long a delivery may take, from the look for the receiver to the head of its answer.
pub(super) const LIMIT: Duration = Duration::from_secs(10);
/// The longest head of an answer. Nothing behind it is read.
const HEAD_MAX: usize = 16 << 10;

/// Why an event was not taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Failed {
    /// There was no connection, or it ended without an answer.
    Unreached(String),
    /// The name leads to this machine or its link, which the owner does not allow.
    Inner(String, u16),
    /// There was no connection to be trusted.
    Tls(String),
    /// There was no answer in time.
    Slow,
    /// The receiver answered something else than a 2xx, and maybe when to ask again.
    Refused(u16, Option<Duration>),
}

impl Failed {
    /// In words.
    pub(super) fn problem(&self) -> Problem {
        let (kind, reason) = match self {
            Failed::Inner(host, port) => return target::refused(host, *port),
            Failed::Unreached(reason) => (codes::HOOK_UNREACHED, reason.clone()),
            Failed::Tls(reason) => (codes::HOOK_TLS, reason.clone()),
            Failed::Slow => (codes::HOOK_SLOW, format!("{} s", LIMIT.as_secs())),
            Failed::Refused(status, _) => (codes::HOOK_REFUSED, format!("HTTP {status}")),
        };
        Problem::new(kind).with("reason", reason)
    }

    /// The status that came back.
    pub(super) fn status(&self) -> Option<u16> {
        match self {
            Failed::Refused(status, _) => Some(*status),
            _ => None,
        }
    }
}

fn unreached(error: impl ToString) -> Failed {
    Failed::Unreached(error.to_string())
}

/// What is sent.
pub(super) struct Parcel {
    pub(super) url: String,
    /// Receivers on this machine or its link that the owner allows.
    pub(super) allowed: Vec<String>,
    /// The number of the event.
    pub(super) id: String,
    pub(super) body: Bytes,
    pub(super) secret: Option<Arc<Secret>>,
}

/// Who carries it.
pub(super) struct Carrier {
    limit: Duration,
    /// The trust anchors of this machine, loaded at the first use.
    trust: Mutex<Option<Arc<ClientConfig>>>,
}

impl Carrier {
    pub(super) const fn new(limit: Duration) -> Carrier {
        Carrier {
            limit,
            trust: Mutex::new(None),
        }
    }

    /// The authorities of this machine may be others by now.
    pub(super) fn trust_anew(&self) {
        *self.trust.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// Delivers it once, and says with which status it was taken.
    pub(super) async fn carry(&self, parcel: &Parcel) -> Result<u16, Failed> {
        let exchange = tokio::time::timeout(self.limit, self.exchange(parcel));
        exchange.await.unwrap_or(Err(Failed::Slow))
    }

    async fn exchange(&self, parcel: &Parcel) -> Result<u16, Failed> {
        let url: Uri = parcel.url.parse().map_err(unreached)?;
        let is_tls = url.scheme_str() == Some("https");
        let place = target::place(&parcel.url).ok_or_else(|| unreached("no address"))?;
        let request = request(&url, parcel).map_err(unreached)?;
        let stream = connect(&place, &parcel.allowed).await?;
        let host = place.0;
        if !is_tls {
            return talk(stream, request).await;
        }
        let broken = |error: &dyn ToString| Failed::Tls(error.to_string());
        let name = ServerName::try_from(host).map_err(|error| broken(&error))?;
        let connector = TlsConnector::from(self.trusted()?);
        let stream = connector.connect(name, stream).await;
        talk(stream.map_err(|error| broken(&error))?, request).await
    }

    /// What this machine trusts. Reading it takes a while, and is done once.
    fn trusted(&self) -> Result<Arc<ClientConfig>, Failed> {
        let mut trust = self.trust.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = &*trust {
            return Ok(Arc::clone(known));
        }
        let mut roots = RootCertStore::empty();
        let (_, _) =
            roots.add_parsable_certificates(rustls_native_certs::load_native_certs().certs);
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ClientConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .map_err(|error| Failed::Tls(error.to_string()))?;
        let config = Arc::new(config.with_root_certificates(roots).with_no_client_auth());
        *trust = Some(Arc::clone(&config));
        Ok(config)
    }
}

/// Connects to the first address of a host that takes it. What a name leads to is looked at here,
/// and that very address is connected to: a name may lead elsewhere by the next time it is asked.
/// What is written as an address was looked at when it was written.
async fn connect((host, port): &(String, u16), allowed: &[String]) -> Result<TcpStream, Failed> {
    let is_name = target::literal(host).is_none();
    let mut end = unreached("the name has no address");
    let found = tokio::net::lookup_host((host.as_str(), *port)).await;
    for address in found.map_err(unreached)? {
        let refused = is_name
            && target::is_inner(address.ip())
            && !target::is_allowed(allowed, (host, *port), address.ip());
        if refused {
            end = Failed::Inner(host.clone(), *port);
            continue;
        }
        match TcpStream::connect(address).await {
            Ok(stream) => return Ok(stream),
            Err(error) => end = unreached(error),
        }
    }
    Err(end)
}

fn request(url: &Uri, parcel: &Parcel) -> Result<Request<Full<Bytes>>, hyper::http::Error> {
    let path = url.path_and_query().map_or("/", |path| path.as_str());
    let now = Timestamp::now().as_second();
    let mut request = Request::post(path)
        .header(HOST, url.authority().map_or("", |host| host.as_str()))
        .header(CONNECTION, "close")
        .header(CONTENT_TYPE, "application/json")
        .header(USER_AGENT, concat!("railbus/", env!("CARGO_PKG_VERSION")))
        .header("X-Railbus-Event", &parcel.id)
        .header("X-Railbus-Timestamp", now);
    let secret = parcel.secret.as_ref();
    if let Some(signature) = secret.and_then(|secret| signature(secret, now, &parcel.body)) {
        request = request.header("X-Railbus-Signature", format!("sha256={signature}"));
    }
    request.body(Full::new(parcel.body.clone()))
}

/// The signature of a body and its send time under the secret. The time reveals replays.
fn signature(secret: &Secret, at: i64, body: &[u8]) -> Option<String> {
    // A key may have any length, so that there always is one.
    let mut mac = Hmac::<Sha256>::new_from_slice(secret.expose().as_bytes()).ok()?;
    mac.update(format!("{at}.").as_bytes());
    mac.update(body);
    Some(hex(&mac.finalize().into_bytes()))
}

async fn talk(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    request: Request<Full<Bytes>>,
) -> Result<u16, Failed> {
    let mut builder = http1::Builder::new();
    builder.max_buf_size(HEAD_MAX);
    let (mut sender, connection) = builder
        .handshake(TokioIo::new(stream))
        .await
        .map_err(unreached)?;
    let mut answer = pin!(sender.send_request(request));
    let answer = tokio::select! {
        biased;
        answer = &mut answer => answer,
        // It may end with the answer, or before it.
        _ = connection => answer.await,
    };
    let answer = answer.map_err(unreached)?;
    let status = answer.status();
    if status.is_success() {
        return Ok(status.as_u16());
    }
    let wait = answer.headers().get(RETRY_AFTER);
    let wait = wait.and_then(|wait| wait.to_str().ok()?.parse().ok());
    Err(Failed::Refused(
        status.as_u16(),
        wait.map(Duration::from_secs),
    ))
}

#[cfg(test)]
mod tests;
