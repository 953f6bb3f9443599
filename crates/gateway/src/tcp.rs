//! Listening over TCP: where, with which certificate, and by which names it is reached.

use super::access::Gate;
use super::guard::Front;
use super::texts::GatewayText;
use super::tls::{self, CertificateSource, Tls};
use super::{say, warn_of};
use railbus_app::failure::Failure;
use railbus_app::texts::AppText;
use railbus_words::{Code, Lang};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use tokio::net::TcpListener;

/// How a program is to be reached over TCP.
#[derive(Clone, Debug)]
pub(super) struct Network {
    /// Where it listens.
    pub(super) listen: SocketAddr,
    /// Certificate and key, if it uses TLS.
    pub(super) tls: Option<CertificateSource>,
    /// Names by which browsers reach it.
    pub(super) names: Vec<String>,
}

/// How it is reached.
#[derive(Debug)]
pub(super) struct Reached {
    /// What its requests have to be for.
    pub(super) front: Arc<Front>,
    /// Certificate and key, if clients use TLS.
    pub(super) tls: Option<Arc<Tls>>,
    /// Its URL: `http://127.0.0.1:7485`.
    pub(super) origin: String,
}

impl Network {
    /// Whether it may listen there: other machines are only let in with TLS, and if there is a user
    /// in the state folder who can log in. `serve` is its command, and `add` the one that adds a
    /// user, where that is possible.
    ///
    /// # Errors
    /// It may not; with what would have to be done first.
    pub(super) fn may_listen(
        &self,
        lang: Lang,
        state: Option<&Path>,
        (serve, add): (&str, Option<&str>),
    ) -> Result<(), Failure> {
        let listen = self.listen;
        if listen.ip().is_loopback() {
            return Ok(());
        }
        let port = listen.port();
        let refused = Failure::of(lang, Code::NotLoopback)
            .with_try(format!("{serve} --listen 127.0.0.1:{port}"))
            .with_try(format!("ssh -L {port}:127.0.0.1:{port} HOST"));
        match (&self.tls, state.is_some_and(Gate::has_user), add) {
            (Some(_), true, _) => Ok(()),
            (None, true, _) => {
                Err(refused.with_try(format!("{serve} --listen {listen} --tls auto")))
            }
            (_, false, None) => Err(refused),
            (_, false, Some(add)) => Err(refused.with_try(add)),
        }
    }
}

/// Listens.
///
/// # Errors
/// Another program listens there, or this machine does not have the address.
pub(super) async fn bind(
    lang: Lang,
    listen: SocketAddr,
    serve: &str,
) -> Result<TcpListener, Failure> {
    TcpListener::bind(listen).await.map_err(|error| {
        let message = lang.fill(AppText::NoTcp, &[("address", &listen)]);
        Failure::new(Code::Listen, message)
            .because(error)
            .with_try(format!("{serve} --listen 127.0.0.1:0"))
    })
}

impl Reached {
    /// How a program that listens here is reached; a certificate is made in its state folder if
    /// that is wanted.
    ///
    /// # Errors
    /// Certificate or key can't be used.
    pub(super) fn open(
        lang: Lang,
        tcp: &TcpListener,
        network: &Network,
        state: &Path,
    ) -> Result<Reached, Failure> {
        let address = tcp
            .local_addr()
            .map_err(|error| super::system(lang, error))?;
        let names = [tls::own_names(), network.names.clone()].concat();
        let tls = match &network.tls {
            None => None,
            Some(source) => {
                let names = tls::names_for(network.listen.ip(), &names);
                let tls = Tls::open(source, state, &names);
                Some(tls.map_err(|problem| Failure::of_problem(lang, &problem))?)
            }
        };
        let scheme = if tls.is_some() { "https" } else { "http" };
        // An unspecified address is none that a browser can open.
        let host = match names.first().filter(|_| address.ip().is_unspecified()) {
            Some(name) => format!("{name}:{}", address.port()),
            None => address.to_string(),
        };
        let is_wide = !network.listen.ip().is_loopback();
        Ok(Reached {
            front: Arc::new(Front {
                port: address.port(),
                is_tls: tls.is_some(),
                is_wide,
                names,
                is_trusted: matches!(network.tls, Some(CertificateSource::Files { .. })) && is_wide,
            }),
            tls: tls.map(Arc::new),
            origin: format!("{scheme}://{host}"),
        })
    }
}

/// Reads certificate and key again.
pub(super) fn reload_tls(lang: Lang, tls: Option<&Tls>) {
    let Some(tls) = tls else {
        return;
    };
    match tls.reload() {
        Ok(()) => {
            let fingerprint = tls.fingerprint();
            say(&lang.fill(GatewayText::TlsRead, &[("fingerprint", &fingerprint)]));
        }
        Err(problem) => warn_of(lang, &Failure::of_problem(lang, &problem)),
    }
}
