//! The server over TLS: who gets in, and what the role in a certificate may switch.

use super::served::{MORE, Served};
use crate::northbound::stage::PATIENCE;
use crate::northbound::supervisor::Supervised;
use railbus_api::outlets::OutletState;
use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, CustomExtension, DnType, IsCa, KeyPair,
    date_time_ymd,
};
use rustls::crypto::ring;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer, ServerName};
use rustls::{ClientConfig, RootCertStore};
use std::io;
use std::path::Path;
use std::sync::Arc;
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;

/// Values of a line that is not there are not known, and a write that may be tried says so.
const SITE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\
    [module.pump]\nline = \"main\"\nmodel = \"erc8\"\naddress = 4\n";
/// Roles of these tests.
const ROLES: &str = "roles = [\"pumps=pump.*\", \"oven=oven.k1\", \"oven=oven.k2\"]\n";
const OVEN: u8 = 3;
const PUMP: u8 = 4;
/// May not be switched, and can't be, since there is no line.
const NO_RIGHT: u8 = 2;
const NO_LINE: u8 = 0x0A;
/// What clients send first: a `ClientHello` of TLS 1.1, with one cipher suite.
const TLS_1_1: [u8; 52] = [
    0x16, 3, 1, 0, 47, 1, 0, 0, 43, 3, 2, //
    1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, //
    17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31, 32, //
    0, 0, 2, 0, 0x2F, 1, 0, 0, 0,
];

