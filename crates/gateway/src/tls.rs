//! TLS: certificate and key, from files or generated, and reloaded when they change.

mod expiry;

use super::access::secret::hex;
use jiff::Timestamp;
use railbus_api::problem::{Problem, codes};
use railbus_store::durable;
use rcgen::{CertificateParams, DnType, KeyPair, date_time_ymd};
use rustls::ServerConfig;
use rustls::crypto::{CryptoProvider, ring};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::{ClientHello, ResolvesServerCert};
use rustls::sign::CertifiedKey;
use sha2::{Digest, Sha256};
use std::fs::Metadata;
use std::net::IpAddr;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use tokio_rustls::TlsAcceptor;

/// The file of a generated pair in the state folder.
const NAME: &str = "tls.pem";
/// How many years a generated certificate is valid.
const YEARS: i16 = 10;

/// Where certificate and key come from.
#[derive(Clone, Debug)]
pub enum CertificateSource {
    /// Generated once, and stored.
    Auto,
    /// From files.
    Files {
        /// The certificate and its chain.
        cert: PathBuf,
        /// Its private key.
        key: PathBuf,
    },
}

/// The pair that is used for new clients.
#[derive(Debug)]
struct Shown(RwLock<Arc<CertifiedKey>>);

impl ResolvesServerCert for Shown {
    fn resolve(&self, _: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        let shown = self.0.read().unwrap_or_else(PoisonError::into_inner);
        Some(Arc::clone(&shown))
    }
}

/// Shows whether a file has changed.
type Mark = (u64, i64, i64, u64);

/// Certificate and key in use.
pub(super) struct Tls {
    acceptor: TlsAcceptor,
    shown: Arc<Shown>,
    provider: Arc<CryptoProvider>,
    cert: PathBuf,
    key: PathBuf,
    marks: Mutex<[Option<Mark>; 2]>,
}

impl std::fmt::Debug for Tls {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tls")
            .field("cert", &self.cert)
            .finish_non_exhaustive()
    }
}

impl Tls {
    /// Certificate and key as configured; generated if wanted and not there yet.
    pub(super) fn open(
        wish: &CertificateSource,
        state: &Path,
        names: &[String],
    ) -> Result<Tls, Problem> {
        let (cert, key) = match wish {
            CertificateSource::Files { cert, key } => (cert.clone(), key.clone()),
            CertificateSource::Auto => {
                let kept = state.join(NAME);
                if !kept.exists() {
                    make(&kept, names).map_err(|why| problem(&kept, why))?;
                }
                (kept.clone(), kept)
            }
        };
        let provider = Arc::new(ring::default_provider());
        let pair = read(&cert, &key, &provider)?;
        let shown = Arc::new(Shown(RwLock::new(Arc::new(pair))));
        let config = ServerConfig::builder_with_provider(Arc::clone(&provider))
            .with_safe_default_protocol_versions()
            .map_err(|error| problem(&cert, error.to_string()))?;
        let mut config = config
            .with_no_client_auth()
            .with_cert_resolver(Arc::clone(&shown) as Arc<dyn ResolvesServerCert>);
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(Tls {
            acceptor: TlsAcceptor::from(Arc::new(config)),
            shown,
            provider,
            marks: Mutex::new([mark(&cert), mark(&key)]),
            cert,
            key,
        })
    }

    /// The acceptor for the next client. Files that have changed are reloaded first; if they can't
    /// be used, the previous ones stay. Without clients the disk is not accessed.
    pub(super) fn acceptor(&self) -> (TlsAcceptor, Result<bool, Problem>) {
        let now = [mark(&self.cert), mark(&self.key)];
        let changed = {
            let mut marks = self.marks.lock().unwrap_or_else(PoisonError::into_inner);
            std::mem::replace(&mut *marks, now) != now
        };
        let read = match changed {
            true => self.reload().map(|()| true),
            false => Ok(false),
        };
        (self.acceptor.clone(), read)
    }

    /// Reloads the files.
    pub(super) fn reload(&self) -> Result<(), Problem> {
        let pair = read(&self.cert, &self.key, &self.provider)?;
        *self.shown.0.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(pair);
        Ok(())
    }

    /// The certificate's file, and when it expires if that is known.
    pub(super) fn expiry(&self) -> (String, Option<Timestamp>) {
        let shown = self.shown.0.read().unwrap_or_else(PoisonError::into_inner);
        let first = shown.cert.first();
        let end = first.and_then(|certificate| expiry::not_after(certificate));
        (self.cert.display().to_string(), end)
    }

