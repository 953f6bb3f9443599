//! Modbus/TCP Security: who a client is by its certificate, and what it may switch by its role.

use super::roles::{Roles, role_of};
use super::settings::FILES;
use crate::northbound::clients::plain;
use jiff::Timestamp;
use jiff::tz::TimeZone;
use railbus_api::problem::{Problem, ProblemType as ProblemKind, codes};
use railbus_site::config::change::Keys;
use rustls::crypto::{CryptoProvider, ring};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::{NoServerSessionStorage, WebPkiClientVerifier};
use rustls::sign::{CertifiedKey, SingleCertAndKey};
use rustls::{Error, RootCertStore, ServerConfig};
use std::fs::File;
use std::io::{self, Read as _};
use std::net::IpAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;
use x509_parser::parse_x509_certificate;

/// A client has so long to show who it is.
const HANDSHAKE_MAX: Duration = Duration::from_secs(10);
/// So much that is encrypted may wait for the socket, in bytes.
const UNSENT_MAX: usize = 8 * 1024;
/// The largest file of certificates or of a key.
const FILE_MAX: u64 = 256 * 1024;
const SECONDS_A_DAY: i64 = 24 * 60 * 60;

/// How clients are admitted over TLS.
pub(super) struct Security {
    acceptor: TlsAcceptor,
    roles: Roles,
    /// The certificate and the authorities, for people.
    told: String,
}

/// A client that has shown who it is.
#[derive(Debug)]
pub(super) struct Peer {
    /// Role and name, for logs.
    pub(super) who: String,
    /// The outputs that it may switch; none for reading only.
    pub(super) points: Vec<String>,
    /// Why it has no role though its certificate names one.
    pub(super) flaw: Option<Problem>,
}

impl Security {
    /// As the settings say; none without TLS.
    pub(super) fn open(settings: &Keys) -> Result<Option<Security>, Problem> {
        let path = |key: &str| settings.get(key).and_then(|value| value.as_str());
        let [Some(cert), Some(key), Some(ca)] = FILES.map(path) else {
            return Ok(None);
        };
        let [cert, key, ca] = [cert, key, ca].map(Path::new);
        let provider = Arc::new(ring::default_provider());
        let now = Timestamp::now();
        let (pair, own) = pair(cert, key, &provider, now)?;
        let (roots, authorities) = authorities(ca, now)?;
        let verifier =
            WebPkiClientVerifier::builder_with_provider(Arc::new(roots), Arc::clone(&provider));
        let verifier = verifier.build().map_err(|why| unusable(ca, why))?;
        let config = ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .map_err(|why| unusable(cert, why))?;
        let mut config = config
            .with_client_cert_verifier(verifier)
            .with_cert_resolver(Arc::new(SingleCertAndKey::from(pair)));
        // A certificate that has expired since is not accepted with the session of then.
        config.session_storage = Arc::new(NoServerSessionStorage {});
        config.send_tls13_tickets = 0;
        Ok(Some(Security {
            acceptor: TlsAcceptor::from(Arc::new(config)),
            roles: Roles::new(settings),
            told: format!("TLS: {own}; CA: {}", authorities.join(", ")),
        }))
    }

    /// Certificate and authorities, each until when.
    pub(super) fn told(&self) -> &str {
        &self.told
    }

    /// Finds out who a client is. The error is none where it left without a word.
    pub(super) async fn admit(
        &self,
        stream: TcpStream,
        from: IpAddr,
    ) -> Result<(TlsStream<TcpStream>, Peer), Option<Problem>> {
        let shaken = timeout(HANDSHAKE_MAX, async {
            match stream.peek(&mut [0]).await {
                Ok(0) => Ok(None),
                Ok(_) => {
                    let mut stream = self.acceptor.accept(stream).await?;
                    // A client that takes its answers slowly is seen to take some.
                    stream.get_mut().1.set_buffer_limit(Some(UNSENT_MAX));
                    Ok(Some(stream))
                }
                Err(error) => Err(error),
            }
        });
        let timed_out = |_| Err(io::ErrorKind::TimedOut.into());
        let stream = match shaken.await.unwrap_or_else(timed_out) {
            Ok(Some(stream)) => stream,
            Ok(None) => return Err(None),
            Err(error) => return Err(Some(refused(from, &error))),
        };
        let (_, tls) = stream.get_ref();
        let shown = tls.peer_certificates().and_then(<[_]>::first);
        let peer = match shown {
            Some(certificate) => self.peer(certificate, from),
            None => return Err(Some(told(codes::CLIENT_NO_CERT, from, "no certificate"))),
        };
        Ok((stream, peer))
    }

