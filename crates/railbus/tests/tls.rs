//! Listening for other machines: refused without TLS and a user, and by TLS with both.

use rustix::process::{Pid, Signal, kill_process};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use serde_json::json;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;
use std::time::Duration;

const SITE: &str = "[line.main]\nport = \"/dev/railbus-test-nothing\"\n\
                    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
const PASSWORD: &str = "correct horse battery";

struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A daemon that ends with the test.
struct Daemon(Child);

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn railbus(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_railbus"));
    command
        .current_dir(folder)
        .env("RAILBUS_LANG", "en")
        .env("HOME", folder)
        .env("RAILBUS_RUN", folder.join("run"))
        .env_remove("RAILBUS_CONFIG");
    command
}

fn refused(folder: &Path, arguments: &[&str]) -> String {
    let mut serve = railbus(folder);
    serve.args(["serve", "--listen", "0.0.0.0:0", "--socket", "socket"]);
    let ran: Output = serve.args(arguments).output().expect("it runs");
    assert_eq!(ran.status.code(), Some(9), "{ran:?}");
    String::from_utf8_lossy(&ran.stderr).into_owned()
}

/// One request by TLS, to a daemon whose certificate is trusted and is for `localhost`.
fn ask(folder: &Path, port: u16, method: &str, path: &str, host: &str, body: &str) -> String {
    let pem = std::fs::read(folder.join(".railbus/tls.pem")).expect("a file");
    let mut roots = RootCertStore::empty();
    let cert = CertificateDer::from_pem_slice(&pem).expect("a certificate");
    roots.add(cert).expect("a root");
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .expect("versions")
        .with_root_certificates(roots)
        .with_no_client_auth();
    let name = "localhost".try_into().expect("a name");
    let client = ClientConnection::new(Arc::new(config), name).expect("a client");
    let stream = TcpStream::connect(("127.0.0.1", port)).expect("it listens");
    let patience = Some(Duration::from_secs(60));
    stream.set_read_timeout(patience).expect("a socket");
    let mut stream = StreamOwned::new(client, stream);
    let length = body.len();
    write!(
        stream,
        "{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\
         Content-Length: {length}\r\n\r\n{body}"
    )
    .expect("it takes bytes");
    let mut text = String::new();
    let _ = stream.read_to_string(&mut text);
    text
}

#[test]
fn other_machines_are_let_in_by_tls_and_with_a_user() {
    let folder = std::env::temp_dir().join(format!("railbus-tls-it-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let folder = Folder(folder);
    let at = folder.0.as_path();
    std::fs::write(at.join("railbus.toml"), SITE).expect("a file");
    let told = refused(at, &["--tls", "auto"]);
    assert!(
        told.contains("E0903") && told.contains("railbus user add"),
        "{told}"
    );
    assert!(!at.join(".railbus/tls.pem").exists());
    let demo = refused(at, &["--tls", "auto", "--demo"]);
    assert!(demo.contains("E0903"), "{demo}");

    std::fs::write(at.join("password"), PASSWORD).expect("a file");
    let mut add = railbus(at);
    add.args([
        "user",
        "add",
        "li",
        "--role",
        "admin",
        "--password-file",
        "password",
    ]);
    let added = add.output().expect("it runs");
    assert!(added.status.success(), "{added:?}");
    let told = refused(at, &[]);
    assert!(told.contains("--tls auto"), "{told}");

    let mut child = railbus(at)
        .args([
            "serve",
            "--listen",
            "0.0.0.0:0",
            "--tls",
            "auto",
            "--socket",
            "socket",
        ])
        .args(["--name", "plant.example"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("railbus starts");
    let mut stdout = BufReader::new(child.stdout.take().expect("it is piped"));
    let daemon = Daemon(child);
    let mut said = String::new();
    while !said.contains("Ctrl-C") {
        assert_ne!(stdout.read_line(&mut said).expect("text"), 0, "it ended");
    }
    assert!(!said.contains("/setup#k="), "there is a user: {said}");
    let web = said
        .lines()
        .find_map(|line| line.trim().strip_prefix("web     https://"));
    let port = web.and_then(|web| web.trim_end_matches('/').rsplit(':').next());
    let port: u16 = port.and_then(|port| port.parse().ok()).expect("a port");
    let tls = said
        .lines()
        .find_map(|line| line.trim().strip_prefix("tls     SHA-256 "));
    let fingerprint = tls.expect("a fingerprint").to_owned();

    for host in ["localhost", "10.0.0.7", "plant.example"] {
        let host = format!("{host}:{port}");
        let session = ask(at, port, "GET", "/api/v1/session", &host, "");
        assert!(session.starts_with("HTTP/1.1 200"), "{session}");
    }
    let evil = ask(
        at,
        port,
        "GET",
        "/api/v1/session",
        &format!("evil.example:{port}"),
        "",
    );
    assert!(evil.starts_with("HTTP/1.1 403"), "{evil}");
    let host = format!("localhost:{port}");
    let nobody = ask(at, port, "GET", "/api/v1/lines", &host, "");
    assert!(nobody.starts_with("HTTP/1.1 401"), "{nobody}");
    let login = json!({ "name": "li", "password": PASSWORD }).to_string();
    let session = ask(at, port, "POST", "/api/v1/login", &host, &login).to_ascii_lowercase();
    assert!(
        session.contains("; secure") && session.contains("; httponly"),
        "{session}"
    );

    let mut plain = TcpStream::connect(("127.0.0.1", port)).expect("it listens");
    plain
        .set_read_timeout(Some(Duration::from_secs(60)))
        .expect("a socket");
    plain
        .write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        .expect("it takes bytes");
    let mut answer = Vec::new();
    let _ = plain.read_to_end(&mut answer);
    assert!(!answer.starts_with(b"HTTP"), "{answer:?}");

    kill_process(Pid::from_child(&daemon.0), Signal::HUP).expect("it runs");
    while !said.contains("certificate reloaded") {
        assert_ne!(stdout.read_line(&mut said).expect("text"), 0, "it ended");
    }
    assert_eq!(said.matches(&fingerprint).count(), 2, "{said}");
}
