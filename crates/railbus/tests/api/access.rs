//! Access rights of `railbus serve`: every route of its document with every role, signing in and
//! out, and secrets that must not leak.

use super::daemon::{Answer, Daemon, answer_of};
use super::websocket::Client;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::time::Duration;

const ROLES: [&str; 4] = ["viewer", "operator", "engineer", "admin"];
const PASSWORD: &str = "canary correct horse";

/// One request; `head` has the credentials. Of a stream, only the head of the answer is awaited.
/// `head` ends with a line end, if it is not empty.
pub(crate) fn ask(daemon: &Daemon, method: &str, path: &str, head: &str, body: &str) -> Answer {
    let mut stream = daemon.connect();
    let patience = Some(Duration::from_secs(60));
    stream.set_read_timeout(patience).expect("a socket");
    let (host, length) = (&daemon.address, body.len());
    write!(
        stream,
        "{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{head}\
         Content-Length: {length}\r\n\r\n{body}"
    )
    .expect("it takes bytes");
    let mut reader = BufReader::new(stream);
    let mut bytes = Vec::new();
    while !bytes.ends_with(b"\r\n\r\n") {
        let read = reader.read_until(b'\n', &mut bytes).expect("bytes");
        assert_ne!(read, 0, "{}", String::from_utf8_lossy(&bytes));
    }
    let head = String::from_utf8_lossy(&bytes).to_ascii_lowercase();
    match head.contains("transfer-encoding: chunked") {
        true => bytes.extend_from_slice(b"0\r\n\r\n"),
        false => drop(reader.read_to_end(&mut bytes).expect("bytes")),
    }
    answer_of(&bytes)
}

/// The header of a token of its own.
pub(crate) fn token(daemon: &Daemon, name: &str, role: &str, points: &[&str]) -> String {
    let wish = json!({ "name": name, "role": role, "points": points });
    let made = daemon.as_owner("POST", "/api/v1/tokens", &wish.to_string());
    let token = made.json()["token"].as_str().expect("a token").to_owned();
    format!("Authorization: Bearer {token}\r\n")
}

fn log_in(daemon: &Daemon, name: &str, password: &str) -> Answer {
    let body = json!({ "name": name, "password": password }).to_string();
    ask(daemon, "POST", "/api/v1/login", "", &body)
}

/// The key of the setup link.
fn key(daemon: &Daemon) -> &str {
    let (_, link) = daemon.told.split_once("/setup#k=").expect("a link");
    link.split_whitespace().next().expect("a key")
}

fn set_up(daemon: &Daemon) -> Answer {
    let key = key(daemon);
    let body = json!({ "key": key, "name": "li", "password": PASSWORD, "lang": "zh" });
    ask(daemon, "POST", "/api/v1/setup", "", &body.to_string())
}

/// The cookie that an answer sets.
fn cookie_of(answer: &Answer) -> String {
    let lines = answer.head.lines();
    let mut cookies = lines.filter_map(|line| line.strip_prefix("set-cookie: "));
    let cookie = cookies.next().expect("a cookie");
    cookie.split(';').next().expect("a pair").to_owned()
}

pub(crate) fn is_on(daemon: &Daemon, path: &str) -> Value {
    let point = format!("/api/v1/points/{}?fresh=1", path.replace('.', "/"));
    daemon.as_owner("GET", &point, "").json()["value"].clone()
}

/// Method, address and least role of every route in the daemon's own document; none for public
/// routes, `owner` for those of the socket.
fn routes(daemon: &Daemon) -> Vec<(String, String, Option<String>)> {
    let document = ask(daemon, "GET", "/api/v1/openapi.json", "", "").json();
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

/// An address of a route, with names that do not exist.
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
    let tokens = ROLES.map(|role| token(&daemon, role, role, &[]));
    let routes = routes(&daemon);
    assert!(routes.len() >= 25, "{}", routes.len());
    for (method, path, need) in routes {
        let ask = |headers: &str| ask(&daemon, &method, &filled(&path), headers, "");
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
                    assert_eq!(answer.end(), (401, "E0902".into()), "{what}");
                    assert!(answer.head.contains("www-authenticate: bearer"), "{what}");
                }
            }
        }
        let Some(Some(least)) = least else {
            continue;
        };
        for (at, token) in tokens.iter().enumerate() {
            let answer = ask(token);
            let refused = answer.end().1 == "E0905";
            assert_eq!(
                refused,
                at < least,
                "{what} as {}: {}",
                ROLES[at],
                answer.text()
            );
            assert_eq!(answer.status == 403, refused, "{what} as {}", ROLES[at]);
            assert_ne!(answer.status, 401, "{what} as {}", ROLES[at]);
        }
    }
}

