//! The way to a broker: TCP, and TLS over it where the settings say so. Why there is none is kept
//! apart from what the protocol says later.

use super::settings::Broker;
use railbus_api::problem::{Problem, ProblemType, codes};
use rustls::crypto::ring;
use rustls::pki_types::pem::{self, PemObject as _};
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use rustls::{ClientConfig, RootCertStore};
use std::error::Error;
use std::io;
use std::path::Path;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;

/// How far a connection came.
#[derive(Clone, Debug, Default)]
pub(crate) enum Reached {
    /// Not yet.
    #[default]
    No,
    /// There is a way to the broker.
    Yes,
    /// There is none.
    Failed(Problem),
}

/// The way to a broker.
#[derive(Clone)]
pub(crate) struct Dial {
    host: String,
    port: u16,
    tls: Option<Arc<ClientConfig>>,
    reached: Arc<Mutex<Reached>>,
}

impl std::fmt::Debug for Dial {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Dial")
            .field("host", &self.host)
            .field("port", &self.port)
            .finish_non_exhaustive()
    }
}

/// A connection, plain or not.
pub(crate) enum Stream {
    Plain(TcpStream),
    Tls(Box<TlsStream<TcpStream>>),
}

impl Dial {
    /// The way to this broker. Its files are read anew each time: certificates are renewed.
    ///
    /// # Errors
    /// One of the files can't be used.
    pub(crate) fn new(broker: &Broker) -> Result<Dial, Problem> {
        let tls = match broker.is_tls {
            true => {
                let own = broker.own.as_ref();
                let own = own.map(|(cert, key)| (cert.as_path(), key.as_path()));
                let config = trusting(broker.ca.as_deref(), own, codes::BROKER_FILE)?;
                Some(Arc::new(config))
            }
            false => None,
        };
        Ok(Dial {
            host: broker.host.clone(),
            port: broker.port,
            tls,
            reached: Arc::default(),
        })
    }