/// Who issues certificates.
struct Authority(CertifiedIssuer<'static, KeyPair>);

struct Issued {
    cert: CertificateDer<'static>,
    pem: String,
    key: KeyPair,
}

impl Authority {
    fn new(name: &str) -> Authority {
        let mut params = params(name);
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate().unwrap();
        Authority(CertifiedIssuer::self_signed(params, key).unwrap())
    }

    /// A certificate with these roles.
    fn issue(&self, name: &str, roles: &[&str]) -> Issued {
        self.issue_until(name, roles, 2999)
    }

    fn issue_until(&self, name: &str, roles: &[&str], year: i32) -> Issued {
        let mut params = params(name);
        params.not_before = date_time_ymd(2001, 1, 1);
        params.not_after = date_time_ymd(year, 1, 1);
        params.custom_extensions = roles
            .iter()
            .map(|role| {
                let content = [&[0x0C, role.len() as u8], role.as_bytes()].concat();
                let oid = [1, 3, 6, 1, 4, 1, 50316, 802, 1];
                CustomExtension::from_oid_content(&oid, content)
            })
            .collect();
        let key = KeyPair::generate().unwrap();
        let cert = params.signed_by(&key, &self.0).unwrap();
        Issued {
            cert: cert.der().clone(),
            pem: cert.pem(),
            key,
        }
    }
}

fn params(name: &str) -> CertificateParams {
    let mut params = CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
    params.distinguished_name.push(DnType::CommonName, name);
    params
}

/// A server over TLS, and who issued its certificate and those of its clients.
struct Secured {
    served: Served,
    authority: Authority,
}

impl Secured {
    async fn start(name: &str) -> Secured {
        let authority = Authority::new("plant");
        let own = authority.issue("gateway", &[]);
        let site = |folder: &Path| {
            let key = own.key.serialize_pem();
            site(folder, &[&own.pem, &key, &authority.0.pem()])
        };
        Secured {
            served: Served::start_with(&format!("tls-{name}"), site).await,
            authority,
        }
    }

    /// A client that shows this.
    async fn client(&self, shown: Option<&Issued>) -> io::Result<TlsStream<TcpStream>> {
        let stream = self.served.connect().await;
        let mut roots = RootCertStore::empty();
        roots.add(self.authority.0.der().clone()).unwrap();
        let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_root_certificates(roots);
        let config = match shown {
            None => config.with_no_client_auth(),
            Some(shown) => {
                let key = PrivatePkcs8KeyDer::from(shown.key.serialize_der());
                let key = PrivateKeyDer::Pkcs8(key);
                let chain = vec![shown.cert.clone()];
                config.with_client_auth_cert(chain, key).unwrap()
            }
        };
        let name = ServerName::try_from("localhost").unwrap();
        let connector = TlsConnector::from(Arc::new(config));
        timeout(PATIENCE, connector.connect(name, stream))
            .await
            .unwrap()
    }

    /// Waits until the last one who was turned away was so for this reason, this many by now.
    async fn until_told(&self, code: &str, tries: u32) {
        let is_so = |outlet: &Supervised| {
            let error = outlet.error();
            // It goes on, and is not taken for one that fails.
            outlet.state() == OutletState::Running
                && error.is_some_and(|error| (&*error.problem.code, error.tries) == (code, tries))
        };
        self.served.until(is_so).await;
    }
}

/// The files of a site with two modules, and what makes its outlet use them.
fn site(folder: &Path, files: &[&str; 3]) -> String {
    let mut text = format!("{SITE}{MORE}{ROLES}");
    for (key, content) in super::settings::FILES.iter().zip(files) {
        let path = folder.join(key);
        std::fs::write(&path, content).unwrap();
        text += &format!("{key} = \"{}\"\n", path.display());
    }
    text
}

/// Function and what follows of the answer to this; an error where the connection was closed.
async fn ask(
    stream: &mut (impl AsyncRead + AsyncWrite + Unpin),
    unit: u8,
    pdu: [u8; 5],
) -> io::Result<[u8; 2]> {
    let asked = async {
        let request = [&[0, 1, 0, 0, 0, 6, unit][..], &pdu].concat();
        stream.write_all(&request).await?;
        let mut answer = [0; 9];
        stream.read_exact(&mut answer).await?;
        Ok([answer[7], answer[8]])
    };
    timeout(PATIENCE, asked).await.unwrap()
}

/// What a client with this certificate is answered: to a read, and to writes to `pump.k1`,
/// `oven.k1`, `oven.k2` and `oven.k3`.
async fn rights(secured: &Secured, shown: &Issued) -> [u8; 4] {
    let mut stream = secured.client(Some(shown)).await.unwrap();
    let read = ask(&mut stream, OVEN, [1, 0, 60, 0, 1]).await.unwrap();
    assert_eq!(read[0], 0x81, "its line is not there");
    assert_ne!(read[1], NO_RIGHT, "all may read");
    let mut answers = [0; 4];
    let places = [(PUMP, 60), (OVEN, 60), (OVEN, 61), (OVEN, 62)];
    for ((unit, coil), answer) in places.into_iter().zip(&mut answers) {
        let said = ask(&mut stream, unit, [5, 0, coil, 0xFF, 0]).await.unwrap();
        assert_eq!(said[0], 0x85);
        *answer = said[1];
    }
    answers
}

#[tokio::test]
async fn a_role_switches_what_it_may_and_all_others_only_read() {
    let secured = Secured::start("roles").await;
    let issue = |roles: &[&str]| secured.authority.issue("client", roles);
    let (yes, no) = (NO_LINE, NO_RIGHT);
    for (roles, may) in [
        (&["pumps"][..], [yes, no, no, no]),
        (&["oven"], [no, yes, yes, no]),
        (&["visitor"], [no; 4]),
        (&[], [no; 4]),
        (&["pumps", "oven"], [no; 4]),
    ] {
        assert_eq!(rights(&secured, &issue(roles)).await, may, "{roles:?}");
    }
    // Two roles in one certificate.
    secured.until_told("E0931", 1).await;
    secured.served.stage.northbound.close().await;
}

#[tokio::test]
async fn who_has_no_certificate_of_the_authority_is_turned_away_and_it_is_said_why() {
    let secured = Secured::start("refused").await;
    let read = [1, 0, 60, 0, 1];
    let other = Authority::new("plant");
    let stranger = other.issue("client", &["pumps"]);
    let expired = secured.authority.issue_until("client", &["pumps"], 2002);
    let shown = [
        (None, "E0927"),
        (Some(&stranger), "E0928"),
        (Some(&expired), "E0928"),
    ];
    let mut count = 0;
    for (shown, code) in shown {
        // A client of TLS 1.3 has ended its part before the server has seen what it shows.
        let end = match secured.client(shown).await {
            Ok(mut stream) => ask(&mut stream, OVEN, read).await,
            Err(error) => Err(error),
        };
        assert!(end.is_err(), "{code}: {end:?}");
        count += 1;
        secured.until_told(code, count).await;
    }
    let mut plain = secured.served.connect().await;
    let end = ask(&mut plain, OVEN, read).await;
    assert!(end.is_err(), "{end:?}");
    secured.until_told("E0929", 4).await;
    let mut old = secured.served.connect().await;
    old.write_all(&TLS_1_1).await.unwrap();
    let mut alert = Vec::new();
    timeout(PATIENCE, old.read_to_end(&mut alert))
        .await
        .unwrap()
        .unwrap();
    // A fatal alert and the end: it lacks more of TLS 1.2 than the version.
    assert_eq!(
        (alert.len(), alert[0], alert[5]),
        (7, 0x15, 2),
        "{alert:02X?}"
    );
    secured.until_told("E0929", 5).await;
    // One that leaves without a word is none that was refused.
    drop(secured.served.connect().await);
    let good = secured.authority.issue("client", &["pumps"]);
    assert_eq!(rights(&secured, &good).await[0], NO_LINE, "others go on");
    secured.until_told("E0929", 5).await;
    secured.served.stage.northbound.close().await;
}

/// More than TLS and the socket hold.
#[tokio::test]
async fn many_answers_over_tls_are_all_taken() {
    let secured = Secured::start("many").await;
    let client = secured.authority.issue("client", &[]);
    let mut stream = secured.client(Some(&client)).await.unwrap();
    let request = [0, 1, 0, 0, 0, 6, OVEN, 4, 0, 64, 0, 8];
    let (count, each) = (20_000, 9 + 16);
    let (mut from, mut to) = tokio::io::split(&mut stream);
    let sent = async { to.write_all(&request.repeat(count)).await.unwrap() };
    let received = async {
        let mut answers = vec![0; count * each];
        from.read_exact(&mut answers).await.unwrap();
        assert!(answers.chunks(each).all(|answer| answer[7..9] == [4, 16]));
    };
    timeout(PATIENCE, async { tokio::join!(sent, received) })
        .await
        .unwrap();
    secured.served.stage.northbound.close().await;
}

#[tokio::test]
async fn files_that_cannot_be_used_are_said_and_the_outlet_waits() {
    let authority = Authority::new("plant");
    let (own, ca) = (authority.issue("gateway", &[]), authority.0.pem());
    let key = own.key.serialize_pem();
    let expired = authority.issue_until("gateway", &[], 2002);
    let (expired, its_key) = (expired.pem.clone(), expired.key.serialize_pem());
    for (name, files, key, why) in [
        ("key", [&own.pem, &its_key, &ca], "tls_key", "KeyMismatch"),
        (
            "old",
            [&expired, &its_key, &ca],
            "tls_cert",
            "it has expired",
        ),
        (
            "swapped",
            [&key, &own.pem, &ca],
            "tls_cert",
            "no certificate",
        ),
        ("ca", [&own.pem, &key, &key], "client_ca", "no certificate"),
    ] {
        let files = files.map(String::as_str);
        let unique = format!("tls-{name}");
        let served = Served::start_with(&unique, |folder| site(folder, &files)).await;
        let is_so = |outlet: &Supervised| {
            outlet.error().is_some_and(|error| {
                let said = serde_json::to_string(&error.problem).unwrap();
                assert_eq!(error.problem.code, "E0926", "{name}: {said}");
                assert!(said.contains(key) && said.contains(why), "{name}: {said}");
                assert!(!said.contains("PRIVATE"), "{said}");
                true
            })
        };
        served.until(is_so).await;
        served.stage.northbound.close().await;
    }
}