/// The names of all topics of the WebSocket from the daemon's own list, for things that exist.
fn topics(daemon: &Daemon) -> Vec<String> {
    let mut client = Client::open(daemon);
    client.send(r#"{"sub":["nothing"]}"#);
    let told = client.until("what it knows", |message| message["type"] == "problem");
    let begun = daemon.send("POST", "/api/v1/scans", r#"{"lines":["main"]}"#);
    let op = begun.json()["op"].as_str().expect("a number").to_owned();
    let known = told["problem"]["known"].as_array().expect("a list").iter();
    let names = known.map(|name| name.as_str().expect("a name"));
    let there = [
        ("MODULE", "pump"),
        ("LABEL", "do0"),
        ("LINE", "main"),
        ("ID", &op),
    ];
    let put = |name: String, (word, thing): &(&str, &str)| name.replace(word, thing);
    names
        .map(|name| there.iter().fold(name.to_owned(), put))
        .collect()
}

#[test]
fn every_topic_is_told_to_whom_it_may_be() {
    let daemon = Daemon::demo("topics");
    let topics = topics(&daemon);
    assert!(topics.len() >= 9, "{topics:?}");
    let stream = || Box::new(daemon.connect());
    let host = format!("Host: {}\r\n", daemon.address);
    for stranger in ["", "Authorization: Bearer rb_0\r\n"] {
        let refused = Client::over(stream(), &format!("{host}{stranger}"), "/api/v1/ws");
        assert_eq!(refused.err(), Some(401), "{stranger}");
    }
    // It takes no commands: a viewer may subscribe to everything.
    for role in ROLES {
        let head = format!("{host}{}", token(&daemon, role, role, &[]));
        let client = Client::over(stream(), &head, "/api/v1/ws");
        let mut client = client.unwrap_or_else(|status| panic!("{role}: {status}"));
        for topic in &topics {
            client.send(&json!({ "sub": [topic] }).to_string());
            let what = format!("{topic} for {role}");
            client.until(&what, |message| {
                assert_ne!(message["type"], "problem", "{what}: {message}");
                message["topic"] == topic.as_str()
            });
        }
        client.send(r#"{"set":{"pump.do0":true}}"#);
        client.until("it is no order", |message| message["type"] == "problem");
    }
    assert_eq!(is_on(&daemon, "pump.do0"), false);
}

#[test]
fn rights_of_points_hold_on_every_way_to_switch() {
    let daemon = Daemon::demo("points");
    let token = token(&daemon, "pump", "operator", &["pump.*"]);
    let ask = |method: &str, path: &str, body: &str| {
        ask(&daemon, method, &format!("/api/v1{path}"), &token, body)
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
            answer.text().contains("E0906"),
            "{path}: {} {}",
            answer.status,
            answer.text()
        );
    }
    assert_eq!(is_on(&daemon, "oven.k1"), false);
    assert_eq!(is_on(&daemon, "pump.do1"), true);
}

#[test]
fn sessions_outlive_the_daemon_until_they_are_ended() {
    let folder = super::daemon::folder("outlive");
    let file = folder.join("railbus.toml");
    std::fs::write(&file, "# Nothing yet.\n").expect("a file");
    let file = file.to_str().expect("text").to_owned();
    let arguments = ["--config", file.as_str()];
    let mut daemon = Daemon::start_in(folder, &arguments);
    let [first, second, third] = [set_up(&daemon), log_in(&daemon, "li", PASSWORD), {
        let other = Daemon::demo("outlive-other");
        let first = set_up(&other);
        let name = |answer: &Answer| cookie_of(answer).split('=').next().map(str::to_owned);
        let ours = log_in(&daemon, "li", PASSWORD);
        assert_ne!(
            name(&first),
            name(&ours),
            "one jar holds the cookies of both"
        );
        ours
    }];
    let head = |answer: &Answer| {
        let csrf = answer.json()["csrf"].as_str().expect("a token").to_owned();
        format!("Cookie: {}\r\nX-CSRF-Token: {csrf}\r\n", cookie_of(answer))
    };
    let [first, second, third] = [first, second, third].map(|answer| head(&answer));
    let status = |daemon: &Daemon, head: &str| {
        let body = r#"{"text":""}"#;
        ask(daemon, "POST", "/api/v1/config/check", head, body).status
    };
    assert_eq!(status(&daemon, &first), 200);
    // However the daemon ends, right after its answers.
    let out = ask(&daemon, "POST", "/api/v1/logout", &second, "");
    assert_eq!(out.status, 200, "{}", out.text());
    let _ = daemon.child.kill();
    daemon.start_again(&arguments);
    assert_eq!(status(&daemon, &first), 200);
    assert_eq!(status(&daemon, &second), 401, "it has logged out");
    assert_eq!(status(&daemon, &third), 200);
    let new = json!({ "old": PASSWORD, "new": "another canary horse" }).to_string();
    let changed = ask(&daemon, "POST", "/api/v1/password", &first, &new);
    assert_eq!(changed.status, 200, "{}", changed.text());
    let _ = daemon.child.kill();
    daemon.start_again(&arguments);
    assert_eq!(status(&daemon, &first), 200);
    assert_eq!(status(&daemon, &third), 401, "the password was changed");
}

#[test]
fn the_first_user_comes_by_the_link_and_nobody_after() {
    let daemon = Daemon::demo("setup");
    let before = ask(&daemon, "GET", "/api/v1/session", "", "").json();
    assert_eq!(
        (&before["user"], &before["setup"]),
        (&Value::Null, &json!(true))
    );
    assert_eq!(before["demo"], true);
    let wrong = json!({ "key": "AAAA", "name": "li", "password": PASSWORD }).to_string();
    let wrong = ask(&daemon, "POST", "/api/v1/setup", "", &wrong);
    assert_eq!(wrong.end(), (403, "E0909".into()));
    let first = set_up(&daemon);
    assert_eq!(first.status, 200, "{}", first.text());
    assert_eq!(first.json()["user"]["role"], "admin");
    assert_eq!(first.json()["lang"], "zh");
    for part in ["httponly", "samesite=strict", "path=/"] {
        assert!(first.head.contains(part), "{}", first.head);
    }
    let again = set_up(&daemon);
    assert_eq!(again.end(), (409, "E0919".into()));
}

#[test]
fn a_session_needs_its_token_to_change_anything_and_ends() {
    let daemon = Daemon::demo("session");
    let first = set_up(&daemon);
    let cookie = format!("Cookie: {}\r\n", cookie_of(&first));
    let csrf = first.json()["csrf"].as_str().expect("a token").to_owned();
    let ours = format!("{cookie}X-CSRF-Token: {csrf}\r\n");
    let path = "/api/v1/points/pump/do0";
    let on = r#"{"value":true}"#;
    assert_eq!(ask(&daemon, "GET", path, &cookie, "").status, 200);
    let alone = ask(&daemon, "PUT", path, &cookie, on);
    assert_eq!(alone.end(), (403, "E0908".into()));
    let wrong = format!("{cookie}X-CSRF-Token: 0\r\n");
    assert_eq!(ask(&daemon, "PUT", path, &wrong, on).status, 403);
    assert_eq!(is_on(&daemon, "pump.do0"), false);
    assert_eq!(ask(&daemon, "PUT", path, &ours, on).status, 200);
    let told = ask(&daemon, "GET", "/api/v1/session", &cookie, "").json();
    assert_eq!(
        told["csrf"],
        csrf.as_str(),
        "a page that is loaded again finds it"
    );
    let sessions = ask(&daemon, "GET", "/api/v1/sessions", &cookie, "").json();
    assert_eq!(sessions["sessions"][0]["current"], true);

    let new = json!({ "old": PASSWORD, "new": "another canary horse" }).to_string();
    let second = log_in(&daemon, "li", PASSWORD);
    let other = format!("Cookie: {}\r\n", cookie_of(&second));
    assert_eq!(
        ask(&daemon, "POST", "/api/v1/password", &ours, &new).status,
        200
    );
    assert_eq!(
        ask(&daemon, "GET", path, &other, "").status,
        401,
        "it has ended"
    );
    assert_eq!(ask(&daemon, "GET", path, &cookie, "").status, 200);
    let out = ask(&daemon, "POST", "/api/v1/logout", &ours, "");
    assert!(out.head.contains("max-age=0"), "{}", out.head);
    assert_eq!(ask(&daemon, "GET", path, &cookie, "").status, 401);
}

#[test]
fn guessing_is_slow_and_tells_nothing() {
    let daemon = Daemon::demo("guess");
    set_up(&daemon);
    let known = log_in(&daemon, "li", "wrong");
    let unknown = log_in(&daemon, "nobody", "wrong");
    assert_eq!((known.status, &known.text()), (401, &unknown.text()));
    for _ in 0..3 {
        assert_eq!(log_in(&daemon, "nobody", "wrong").status, 401);
    }
    let refused = log_in(&daemon, "li", PASSWORD);
    assert_eq!(refused.end(), (429, "E0907".into()));
    assert!(
        refused.json()["retry_after_ms"].is_u64(),
        "{}",
        refused.text()
    );
    assert!(refused.head.contains("retry-after: "), "{}", refused.head);
}

#[test]
fn what_streams_ends_with_the_rights_to_it() {
    let daemon = Daemon::demo("stream");
    let token = token(&daemon, "eyes", "viewer", &[]);
    let stream = daemon.connect();
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
    daemon.as_owner("DELETE", "/api/v1/tokens/eyes", "");
    // The connection is closed by the server; otherwise a read times out and fails.
    std::io::copy(&mut stream, &mut std::io::sink()).expect("an end");
    assert_eq!(ask(&daemon, "GET", "/api/v1/lines", &token, "").status, 401);
}

#[test]
fn no_secret_comes_out_again() {
    let mut daemon = Daemon::demo("canary");
    let first = set_up(&daemon);
    let cookie = cookie_of(&first);
    let secret_cookie = cookie.split('=').nth(1).expect("a value").to_owned();
    let token = token(&daemon, "canary", "admin", &[]);
    let secret_token = token.trim().rsplit(' ').next().expect("a token").to_owned();
    log_in(&daemon, "li", "wrong canary guess");
    log_in(&daemon, "canary typed into the name", "x");
    let user = json!({ "name": "wang", "role": "viewer", "password": "second canary horse" });
    assert_eq!(
        daemon
            .as_owner("POST", "/api/v1/users", &user.to_string())
            .status,
        200
    );
    let broken = r#"{"name":"zhao","role":"viewer","password":["canary broken"]}"#;
    let broken = ask(&daemon, "POST", "/api/v1/users", &token, broken);
    assert_eq!(broken.status, 422);
    let mut told = vec![broken.text().to_owned()];
    for (method, path, _) in routes(&daemon) {
        if method == "GET" {
            let answer = ask(&daemon, "GET", &filled(&path), &token, "");
            told.push(answer.head.clone() + answer.text());
        }
    }
    for path in ["/", "/metrics", "/api/v1/session"] {
        told.push(ask(&daemon, "GET", path, &token, "").text().to_owned());
    }
    let _ = daemon.child.kill();
    let _ = daemon.child.wait();
    let log = daemon.stderr();
    assert!(log.contains("login: li via http: logged in"), "{log}");
    told.push(log);
    // As the file of accounts has them; the word alone stands in texts about signatures.
    let hashes = ["$argon2id$", "\"sha256\""];
    let phrases = [
        "canary correct",
        "canary guess",
        "canary horse",
        "canary typed",
        "canary broken",
    ];
    let secrets = [secret_cookie.as_str(), secret_token.as_str(), key(&daemon)];
    for text in &told {
        for secret in hashes.iter().chain(&phrases).chain(&secrets) {
            assert!(!text.contains(secret), "{secret} in {text}");
        }
    }
}

/// The connection is closed while the new password is hashed. If it is closed earlier, the request
/// is dropped, which is correct as well; so it is repeated, each time closed a little later.
#[test]
fn a_change_of_an_account_is_made_and_told_though_the_caller_has_gone() {
    let daemon = Daemon::start("access-gone", &["--demo"]);
    assert_eq!(set_up(&daemon).status, 200);
    let token = token(&daemon, "boss", "admin", &[]);
    let host = &daemon.address;
    let mut gone = Vec::new();
    let ask_and_go = |nth: u64| {
        let name = format!("wang{nth}");
        let user = json!({ "name": name, "role": "viewer", "password": PASSWORD }).to_string();
        let length = user.len();
        let mut stream = daemon.connect();
        write!(
            stream,
            "POST /api/v1/users HTTP/1.1\r\nHost: {host}\r\n{token}\
             Content-Length: {length}\r\n\r\n{user}"
        )
        .expect("it takes bytes");
        std::thread::sleep(Duration::from_millis(nth));
        stream.set_nonblocking(true).expect("a socket");
        let is_answered = stream.peek(&mut [0]).is_ok();
        drop(stream);
        if !is_answered {
            gone.push(name);
        }
        (0..20).find_map(|_| {
            std::thread::sleep(Duration::from_millis(25));
            let users = daemon.as_owner("GET", "/api/v1/users", "");
            let is_made = |name: &&String| users.text().contains(&format!("\"{name}\""));
            gone.iter().find(is_made).cloned()
        })
    };
    let name = (0..100).find_map(ask_and_go).expect("one was made");
    let told = || {
        let path = "/api/v1/events?kind=login";
        let events = daemon.as_owner("GET", path, "").json();
        let is_it = |event: &&Value| event["code"] == "user_added" && event["what"] == *name;
        let events = events["items"].as_array().expect("events");
        events.iter().find(is_it).map(|event| event["who"].clone())
    };
    let told = (0..200).find_map(|_| {
        std::thread::sleep(Duration::from_millis(50));
        told()
    });
    assert_eq!(told, Some("token:boss".into()));
}

/// A name that is used again belongs to another account.
#[test]
fn keys_of_a_token_or_a_user_that_is_no_more_are_nobodys() {
    let daemon = Daemon::demo("access-again");
    assert_eq!(set_up(&daemon).status, 200);
    let toggle = |head: &str| {
        let head = format!("{head}Idempotency-Key: one\r\n");
        let end = ask(&daemon, "POST", "/api/v1/points/oven/k1/toggle", &head, "");
        end.json()["value"].clone()
    };
    let first = token(&daemon, "plc", "operator", &[]);
    let on = toggle(&first);
    assert_eq!(toggle(&first), on, "it is done once");
    assert_eq!(
        daemon.as_owner("DELETE", "/api/v1/tokens/plc", "").status,
        200
    );
    let second = token(&daemon, "plc", "operator", &[]);
    assert_ne!(toggle(&second), on);

    let user = json!({ "name": "wang", "role": "operator", "password": PASSWORD }).to_string();
    let mut states = Vec::new();
    for _ in 0..2 {
        assert_eq!(daemon.as_owner("POST", "/api/v1/users", &user).status, 200);
        let session = log_in(&daemon, "wang", PASSWORD);
        let csrf = session.json()["csrf"].as_str().expect("text").to_owned();
        let cookie = cookie_of(&session);
        states.push(toggle(&format!(
            "Cookie: {cookie}\r\nX-CSRF-Token: {csrf}\r\n"
        )));
        assert_eq!(
            daemon.as_owner("DELETE", "/api/v1/users/wang", "").status,
            200
        );
    }
    assert_ne!(states[0], states[1]);
    assert!(states.iter().all(Value::is_boolean), "{states:?}");
}
