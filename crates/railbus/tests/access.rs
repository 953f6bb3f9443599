//! Who may do what at `railbus serve`: every route of its document with every role, logging in and
//! out, and secrets that must not come out. Nothing here uses a crate of railbus.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

const ROLES: [&str; 4] = ["viewer", "operator", "engineer", "admin"];
const PASSWORD: &str = "canary correct horse";

/// The demo behind a daemon, which ends with the test.
struct Daemon {
    child: Child,
    address: String,
    /// The key of the setup link.
    key: String,
    folder: PathBuf,
}

struct Answer {
    status: u16,
    head: String,
    body: String,
}

impl Answer {
    fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or(Value::Null)
    }

    fn code(&self) -> String {
        self.json()["code"].as_str().unwrap_or_default().to_owned()
    }

    /// The cookie that it sets.
    fn cookie(&self) -> String {
        let lines = self.head.lines();
        let mut cookies = lines.filter_map(|line| line.strip_prefix("set-cookie: "));
        let cookie = cookies.next().expect("a cookie");
        cookie.split(';').next().expect("a pair").to_owned()
    }
}

impl Daemon {
    fn demo(name: &str) -> Daemon {
        let unique = format!("railbus-access-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        std::fs::create_dir_all(&folder).expect("a folder");
        let mut child = Command::new(env!("CARGO_BIN_EXE_railbus"))
            .env("RAILBUS_LANG", "en")
            .env("TMPDIR", &folder)
            .args(["serve", "--demo", "--listen", "127.0.0.1:0", "--socket"])
            .arg(folder.join("socket"))
            .stdout(Stdio::piped())
            .stderr(std::fs::File::create(folder.join("stderr")).expect("a file"))
            .spawn()
            .expect("railbus starts");
        let mut stdout = BufReader::new(child.stdout.take().expect("it is piped"));
        let (mut address, mut key) = (String::new(), String::new());
        let mut line = String::new();
        while !line.contains("Ctrl-C") {
            line.clear();
            assert_ne!(stdout.read_line(&mut line).expect("text"), 0, "it ended");
            if let Some(web) = line.trim().strip_prefix("web     http://") {
                address = web.trim_end_matches('/').to_owned();
            }
            if let Some((_, link)) = line.split_once("/setup#k=") {
                key = link.split(' ').next().expect("a key").to_owned();
            }
        }
        Daemon {
            child,
            address,
            key,
            folder,
        }
    }

    /// Asks over TCP. `headers` end with a line's end each.
    fn ask(&self, method: &str, path: &str, headers: &str, body: &str) -> Answer {
        let stream = TcpStream::connect(&self.address).expect("it listens");
        let patience = Some(Duration::from_secs(60));
        stream.set_read_timeout(patience).expect("a socket");
        let host = format!("Host: {}\r\n{headers}", self.address);
        exchange(stream, method, path, &host, body)
    }

    fn as_owner(&self, method: &str, path: &str, body: &Value) -> Answer {
        let socket = UnixStream::connect(self.folder.join("socket")).expect("it listens");
        exchange(socket, method, path, "Host: any\r\n", &body.to_string())
    }

    /// The header of a token of its own.
    fn token(&self, name: &str, role: &str, points: &[&str]) -> String {
        let wish = json!({ "name": name, "role": role, "points": points });
        let made = self.as_owner("POST", "/api/v1/tokens", &wish);
        let token = made.json()["token"].as_str().expect("a token").to_owned();
        format!("Authorization: Bearer {token}\r\n")
    }

    fn log_in(&self, name: &str, password: &str) -> Answer {
        let body = json!({ "name": name, "password": password }).to_string();
        self.ask("POST", "/api/v1/login", "", &body)
    }

    fn set_up(&self) -> Answer {
        let body = json!({ "key": self.key, "name": "li", "password": PASSWORD, "lang": "zh" });
        self.ask("POST", "/api/v1/setup", "", &body.to_string())
    }

    fn on(&self, path: &str) -> Value {
        let point = format!("/api/v1/points/{}?fresh=1", path.replace('.', "/"));
        self.as_owner("GET", &point, &json!({})).json()["value"].clone()
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// One request. Of an answer that streams on and on, only the head is waited for.
fn exchange(
    mut stream: impl Read + Write,
    method: &str,
    path: &str,
    headers: &str,
    body: &str,
) -> Answer {
    let length = body.len();
    write!(
        stream,
        "{method} {path} HTTP/1.1\r\nConnection: close\r\n{headers}\
         Content-Length: {length}\r\n\r\n{body}"
    )
    .expect("it takes bytes");
    let mut reader = BufReader::new(stream);
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        assert_ne!(reader.read_line(&mut head).expect("text"), 0, "{head}");
    }
    let head = head.to_ascii_lowercase();
    let status = head
        .split(' ')
        .nth(1)
        .and_then(|status| status.parse().ok());
    let mut body = String::new();
    if !head.contains("transfer-encoding: chunked") {
        reader.read_to_string(&mut body).expect("text");
    }
    Answer {
        status: status.expect("a status"),
        head,
        body,
    }
}

/// Method, address and least role of every route in the daemon's own document; none for routes
/// that anybody may use, `owner` for those of the socket.
fn routes(daemon: &Daemon) -> Vec<(String, String, Option<String>)> {
    let document = daemon.ask("GET", "/api/v1/openapi.json", "", "").json();
    let paths = document["paths"].as_object().expect("paths").clone();
    let mut routes = Vec::new();
    for (path, item) in paths {
        for (method, operation) in item.as_object().expect("methods") {
            let may = operation["description"].as_str().expect("who may");
            let need = match may {
                "Anybody may." => None,
                "Viewers may." => Some("viewer"),
                "Operators may." => Some("operator"),
                "Engineers may." => Some("engineer"),
                "Admins may." => Some("admin"),
                _ if may.starts_with("Only over the socket") => Some("owner"),
                _ => panic!("{method} {path}: {may}"),
            };
            routes.push((
                method.to_ascii_uppercase(),
                path.clone(),
                need.map(str::to_owned),
            ));
        }
    }
    routes
}

/// An address of a route, with names that nothing has.
fn filled(path: &str) -> String {
    let parts = path.split('/').map(|part| match part.starts_with('{') {
        true => "nothing",
        false => part,
    });
    format!("/api/v1{}", parts.collect::<Vec<_>>().join("/"))
}

#[test]
fn every_route_asks_for_its_role() {
    let daemon = Daemon::demo("walk");
    let tokens = ROLES.map(|role| daemon.token(role, role, &[]));
    let routes = routes(&daemon);
    assert!(routes.len() >= 25, "{}", routes.len());
    for (method, path, need) in routes {
        let ask = |headers: &str| daemon.ask(&method, &filled(&path), headers, "");
        let what = format!("{method} {path}");
        let least = need
            .as_ref()
            .map(|need| ROLES.iter().position(|role| role == need));
        for stranger in [
            "",
            "Authorization: Bearer rb_0\r\n",
            "Authorization: Basic b3duZXI6\r\n",
            "Cookie: railbus_session=0\r\n",
        ] {
            let answer = ask(stranger);
            match least {
                None => assert_ne!(answer.status, 401, "{what}"),
                Some(None) => assert!([404, 405].contains(&answer.status), "{what}"),
                Some(Some(_)) => {
                    assert_eq!(
                        (answer.status, answer.code()),
                        (401, "E0902".into()),
                        "{what}"
                    );
                    assert!(answer.head.contains("www-authenticate: bearer"), "{what}");
                }
            }
        }
        let Some(Some(least)) = least else {
            continue;
        };
        for (at, token) in tokens.iter().enumerate() {
            let answer = ask(token);
            let refused = answer.code() == "E0905";
            assert_eq!(
                refused,
                at < least,
                "{what} as {}: {}",
                ROLES[at],
                answer.body
            );
            assert_eq!(answer.status == 403, refused, "{what} as {}", ROLES[at]);
            assert_ne!(answer.status, 401, "{what} as {}", ROLES[at]);
        }
    }
}

#[test]
fn rights_of_points_hold_on_every_way_to_switch() {
    let daemon = Daemon::demo("points");
    let token = daemon.token("pump", "operator", &["pump.*"]);
    let ask = |method: &str, path: &str, body: &str| {
        daemon.ask(method, &format!("/api/v1{path}"), &token, body)
    };
    let on = r#"{"value":true}"#;
    assert_eq!(ask("PUT", "/points/pump/do0", on).status, 200);
    assert_eq!(
        ask("PUT", "/modules/pump/outputs", r#"{"set":{"do1":true}}"#).status,
        200
    );
    let ways = [
        ("PUT", "/points/oven/k1", on),
        ("POST", "/points/oven/k1/toggle", ""),
        ("POST", "/points/oven/k1/pulse", r#"{"ms":60000}"#),
        (
            "PUT",
            "/points/oven/k1/lease",
            r#"{"value":true,"ttl_ms":60000}"#,
        ),
        ("PUT", "/modules/oven/outputs", r#"{"set":{"k1":true}}"#),
        (
            "POST",
            "/batch",
            r#"{"set":[{"path":"oven.k1","value":true}]}"#,
        ),
    ];
    let known = routes(&daemon);
    for (method, path, body) in ways {
        let like = path
            .replace("/oven/k1", "/{module}/{label}")
            .replace("/oven/", "/{module}/");
        if !known.iter().any(|(_, known, _)| *known == like) {
            assert!(
                ["/points/oven/k1/lease", "/batch"].contains(&path),
                "{path} {known:?}"
            );
            continue;
        }
        let answer = ask(method, path, body);
        assert!(
            answer.body.contains("E0906"),
            "{path}: {} {}",
            answer.status,
            answer.body
        );
    }
    assert_eq!(daemon.on("oven.k1"), false);
    assert_eq!(daemon.on("pump.do1"), true);
}

#[test]
fn the_first_user_comes_by_the_link_and_nobody_after() {
    let daemon = Daemon::demo("setup");
    let before = daemon.ask("GET", "/api/v1/session", "", "").json();
    assert_eq!(
        (&before["user"], &before["setup"]),
        (&Value::Null, &json!(true))
    );
    assert_eq!(before["demo"], true);
    let wrong = json!({ "key": "AAAA", "name": "li", "password": PASSWORD }).to_string();
    let wrong = daemon.ask("POST", "/api/v1/setup", "", &wrong);
    assert_eq!((wrong.status, wrong.code()), (403, "E0909".into()));
    let first = daemon.set_up();
    assert_eq!(first.status, 200, "{}", first.body);
    assert_eq!(first.json()["user"]["role"], "admin");
    assert_eq!(first.json()["lang"], "zh");
    for part in ["httponly", "samesite=strict", "path=/"] {
        assert!(first.head.contains(part), "{}", first.head);
    }
    let again = daemon.set_up();
    assert_eq!((again.status, again.code()), (409, "E0919".into()));
}

#[test]
fn a_session_needs_its_token_to_change_anything_and_ends() {
    let daemon = Daemon::demo("session");
    let first = daemon.set_up();
    let cookie = format!("Cookie: {}\r\n", first.cookie());
    let csrf = first.json()["csrf"].as_str().expect("a token").to_owned();
    let ours = format!("{cookie}X-CSRF-Token: {csrf}\r\n");
    let path = "/api/v1/points/pump/do0";
    let on = r#"{"value":true}"#;
    assert_eq!(daemon.ask("GET", path, &cookie, "").status, 200);
    let alone = daemon.ask("PUT", path, &cookie, on);
    assert_eq!((alone.status, alone.code()), (403, "E0908".into()));
    let wrong = format!("{cookie}X-CSRF-Token: 0\r\n");
    assert_eq!(daemon.ask("PUT", path, &wrong, on).status, 403);
    assert_eq!(daemon.on("pump.do0"), false);
    assert_eq!(daemon.ask("PUT", path, &ours, on).status, 200);
    let told = daemon.ask("GET", "/api/v1/session", &cookie, "").json();
    assert_eq!(
        told["csrf"],
        csrf.as_str(),
        "a page that is loaded again finds it"
    );
    let sessions = daemon.ask("GET", "/api/v1/sessions", &cookie, "").json();
    assert_eq!(sessions["sessions"][0]["current"], true);

    let new = json!({ "old": PASSWORD, "new": "another canary horse" }).to_string();
    let second = daemon.log_in("li", PASSWORD);
    let other = format!("Cookie: {}\r\n", second.cookie());
    assert_eq!(
        daemon.ask("POST", "/api/v1/password", &ours, &new).status,
        200
    );
    assert_eq!(
        daemon.ask("GET", path, &other, "").status,
        401,
        "it has ended"
    );
    assert_eq!(daemon.ask("GET", path, &cookie, "").status, 200);
    let out = daemon.ask("POST", "/api/v1/logout", &ours, "");
    assert!(out.head.contains("max-age=0"), "{}", out.head);
    assert_eq!(daemon.ask("GET", path, &cookie, "").status, 401);
}

#[test]
fn guessing_is_slow_and_tells_nothing() {
    let daemon = Daemon::demo("guess");
    daemon.set_up();
    let known = daemon.log_in("li", "wrong");
    let unknown = daemon.log_in("nobody", "wrong");
    assert_eq!((known.status, &known.body), (401, &unknown.body));
    for _ in 0..3 {
        assert_eq!(daemon.log_in("nobody", "wrong").status, 401);
    }
    let refused = daemon.log_in("li", PASSWORD);
    assert_eq!((refused.status, refused.code()), (429, "E0907".into()));
    assert!(
        refused.json()["retry_after_ms"].is_u64(),
        "{}",
        refused.body
    );
    assert!(refused.head.contains("retry-after: "), "{}", refused.head);
}

#[test]
fn what_streams_ends_with_the_rights_to_it() {
    let daemon = Daemon::demo("stream");
    let token = daemon.token("eyes", "viewer", &[]);
    let stream = TcpStream::connect(&daemon.address).expect("it listens");
    let patience = Some(Duration::from_secs(60));
    stream.set_read_timeout(patience).expect("a socket");
    let mut stream = BufReader::new(stream);
    let address = &daemon.address;
    let request = format!("GET /api/v1/watch HTTP/1.1\r\nHost: {address}\r\n{token}\r\n");
    stream
        .get_mut()
        .write_all(request.as_bytes())
        .expect("it takes bytes");
    let mut line = String::new();
    while !line.contains("\"pump.do0\"") {
        line.clear();
        assert_ne!(stream.read_line(&mut line).expect("text"), 0, "it ended");
    }
    daemon.as_owner("DELETE", "/api/v1/tokens/eyes", &json!({}));
    // The end comes by itself: a read that finds none fails in time.
    std::io::copy(&mut stream, &mut std::io::sink()).expect("an end");
    assert_eq!(daemon.ask("GET", "/api/v1/lines", &token, "").status, 401);
}

#[test]
fn no_secret_comes_out_again() {
    let mut daemon = Daemon::demo("canary");
    let first = daemon.set_up();
    let cookie = first.cookie();
    let secret_cookie = cookie.split('=').nth(1).expect("a value").to_owned();
    let token = daemon.token("canary", "admin", &[]);
    let secret_token = token.trim().rsplit(' ').next().expect("a token").to_owned();
    daemon.log_in("li", "wrong canary guess");
    daemon.log_in("canary typed into the name", "x");
    let user = json!({ "name": "wang", "role": "viewer", "password": "second canary horse" });
    assert_eq!(daemon.as_owner("POST", "/api/v1/users", &user).status, 200);
    let broken = r#"{"name":"zhao","role":"viewer","password":["canary broken"]}"#;
    let broken = daemon.ask("POST", "/api/v1/users", &token, broken);
    assert_eq!(broken.status, 422);
    let mut told = vec![broken.body];
    for (method, path, _) in routes(&daemon) {
        if method == "GET" {
            let answer = daemon.ask("GET", &filled(&path), &token, "");
            told.push(answer.head + &answer.body);
        }
    }
    for path in ["/", "/metrics", "/api/v1/session"] {
        told.push(daemon.ask("GET", path, &token, "").body);
    }
    let _ = daemon.child.kill();
    let _ = daemon.child.wait();
    let log = std::fs::read_to_string(daemon.folder.join("stderr")).expect("a file");
    assert!(log.contains("login: li via http: logged in"), "{log}");
    told.push(log);
    let hashes = ["$argon2id$", "sha256"];
    let phrases = [
        "canary correct",
        "canary guess",
        "canary horse",
        "canary typed",
        "canary broken",
    ];
    let secrets = [
        secret_cookie.as_str(),
        secret_token.as_str(),
        daemon.key.as_str(),
    ];
    for text in &told {
        for secret in hashes.iter().chain(&phrases).chain(&secrets) {
            assert!(!text.contains(secret), "{secret} in {text}");
        }
    }
}
