//! Clients that flood the daemon: they send nothing, or too much, or open many connections.

use crate::daemon::Daemon;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// More connections than are allowed at a time.
const CROWD: usize = 200;
/// The limit, as the daemon reports it.
const ROOM: usize = 128;
/// What a daemon has open besides its connections: files, sockets, pipes.
const BESIDE: usize = 64;
/// A whole head must come within 10 s; the flood gets two turns, and a machine may be slow.
const PATIENCE: Duration = Duration::from_secs(90);

/// The moment at which a point was last read.
fn read_at(daemon: &Daemon) -> String {
    let mut stream = daemon.connect_to_socket();
    let path = "/api/v1/points/pump/do0";
    let answer = crate::daemon::exchange(&mut stream, "GET", path, "Host: any\r\n", "");
    answer.json()["time"].as_str().expect("a time").to_owned()
}

/// A client that sends half a request is disconnected, and while they all are connected, lines are
/// polled and the daemon's own user is served.
#[test]
fn who_sends_half_a_request_is_closed_and_holds_nothing_up() {
    let daemon = Daemon::demo("loris");
    let half = b"GET /api/v1/points HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ";
    let crowd: Vec<TcpStream> = (0..CROWD)
        .map(|_| {
            let mut stream = daemon.connect();
            stream.write_all(half).expect("it takes bytes");
            stream
        })
        .collect();
    let open = daemon.open_files();
    assert!(open <= ROOM + BESIDE, "{open} open files");
    let before = read_at(&daemon);
    daemon.until("the line is polled", |daemon| read_at(daemon) != before);

    let begun = Instant::now();
    for mut stream in crowd {
        // A byte now and then does not help.
        let _ = stream.write_all(b"a");
        stream.set_read_timeout(Some(PATIENCE)).expect("a socket");
        let mut rest = Vec::new();
        let _ = stream.read_to_end(&mut rest);
        assert!(begun.elapsed() < PATIENCE, "it is still let wait");
        let said = String::from_utf8_lossy(&rest);
        assert!(!said.starts_with("HTTP/1.1 200"), "{said}");
    }
    assert_eq!(daemon.get("/api/v1/points").status, 200);
}

/// A WebSocket message of 64 KB is accepted, and a longer one ends only its own connection.
#[test]
fn long_messages_end_their_own_connection_alone() {
    let daemon = Daemon::demo("long");
    let mut long = crate::websocket::Client::open(&daemon);
    let mut other = crate::websocket::Client::open(&daemon);
    other.send(r#"{"sub":["points/pump/do0"]}"#);
    other.until("a snapshot", |message| message["type"] == "snapshot");
    long.send(&format!("{{\"x\":\"{}\"}}", "x".repeat(1 << 20)));
    while long.next().is_some() {}
    let before = read_at(&daemon);
    daemon.until("the line is polled", |daemon| read_at(daemon) != before);
    daemon.send("PUT", "/api/v1/points/pump/do0", r#"{"value":true}"#);
    other.until("the others are told", |message| {
        message.to_string().contains("pump.do0")
    });
}

/// A client with a whole request is answered while a thousand others send half of one, and
/// reconnect as fast as they are disconnected.
#[test]
fn a_thousand_who_send_half_a_request_keep_nobody_waiting() {
    let many = rustix::process::getrlimit(rustix::process::Resource::Nofile);
    let most = rustix::process::Rlimit {
        current: many.maximum,
        ..many
    };
    rustix::process::setrlimit(rustix::process::Resource::Nofile, most).expect("more files");
    let daemon = Daemon::demo("thousand");
    let half = b"GET /api/v1/points HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ";
    let more = |crowd: &mut Vec<TcpStream>, count| {
        for _ in 0..count {
            let mut stream = daemon.connect();
            // It may be closed already.
            let _ = stream.write_all(half);
            crowd.push(stream);
        }
    };
    let ask = || {
        let begun = Instant::now();
        assert_eq!(daemon.get("/api/v1/lines").status, 200);
        begun.elapsed()
    };
    let alone = (0..20).map(|_| ask()).max().unwrap_or_default();
    let mut crowd = Vec::new();
    more(&mut crowd, 1_000);
    for _ in 0..20 {
        let waited = ask();
        let most = Duration::from_secs(1).max(alone * 20);
        assert!(waited < most, "{waited:?}, alone {alone:?}");
        more(&mut crowd, 20);
    }
    let open = daemon.open_files();
    assert!(open <= ROOM + BESIDE, "{open} open files");
}