    /// How far it came.
    pub(crate) fn reached(&self) -> Reached {
        let reached = self.reached.lock();
        reached.unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Connects.
    ///
    /// # Errors
    /// There is no way; [`Dial::reached`] has the reason.
    pub(crate) async fn connect(self) -> io::Result<Stream> {
        let (end, reached) = match self.try_to().await {
            Ok(stream) => (Ok(stream), Reached::Yes),
            Err(problem) => {
                let error = io::Error::other(problem.text("reason"));
                (Err(error), Reached::Failed(problem))
            }
        };
        *self.reached.lock().unwrap_or_else(PoisonError::into_inner) = reached;
        end
    }

    async fn try_to(&self) -> Result<Stream, Problem> {
        let stream = TcpStream::connect((self.host.as_str(), self.port)).await;
        let stream = stream.map_err(|error| self.unreached(&error))?;
        // What is published is small, and waits for nothing.
        let _ = stream.set_nodelay(true);
        let Some(config) = &self.tls else {
            return Ok(Stream::Plain(stream));
        };
        let name = ServerName::try_from(self.host.clone());
        let name = name.map_err(|error| self.untrusted(&error))?;
        let connector = TlsConnector::from(Arc::clone(config));
        let stream = connector.connect(name, stream).await;
        let stream = stream.map_err(|error| match tls_reason(&error) {
            Some(reason) => self.untrusted(&reason),
            // It hangs up at the first message of TLS.
            None => self.untrusted(&error),
        })?;
        Ok(Stream::Tls(Box::new(stream)))
    }

    fn place(&self) -> String {
        match self.host.contains(':') {
            true => format!("[{}]:{}", self.host, self.port),
            false => format!("{}:{}", self.host, self.port),
        }
    }

    fn about(&self, problem: Problem, reason: &dyn ToString) -> Problem {
        problem
            .with("broker", self.place())
            .with("reason", reason.to_string())
    }

    /// Nothing answers there.
    pub(crate) fn unreached(&self, reason: &dyn ToString) -> Problem {
        self.about(Problem::new(codes::BROKER_UNREACHED), reason)
    }

    /// One of both sides does not trust the other.
    pub(crate) fn untrusted(&self, reason: &dyn ToString) -> Problem {
        self.about(Problem::new(codes::BROKER_TLS), reason)
    }

    /// Name and password are not accepted.
    pub(crate) fn unknown(&self, reason: &dyn ToString) -> Problem {
        self.about(Problem::new(codes::BROKER_LOGIN), reason)
    }

    /// The broker does not want it for another reason.
    pub(crate) fn refused(&self, reason: &dyn ToString) -> Problem {
        self.about(Problem::new(codes::BROKER_REFUSED), reason)
    }

    /// The broker does not allow a topic.
    pub(crate) fn forbidden(&self, topic: &str) -> Problem {
        let problem = Problem::new(codes::BROKER_TOPIC).with("topic", topic);
        self.about(problem, &"not authorized")
    }
}

/// What TLS says, if an error came from it: a broker that wants another certificate says so after
/// its side of the handshake.
pub(crate) fn tls_reason(error: &(dyn Error + 'static)) -> Option<String> {
    let mut next = Some(error);
    while let Some(error) = next {
        if let Some(found) = error.downcast_ref::<rustls::Error>() {
            return Some(found.to_string());
        }
        let inner = error.downcast_ref::<io::Error>();
        if let Some(inner) = inner.and_then(io::Error::get_ref) {
            let found = inner.downcast_ref::<rustls::Error>();
            if let Some(found) = found {
                return Some(found.to_string());
            }
        }
        next = error.source();
    }
    None
}

/// TLS of a client that trusts the authorities of a file, or those of this machine if there is
/// none, and shows a certificate of its own if it has one. `file` is the problem of one that can't
/// be used.
pub(crate) fn trusting(
    ca: Option<&Path>,
    own: Option<(&Path, &Path)>,
    file: ProblemType,
) -> Result<ClientConfig, Problem> {
    let unusable = |path: &Path, why: String| unusable(file, path, why);
    let mut roots = RootCertStore::empty();
    match ca {
        Some(path) => {
            for cert in certificates(file, path)? {
                let added = roots.add(cert);
                added.map_err(|error| unusable(path, error.to_string()))?;
            }
        }
        None => {
            let found = rustls_native_certs::load_native_certs();
            let (_, _) = roots.add_parsable_certificates(found.certs);
        }
    }
    let provider = Arc::new(ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| Problem::new(codes::INTERNAL).with("reason", error.to_string()))?
        .with_root_certificates(roots);
    Ok(match own {
        None => config.with_no_client_auth(),
        Some((cert, key)) => {
            let chain = certificates(file, cert)?;
            let der = PrivateKeyDer::from_pem_file(key).map_err(|error| match error {
                pem::Error::Io(error) => unusable(key, error.to_string()),
                _ => unusable(key, "it holds no private key".to_owned()),
            })?;
            let config = config.with_client_auth_cert(chain, der);
            config.map_err(|error| unusable(cert, error.to_string()))?
        }
    })
}

/// The certificates of a file. Errors never contain what was read: it could be a key.
fn certificates(file: ProblemType, path: &Path) -> Result<Vec<CertificateDer<'static>>, Problem> {
    let unusable = |path: &Path, why: String| unusable(file, path, why);
    let found = CertificateDer::pem_file_iter(path);
    let found = found.map_err(|error| unusable(path, error.to_string()))?;
    let all: Result<Vec<_>, _> = found.collect();
    let all = all.map_err(|_| unusable(path, "it holds no PEM".to_owned()))?;
    match all.is_empty() {
        true => Err(unusable(path, "it holds no certificate".to_owned())),
        false => Ok(all),
    }
}

fn unusable(file: ProblemType, path: &Path, why: String) -> Problem {
    Problem::new(file)
        .with("path", path.display().to_string())
        .with("reason", why)
}

impl AsyncRead for Stream {
    fn poll_read(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Stream::Plain(stream) => Pin::new(stream).poll_read(cx, buffer),
            Stream::Tls(stream) => Pin::new(stream).poll_read(cx, buffer),
        }
    }
}

impl AsyncWrite for Stream {
    fn poll_write(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        match self.get_mut() {
            Stream::Plain(stream) => Pin::new(stream).poll_write(cx, bytes),
            Stream::Tls(stream) => Pin::new(stream).poll_write(cx, bytes),
        }
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Stream::Plain(stream) => Pin::new(stream).poll_flush(cx),
            Stream::Tls(stream) => Pin::new(stream).poll_flush(cx),
        }
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Stream::Plain(stream) => Pin::new(stream).poll_shutdown(cx),
            Stream::Tls(stream) => Pin::new(stream).poll_shutdown(cx),
        }
    }
}