    fn peer(&self, certificate: &[u8], from: IpAddr) -> Peer {
        let parsed = parse_x509_certificate(certificate);
        let (name, role) = match &parsed {
            Ok((_, certificate)) => (certificate.subject().to_string(), role_of(certificate)),
            Err(_) => (String::new(), Ok(None)),
        };
        let (role, flaw) = match role {
            Ok(role) => (role, None),
            Err(flaw) => (None, Some(told(codes::CLIENT_ROLE, from, flaw.reason()))),
        };
        let who = match &role {
            Some(role) => format!("role={} {}", plain(role), plain(&name)),
            None => format!("no role, {}", plain(&name)),
        };
        let points = role.as_deref().map(|role| self.roles.points(role));
        Peer {
            who,
            points: points.unwrap_or_default().to_vec(),
            flaw,
        }
    }
}

/// Why a handshake failed.
fn refused(from: IpAddr, error: &io::Error) -> Problem {
    let inner = error.get_ref();
    let tls = inner.and_then(|inner| inner.downcast_ref::<Error>());
    let kind = match tls {
        Some(Error::NoCertificatesPresented) => codes::CLIENT_NO_CERT,
        Some(Error::InvalidCertificate(_)) => codes::CLIENT_CERT,
        Some(Error::InvalidMessage(_) | Error::PeerIncompatible(_)) => codes::CLIENT_NOT_TLS,
        _ => codes::CLIENT_HANDSHAKE,
    };
    told(kind, from, error)
}

fn told(kind: ProblemKind, from: IpAddr, why: impl ToString) -> Problem {
    let reason = format!("{from}: {}", why.to_string());
    let problem = Problem::new(kind).with("client", from.to_string());
    problem.with("reason", reason)
}

/// The certificate with its key, and until when it is valid.
fn pair(
    cert: &Path,
    key: &Path,
    provider: &CryptoProvider,
    now: Timestamp,
) -> Result<(CertifiedKey, String), Problem> {
    let chain = certificates(cert)?;
    let own = chain.first().map(|first| validity(first, now));
    let own = own.unwrap_or(Err("it holds no certificate"));
    let own = own.map_err(|why| unusable(cert, why))?;
    // Errors never contain what was read.
    let der = PrivateKeyDer::from_pem_slice(&read(key)?);
    let der = der.map_err(|_| unusable(key, "it holds no private key"))?;
    let pair = CertifiedKey::from_der(chain, der, provider);
    Ok((pair.map_err(|why| unusable(key, why))?, own))
}

/// The authorities that may have issued the certificates of clients, and until when they may.
/// Those that have expired may not.
fn authorities(ca: &Path, now: Timestamp) -> Result<(RootCertStore, Vec<String>), Problem> {
    let mut roots = RootCertStore::empty();
    let (mut until, mut expired) = (Vec::new(), "it holds no certificate");
    for certificate in certificates(ca)? {
        match validity(&certificate, now) {
            Ok(told) => {
                roots.add(certificate).map_err(|why| unusable(ca, why))?;
                until.push(told);
            }
            Err(why) => expired = why,
        }
    }
    match until.is_empty() {
        true => Err(unusable(ca, expired)),
        false => Ok((roots, until)),
    }
}

/// Whose certificate it is and until when, with the days that are left.
fn validity(certificate: &[u8], now: Timestamp) -> Result<String, &'static str> {
    let parsed = parse_x509_certificate(certificate);
    let (_, parsed) = parsed.map_err(|_| "it is no X.509 certificate")?;
    let validity = parsed.validity();
    let (from, to) = (&validity.not_before, &validity.not_after);
    let (from, to) = (from.timestamp(), to.timestamp());
    let now = now.as_second();
    if now < from {
        return Err("it is not valid yet");
    }
    if now > to {
        return Err("it has expired");
    }
    let day = Timestamp::from_second(to).map(|end| end.to_zoned(TimeZone::UTC).date());
    let day = day.map_or_else(|_| String::new(), |day| day.to_string());
    let left = (to - now) / SECONDS_A_DAY;
    let name = plain(&parsed.subject().to_string());
    Ok(format!("{name}, {day} ({left} d)"))
}

fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, Problem> {
    let text = read(path)?;
    let all: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&text).collect();
    match all {
        Ok(all) if !all.is_empty() => Ok(all),
        _ => Err(unusable(path, "it holds no certificate in PEM")),
    }
}

/// A file, unless it is none or too long: the path comes from the settings.
fn read(path: &Path) -> Result<Vec<u8>, Problem> {
    let failed = |error: io::Error| unusable(path, error);
    let about = std::fs::metadata(path).map_err(failed)?;
    if !about.is_file() || about.len() > FILE_MAX {
        return Err(unusable(path, "it is no file of certificates or a key"));
    }
    let mut text = Vec::new();
    let file = File::open(path).map_err(failed)?;
    file.take(FILE_MAX).read_to_end(&mut text).map_err(failed)?;
    Ok(text)
}

fn unusable(path: &Path, why: impl ToString) -> Problem {
    let path = path.display().to_string();
    let reason = format!("{path}: {}", why.to_string());
    Problem::new(codes::OUTLET_TLS)
        .with("path", path)
        .with("reason", reason)
}
