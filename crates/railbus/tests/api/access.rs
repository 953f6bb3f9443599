//! Who may do what at `railbus serve`: every route of its document with every role, logging in and
//! out, and secrets that must not come out.

use super::daemon::{Answer, Daemon, answer_of};
use super::websocket::Client;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::time::Duration;

const ROLES: [&str; 4] = ["viewer", "operator", "engineer", "admin"];
const PASSWORD: &str = "canary correct horse";

/// One request of whom the head names. Of an answer that streams on and on, only the head is
/// waited for. `head` ends with a line's end, if it is not empty.
fn ask(daemon: &Daemon, method: &str, path: &str, head: &str, body: &str) -> Answer {
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
fn token(daemon: &Daemon, name: &str, role: &str, points: &[&str]) -> String {
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

fn is_on(daemon: &Daemon, path: &str) -> Value {
    let point = format!("/api/v1/points/{}?fresh=1", path.replace('.', "/"));
    daemon.as_owner("GET", &point, "").json()["value"].clone()
}

/// Method, address and least role of every route in the daemon's own document; none for routes
/// that anybody may use, `owner` for those of the socket.
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

/// The names of all topics of the WebSocket, by the daemon's own word, of things that there are.
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
    // Nothing can be done over it: whoever may look may hear all.
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

/// What somebody who is limited to `pump` could do to reach `oven` all the same.
const WAYS_ROUND: [(&str, &str, &str); 25] = [
    (
        "PUT",
        "/config",
        r#"{"text":"[line.x]\nport = \"/dev/ttyS7\"\n"}"#,
    ),
    ("POST", "/config/undo", "{}"),
    (
        "POST",
        "/config/lines",
        r#"{"line":"x","port":"/dev/ttyS7"}"#,
    ),
    ("PATCH", "/config/lines/main", r#"{"baud":19200}"#),
    ("DELETE", "/config/lines/main?modules=1", ""),
    (
        "POST",
        "/config/modules",
        r#"{"modules":[{"name":"pump2","line":"main","model":"erc8","address":2}]}"#,
    ),
    ("PATCH", "/config/modules/oven", r#"{"rename":"pump2"}"#),
    (
        "PATCH",
        "/config/modules/pump",
        r#"{"address":2,"model":"erc8"}"#,
    ),
    ("DELETE", "/config/modules/oven", ""),
    ("PATCH", "/config/points/oven/k1", r#"{"on_return":"on"}"#),
    ("PATCH", "/config/points/oven/k1", r#"{"name":"mine"}"#),
    (
        "PATCH",
        "/config/points/pump/do0",
        r#"{"interlock":["oven.k1"]}"#,
    ),
    (
        "PATCH",
        "/config/points/pump/do0",
        r#"{"name":"x","max_on":"1s"}"#,
    ),
    ("PUT", "/config/groups/mine", r#"{"members":["oven.k1"]}"#),
    (
        "PUT",
        "/config/scenes/mine",
        r#"{"steps":[{"set":"oven.k1","to":true}]}"#,
    ),
    (
        "PUT",
        "/rules/mine",
        r#"{"when":{"point":"pump.di0","is":"on"},"then":[{"set":"oven.k1","to":true}]}"#,
    ),
    ("POST", "/rules/mine/arm", ""),
    ("PUT", "/webhooks/mine", r#"{"url":"https://example.com/"}"#),
    (
        "PATCH",
        "/modules/pump/settings",
        r#"{"settings":{"address":2}}"#,
    ),
    ("POST", "/modules/pump/settings/undo", "{}"),
    ("PUT", "/sim/main/oven", r#"{"power":false}"#),
    ("POST", "/sim/main/oven/faults", r#"{"faults":"welded=k1"}"#),
    ("POST", "/scans", r#"{"lines":["main"]}"#),
    ("POST", "/tokens", r#"{"name":"free","role":"admin"}"#),
    ("PATCH", "/users/li", r#"{"points":[]}"#),
];

#[test]
fn who_is_limited_to_points_reaches_no_other_by_any_way() {
    let daemon = Daemon::demo("limited");
    let text = || daemon.as_owner("GET", "/api/v1/config", "").json()["text"].clone();
    let before = text();
    for role in ["engineer", "admin"] {
        let token = token(&daemon, role, role, &["pump.*"]);
        let any = format!("{token}If-Match: *\r\n");
        let ask = |method: &str, path: &str, body: &str| {
            ask(&daemon, method, &format!("/api/v1{path}"), &any, body)
        };
        for (method, path, body) in WAYS_ROUND {
            let admins = ["/webhooks", "/tokens", "/users"];
            let is_admins = admins.iter().any(|only| path.starts_with(only));
            let code = match (role, is_admins) {
                ("engineer", true) => "E0905",
                _ if path.starts_with("/config/points/oven") => "E0906",
                _ => "E0922",
            };
            let answer = ask(method, path, body);
            let what = format!("{method} {path} {body} as {role}: {}", answer.text());
            assert_eq!(answer.end(), (403, code.to_owned()), "{what}");
        }
        assert_eq!(text(), before, "{role}");
        // It is told what is missing, in both languages.
        for (lang, word) in [("en", "pump.*"), ("zh", "权限")] {
            let any = format!("{any}Accept-Language: {lang}\r\n");
            let told = super::access::ask(&daemon, "POST", "/api/v1/config/undo", &any, "{}");
            assert!(told.text().contains(word), "{}", told.text());
        }
        // A frame of one's own: neither what a module keeps nor all modules at once.
        let kept = r#"{"protocol":"rtu","bytes":"01 06 00 00 00 02","complete":true}"#;
        let sent = ask("POST", "/lines/main/send", kept);
        assert_ne!(sent.status, 200, "{}", sent.text());
        // What is his own he may call as he likes, and the rest is his to look at.
        let named = ask(
            "PATCH",
            "/config/points/pump/do0",
            r#"{"name":"Feed pump"}"#,
        );
        assert_eq!(named.status, 200, "{}", named.text());
        let back = json!({ "text": before }).to_string();
        let owner = daemon.as_owner("GET", "/api/v1/config", "").json()["etag"].clone();
        let head = format!("Host: railbus\r\nIf-Match: {owner}\r\n");
        let socket = daemon.connect_to_socket();
        let put = super::daemon::exchange(socket, "PUT", "/api/v1/config", &head, &back);
        assert_eq!(put.status, 200, "{}", put.text());
        for path in ["/config", "/config/generations", "/rules", "/ports"] {
            assert_eq!(ask("GET", path, "").status, 200, "{path}");
        }
    }
    assert_eq!(is_on(&daemon, "oven.k1"), false);
}

#[test]
fn what_administrators_say_comes_from_them_however_it_is_made() {
    let daemon = Daemon::demo("bring");
    let [engineer, admin] = ["engineer", "admin"].map(|role| token(&daemon, role, role, &[]));
    let any = |token: &str| format!("{token}If-Match: *\r\n");
    let put = |token: &str, text: &str| {
        let body = json!({ "text": text }).to_string();
        ask(&daemon, "PUT", "/api/v1/config", &any(token), &body)
    };
    let text = daemon.as_owner("GET", "/api/v1/config", "").json()["text"].clone();
    let text = text.as_str().expect("a text");
    let hook = "\n[webhook.x]\nurl = \"https://192.0.2.7/a\"\n";
    let with = format!("{text}{hook}");
    for brought in [with.clone(), format!("{text}\n[audit]\nrequired = true\n")] {
        let refused = put(&engineer, &brought);
        assert_eq!(refused.end(), (403, "E0905".into()), "{}", refused.text());
        assert_eq!(refused.json()["need"], "admin", "{}", refused.text());
    }
    let made = put(&admin, &with);
    assert_eq!(made.status, 200, "{}", made.text());
    // It stays as it is, whatever else an engineer says.
    let more = format!("{with}# Checked.\n");
    assert_eq!(put(&engineer, &more).status, 200);
    for changed in [
        text.to_owned(),
        more.replace("/a", "/b"),
        format!("{more}enabled = false\n"),
        more.replace("webhook.x", "webhook.y"),
    ] {
        let refused = put(&engineer, &changed);
        assert_eq!(refused.end(), (403, "E0905".into()), "{}", refused.text());
    }
    let kept = ask(&daemon, "GET", "/api/v1/config/generations", &engineer, "").json();
    let first = kept["generations"].as_array().and_then(|all| all.last());
    let first = first.expect("there are some")["id"].clone();
    let undo = |token: &str| {
        let body = json!({ "to": first }).to_string();
        ask(&daemon, "POST", "/api/v1/config/undo", token, &body)
    };
    assert_eq!(undo(&engineer).end(), (403, "E0905".into()), "{first}");
    assert_eq!(undo(&admin).status, 200);
    let back = ask(&daemon, "POST", "/api/v1/config/undo", &engineer, "{}");
    assert_eq!(back.end(), (403, "E0905".into()), "{}", back.text());
}

#[test]
fn a_configuration_from_the_network_leads_where_the_owner_allows() {
    let daemon = Daemon::demo("leads");
    let any = format!("{}If-Match: *\r\n", token(&daemon, "admin", "admin", &[]));
    let ask = |method: &str, path: &str, body: Value| {
        ask(
            &daemon,
            method,
            &format!("/api/v1{path}"),
            &any,
            &body.to_string(),
        )
    };
    let text = || daemon.as_owner("GET", "/api/v1/config", "").json()["text"].clone();
    let text = || text().as_str().expect("a text").to_owned();
    let at_start = text();
    for port in [
        "tcp:127.0.0.1:22",
        "mbtcp:192.0.2.7",
        "/etc/passwd",
        "/dev/tty/../mem",
        "pty:/dev/null",
    ] {
        let refused = (403, "E0924".to_owned());
        let line = json!({ "line": "x", "port": port });
        assert_eq!(ask("POST", "/config/lines", line).end(), refused, "{port}");
        let line = json!({ "port": port });
        assert_eq!(
            ask("PATCH", "/config/lines/main", line).end(),
            refused,
            "{port}"
        );
        let whole = format!("{at_start}\n[line.x]\nport = \"{port}\"\n");
        let whole = ask("PUT", "/config", json!({ "text": whole }));
        assert_eq!(whole.end(), refused, "{port}");
    }
    for url in [
        "http://127.0.0.1:22/",
        "http://localhost/",
        "https://[::1]/",
        "http://169.254.169.254/",
        "http://0.0.0.0:7485/",
    ] {
        let refused = (403, "E0925".to_owned());
        let hook = json!({ "url": url });
        assert_eq!(ask("PUT", "/webhooks/x", hook).end(), refused, "{url}");
        let whole = format!("{at_start}\n[webhook.x]\nurl = \"{url}\"\n");
        let whole = ask("PUT", "/config", json!({ "text": whole }));
        assert_eq!(whole.end(), refused, "{url}");
    }
    let allow = "[ports]\nallow = [\"tcp:127.0.0.1:*\"]\n[webhooks]\nallow = [\"127.0.0.1:9\"]\n";
    let allowing = format!("{at_start}\n{allow}");
    let own = ask("PUT", "/config", json!({ "text": allowing }));
    assert_eq!(own.end(), (403, "E0923".into()), "{}", own.text());
    assert_eq!(text(), at_start);

    // Serial ports may be, and networks of plants; a name is looked at when something is sent.
    let line = json!({ "line": "usb", "port": "/dev/ttyUSB77" });
    assert_eq!(ask("POST", "/config/lines", line).status, 200);
    let hook = json!({ "url": "http://10.11.12.13/", "enabled": false });
    assert_eq!(ask("PUT", "/webhooks/plant", hook).status, 200);
    let hook = json!({ "url": "http://127.1:9/", "enabled": false });
    assert_eq!(ask("PUT", "/webhooks/name", hook).status, 200);
    let tested = ask("POST", "/webhooks/name/test", json!({})).json();
    assert_eq!(tested["error"]["code"], "E0925", "{tested}");

    // The owner's word, by the socket; what was there at the start may come back.
    let etag = daemon.as_owner("GET", "/api/v1/config", "").json()["etag"].clone();
    let head = format!("Host: railbus\r\nIf-Match: {etag}\r\n");
    let body = json!({ "text": allowing }).to_string();
    let socket = daemon.connect_to_socket();
    let put = super::daemon::exchange(socket, "PUT", "/api/v1/config", &head, &body);
    assert_eq!(put.status, 200, "{}", put.text());
    let line = json!({ "line": "x", "port": "tcp:127.0.0.1:9" });
    assert_eq!(ask("POST", "/config/lines", line).status, 200);
    let hook = json!({ "url": "http://127.0.0.1:9/", "enabled": false });
    assert_eq!(ask("PUT", "/webhooks/x", hook).status, 200);

    // What the owner's file had at the start may come back, and nothing beside it.
    let folder = super::daemon::folder("leads-start");
    let file = folder.join("railbus.toml");
    std::fs::write(&file, "[line.far]\nport = \"tcp:127.0.0.1:9\"\n").expect("a file");
    let daemon = Daemon::start_in(folder, &["--config", file.to_str().expect("text")]);
    for (port, status) in [
        ("/dev/ttyS77", 200),
        ("tcp:127.0.0.1:9", 200),
        ("tcp:127.0.0.1:8", 403),
    ] {
        let line = json!({ "port": port }).to_string();
        let changed = daemon.send("PATCH", "/api/v1/config/lines/far", &line);
        assert_eq!(changed.status, status, "{port}: {}", changed.text());
    }
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
    // The end comes by itself: a read that finds none fails in time.
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
    let hashes = ["$argon2id$", "sha256"];
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
