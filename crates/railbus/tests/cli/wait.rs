//! `railbus wait`: through the daemon and on a line opened here.

use crate::dead::{plant, power};
use crate::published::keeps_to;
use crate::site::{Ran, Site};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// What must hold with and without a daemon.
fn waits(site: &Site, flags: &[&str]) {
    let run = |line: &str| {
        let line = format!("{} {line}", flags.join(" "));
        site.run(line.trim())
    };
    let there = run("wait pump.do1=off tank.k1=OFF tank.ai1=-10..20 -o csv");
    let lines: Vec<&str> = there.out.lines().collect();
    assert_eq!(there.code, 0, "{there:?}");
    assert_eq!(lines[0], "time,path,value,unit,quality,took_ms");
    assert!(lines[1].contains(",pump.do1,off,,good,"), "{there:?}");
    assert_eq!(lines.len(), 4, "{there:?}");

    // It comes while it is waited for, however slow the machine is.
    let mut command = site.command();
    command.args(flags);
    command.args(["wait", "pump.di1=on", "--timeout", "60s", "-o", "value"]);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let waiting = command.spawn().expect("it starts");
    assert_eq!(
        site.run_with(&["sim", "ctl", "ctl", "pump.di1 = 1"], "")
            .code,
        0
    );
    let ended = waiting.wait_with_output().expect("it ends");
    assert_eq!(ended.status.code(), Some(0), "{ended:?}");
    assert_eq!(ended.stdout, b"on\n");

    let vain = run("wait pump.di1=off tank.ai2=99 --timeout 3s");
    assert_eq!((vain.code, vain.out.as_str()), (12, ""), "{vain:?}");
    let told: Vec<&str> = vain.err.lines().collect();
    assert_eq!(told[0], "error[E1201]: not reached within 3.0 s");
    assert!(
        told[1].contains("waiting for pump.di1=off: it is on, read "),
        "{vain:?}"
    );
    assert!(
        told[2].contains("waiting for tank.ai2=99: it is "),
        "{vain:?}"
    );
    let json = run("-o json wait pump.di1=off --timeout 3s");
    keeps_to(site, "-o json wait", &json);
    let error = json.error();
    assert_eq!(error["points"][0]["value"], true, "{error}");
    assert!(error["points"][0]["age_ms"].is_u64(), "{error}");

    for wrong in [
        "pump.di1",
        "pump=on",
        "*.di1=on",
        "tank.ai1=on",
        "pump.di1=7",
    ] {
        let ran: Ran = run(&format!("wait {wrong}"));
        assert_eq!(ran.code, 2, "{wrong}: {ran:?}");
    }
    assert_eq!(run("wait pump.no=on").code, 8);

    // A value that is unknown now does not count, though it is the wanted one.
    power(site, "oven", "off");
    if !flags.is_empty() {
        let is_missed = (0..400).any(|_| run("get oven.k1 -o value").out == "?\n");
        assert!(is_missed, "the daemon hears nothing more");
    }
    let dead = run("wait oven.k1=off --timeout 8s");
    let known = flags.is_empty().then_some("never read");
    assert_eq!(dead.code, 12, "{dead:?}");
    assert!(dead.err.contains(known.unwrap_or("offline")), "{dead:?}");
}

#[test]
fn through_the_daemon_it_waits_for_what_happens() {
    let mut site = plant("wait-daemon", "");
    site.serve();
    let socket = site.socket();
    waits(&site, &["--socket", &socket]);
}

#[test]
fn it_waits_on_a_line_opened_here() {
    let site = plant("wait-line", "");
    waits(&site, &[]);
}

/// Answers of a process that looks like a daemon.
enum Answer {
    Whole(Value),
    /// One line, and then nothing more.
    Stream(Value),
    Nothing,
}

/// By the path of the request.
type Answers = fn(&str) -> Answer;

/// Puts one at the socket of a site.
fn daemon(site: &Site, answer: Answers) {
    let listener = UnixListener::bind(site.socket()).expect("a socket");
    let reply = move |mut stream: UnixStream| {
        let mut head = [0; 4096];
        let len = stream.read(&mut head).unwrap_or_default();
        let head = String::from_utf8_lossy(&head[..len]).into_owned();
        let path = head.split(' ').nth(1).unwrap_or_default();
        let told = match answer(path) {
            Answer::Whole(told) => {
                let told = told.to_string();
                format!("content-length: {}\r\n\r\n{told}", told.len())
            }
            Answer::Stream(told) => {
                let told = format!("{told}\n");
                format!(
                    "transfer-encoding: chunked\r\n\r\n{:x}\r\n{told}\r\n",
                    told.len()
                )
            }
            Answer::Nothing => return stream,
        };
        let _ = stream.write_all(format!("HTTP/1.1 200 OK\r\n{told}").as_bytes());
        stream
    };
    std::thread::spawn(move || {
        let mut open = Vec::new();
        for stream in listener.incoming() {
            open.push(reply(stream.expect("a connection")));
        }
    });
}

fn whose() -> Answer {
    Answer::Whole(json!({ "schema": 1, "demo": false, "config": "/c", "state": "/s" }))
}

fn di1(on: bool) -> Value {
    json!({
        "path": "p.di1", "module": "p", "label": "di1", "kind": "input", "index": 1, "value": on,
        "quality": "good", "age_ms": 1,
    })
}

fn told(event: &Value) -> Answer {
    let mut event = event.clone();
    event["ev"] = "point".into();
    Answer::Stream(event)
}

/// A value can come, or be good again, at the last moment, without an update in time.
#[test]
fn what_is_reached_when_the_time_is_over_is_reached() {
    let site = Site::empty("wait-last");
    daemon(&site, |path| match path {
        "/api/v1/site" => whose(),
        path if path.starts_with("/api/v1/watch") => told(&di1(false)),
        _ => Answer::Whole(json!({ "schema": 1, "points": [di1(true)] })),
    });
    let socket = site.socket();
    let ran = site.run(&format!(
        "--socket {socket} wait p.di1=on --timeout 1s -o value"
    ));
    assert_eq!((ran.code, ran.out.as_str()), (0, "on\n"), "{ran:?}");
    let vain = site.run(&format!(
        "--socket {socket} wait p.di1=off p.di0=on --timeout 1s"
    ));
    assert_eq!(vain.code, 12, "{vain:?}");
}

/// The daemon stops answering at this step or that.
#[test]
fn it_waits_no_longer_than_was_said() {
    let never: [(&str, Answers); 3] = [
        ("site", |_| Answer::Nothing),
        ("watch", |path| match path {
            "/api/v1/site" => whose(),
            _ => Answer::Nothing,
        }),
        ("points", |path| match path {
            "/api/v1/site" => whose(),
            path if path.starts_with("/api/v1/watch") => told(&di1(false)),
            _ => Answer::Nothing,
        }),
    ];
    for (step, answer) in never {
        let site = Site::empty(&format!("wait-{step}"));
        daemon(&site, answer);
        let begun = Instant::now();
        let line = format!("--socket {} wait p.di1=on --timeout 1s", site.socket());
        let ran = site.run(&line);
        assert!(begun.elapsed() < Duration::from_secs(5), "{step}");
        assert_eq!(ran.code, 12, "{step}: {ran:?}");
        let mut lines = ran.err.lines();
        assert_eq!(lines.next(), Some("error[E1201]: not reached within 1.0 s"));
        assert!(
            ran.err
                .contains("p.di1=on: it could not be read in this time"),
            "{step}: {ran:?}"
        );
    }
}