    /// The fingerprint by which people recognise the certificate.
    pub(super) fn fingerprint(&self) -> String {
        let shown = self.shown.0.read().unwrap_or_else(PoisonError::into_inner);
        let first = shown.cert.first().map(Sha256::digest);
        let digits = first.map(|hash| hex(&hash)).unwrap_or_default();
        let pairs = digits.as_bytes().chunks(2).map(String::from_utf8_lossy);
        pairs.collect::<Vec<_>>().join(":").to_ascii_uppercase()
    }
}

/// The names of this machine, here and on its network; and its addresses as far as they are known.
pub(super) fn own_names() -> Vec<String> {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = name.trim().to_ascii_lowercase();
    let allowed = |letter: char| letter.is_ascii_alphanumeric() || "-.".contains(letter);
    if name.is_empty() || !name.chars().all(allowed) {
        return Vec::new();
    }
    let local = format!("{name}.local");
    vec![name, local]
}

/// The names in a generated certificate.
pub(super) fn names_for(listen: IpAddr, names: &[String]) -> Vec<String> {
    let here = ["localhost", "127.0.0.1", "::1"].map(str::to_owned);
    let one = (!listen.is_unspecified() && !listen.is_loopback()).then(|| listen.to_string());
    here.into_iter().chain(one).chain(names.to_vec()).collect()
}

/// Generates a key and a self-signed certificate, written whole or not at all.
fn make(kept: &Path, names: &[String]) -> Result<(), String> {
    let failed = |error: rcgen::Error| error.to_string();
    let mut params = CertificateParams::new(names.to_vec()).map_err(failed)?;
    let today = jiff::Zoned::now().date();
    let day = |year: i16| date_time_ymd(i32::from(year), 1, 1);
    params.not_before = day(today.year());
    params.not_after = day(today.year() + YEARS);
    params
        .distinguished_name
        .push(DnType::CommonName, "railbus");
    let key = KeyPair::generate().map_err(failed)?;
    let cert = params.self_signed(&key).map_err(failed)?;
    let text = key.serialize_pem() + &cert.pem();
    durable::replace(kept, text.as_bytes(), Some(0o600)).map_err(|error| error.to_string())
}

fn read(cert: &Path, key: &Path, provider: &CryptoProvider) -> Result<CertifiedKey, Problem> {
    // Errors never contain what was read: it could be a key.
    let certs: Result<Vec<_>, _> = CertificateDer::pem_file_iter(cert)
        .map_err(|error| problem(cert, error.to_string()))?
        .collect();
    let certs = certs.map_err(|_| problem(cert, "it holds no PEM".to_owned()))?;
    if certs.is_empty() {
        return Err(problem(cert, "it holds no certificate".to_owned()));
    }
    let der = PrivateKeyDer::from_pem_file(key).map_err(|error| match error {
        rustls::pki_types::pem::Error::Io(error) => problem(key, error.to_string()),
        _ => problem(key, "it holds no private key".to_owned()),
    })?;
    let pair = CertifiedKey::from_der(certs, der, provider);
    pair.map_err(|error| problem(cert, error.to_string()))
}

fn problem(path: &Path, why: String) -> Problem {
    Problem::new(codes::TLS)
        .with("path", path.display().to_string())
        .with("reason", why)
}

fn mark(path: &Path) -> Option<Mark> {
    let found: Metadata = std::fs::metadata(path).ok()?;
    Some((found.ino(), found.mtime(), found.mtime_nsec(), found.len()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_pair_is_made_once_and_another_is_seen_at_the_next_client() {
        let folder = std::env::temp_dir().join(format!("railbus-tls-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let names = names_for(IpAddr::from([10, 0, 0, 7]), &["plant.local".to_owned()]);
        let open = || {
            Tls::open(&CertificateSource::Auto, &folder, &names).unwrap_or_else(|p| panic!("{p:?}"))
        };
        let tls = open();
        let first = tls.fingerprint();
        assert_eq!(first.len(), 32 * 3 - 1);
        assert_eq!(open().fingerprint(), first, "it is kept");
        let kept = folder.join(NAME);
        let mode = std::fs::metadata(&kept).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        assert!(matches!(tls.acceptor().1, Ok(false)));

        make(&kept, &names).unwrap();
        assert!(matches!(tls.acceptor().1, Ok(true)));
        let second = tls.fingerprint();
        assert_ne!(second, first);
        std::fs::write(&kept, "canary").unwrap();
        let refused = tls.acceptor().1.unwrap_err();
        assert!(!format!("{refused:?}").contains("canary"), "{refused:?}");
        assert_eq!(tls.fingerprint(), second, "the one before stays");
        let _ = std::fs::remove_dir_all(&folder);
    }
}
