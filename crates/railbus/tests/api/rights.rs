//! The limits of rights: a caller limited to points, one who is no administrator, and one who is
//! not the owner can't get around them.

use crate::access::{ask, is_on, token};
use crate::daemon::Daemon;
use serde_json::{Value, json};

/// What a caller limited to `pump` could try in order to reach `oven`.
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
        // The answer says what is missing, in both languages.
        for (lang, word) in [("en", "pump.*"), ("zh", "权限")] {
            let any = format!("{any}Accept-Language: {lang}\r\n");
            let told = crate::access::ask(&daemon, "POST", "/api/v1/config/undo", &any, "{}");
            assert!(told.text().contains(word), "{}", told.text());
        }
        // A raw frame: neither one that changes settings nor a broadcast.
        let kept = r#"{"protocol":"rtu","bytes":"01 06 00 00 00 02","complete":true}"#;
        let sent = ask("POST", "/lines/main/send", kept);
        assert_ne!(sent.status, 200, "{}", sent.text());
        // A caller may name its own points as it likes, and only read the rest.
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
    // It stays as it is, whatever else an engineer writes.
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

    // Serial ports may be, and networks of plants; a name is resolved when something is sent.
    let line = json!({ "line": "usb", "port": "/dev/ttyUSB77" });
    assert_eq!(ask("POST", "/config/lines", line).status, 200);
    let hook = json!({ "url": "http://10.11.12.13/", "enabled": false });
    assert_eq!(ask("PUT", "/webhooks/plant", hook).status, 200);
    let hook = json!({ "url": "http://127.1:9/", "enabled": false });
    assert_eq!(ask("PUT", "/webhooks/name", hook).status, 200);
    let tested = ask("POST", "/webhooks/name/test", json!({})).json();
    assert_eq!(tested["error"]["code"], "E0925", "{tested}");

    // The owner allows it over the socket; what was there at the start may come back.
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

    // What the owner's file had at the start may come back, and nothing else.
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
