//! What clients cost that follow a site over WebSockets or ask for its points, and how long a
//! change takes to all followers.
//!
//! 256 relays of boards of a few lines, over TCP; 200 of them a second change by themselves, and
//! are noticed by polling. A few of the clients measure, the others only read.

use crate::daemon::{Folder, address_in, build, start};
use crate::gateway::used;
use crate::latency::ask;
use crate::table::{Table, median, percentile};
use std::collections::HashMap;
use std::fmt;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Scope;
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

/// How many lines, and how many boards of eight relays hang on each.
const LINES: usize = 8;
const BOARDS: u8 = 4;
/// How far apart changes are.
const EVERY: Duration = Duration::from_millis(5);
/// How many subscribers there are, one case after the other, and the same again.
const CASES: [usize; 4] = [0, 1, 64, 500];
const ROUNDS: usize = 3;
/// How long each case lasts, once all have their first picture.
const ROUND: Duration = Duration::from_secs(5);
const WARM_UP: Duration = Duration::from_secs(1);
/// How many of them measure.
const JUDGES: usize = 8;
/// What is requested, what of it, and how often in a row, on one connection.
const GETS: [(&str, &str, u32); 2] = [
    ("/api/v1/points/b0_1/k1", "one point", 10_000),
    ("/api/v1/points", "all 256 points", 5_000),
];
/// How far behind the plant may fall before changes are left out.
const BEHIND_MAX: Duration = Duration::from_millis(200);

/// When each relay last changed, by its path.
type Changed = Mutex<HashMap<String, Instant>>;

/// What changes, and when the next one does.
struct Plant {
    changed: Changed,
    due: Mutex<(Instant, u32)>,
    count: AtomicUsize,
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Plant {
    /// Changes a relay of a board, if it is time.
    fn change(&self, line: usize, board: u8, relays: &mut u8) {
        let mut due = lock(&self.due);
        let now = Instant::now();
        if now < due.0 {
            return;
        }
        due.0 = (due.0 + EVERY).max(now - BEHIND_MAX);
        due.1 += 1;
        let relay = due.1 * 5 % 8;
        *relays ^= 1 << relay;
        self.count.fetch_add(1, Ordering::Relaxed);
        let path = format!("b{line}_{board}.k{}", relay + 1);
        lock(&self.changed).insert(path, now);
    }

    /// Answers reads of coils, function 01, until the daemon has gone.
    fn serve(&self, line: usize, mut stream: TcpStream) {
        let _ = stream.set_nodelay(true);
        let mut relays = [0_u8; BOARDS as usize + 1];
        let mut request = [0; 64];
        while let Ok(length @ 8..) = stream.read(&mut request) {
            let (board, function) = (request[0], request[1]);
            let Some(state) = relays.get_mut(usize::from(board)) else {
                continue;
            };
            let mut reply = match function {
                1 => {
                    self.change(line, board, state);
                    vec![board, 1, 1, *state >> request[3].saturating_sub(60)]
                }
                other => vec![board, other | 0x80, 1],
            };
            reply.extend(railbus_wire::crc16(&reply).to_le_bytes());
            if length < 8 || stream.write_all(&reply).is_err() {
                return;
            }
        }
    }
}

/// A subscriber of all points.
fn subscribe(address: &str, token: &str) -> Result<WebSocket<TcpStream>, String> {
    let request = format!("ws://{address}/api/v1/ws").into_client_request();
    let mut request = request.map_err(|why| why.to_string())?;
    let bearer = format!("Bearer {token}").parse();
    let bearer = bearer.map_err(|_| "the token is no header".to_owned())?;
    request.headers_mut().insert("Authorization", bearer);
    let stream = TcpStream::connect(address).map_err(|why| why.to_string())?;
    let (mut socket, _) =
        tungstenite::client(request, stream).map_err(|why| format!("WebSocket: {why}"))?;
    let wish = Message::text(r#"{"sub":["points/#"]}"#);
    socket.send(wish).map_err(|why| why.to_string())?;
    Ok(socket)
}

/// How long changes took to one client, in ms, and how many points it was told of.
fn judge(mut socket: WebSocket<TcpStream>, plant: &Plant, until: Instant) -> Vec<f64> {
    let mut took = Vec::new();
    let begun = Instant::now();
    while Instant::now() < until {
        let Ok(message) = socket.read() else {
            break;
        };
        let at = Instant::now();
        let Ok(text) = message.to_text() else {
            continue;
        };
        if !text.starts_with(r#"{"type":"delta""#) {
            continue;
        }
        let changed = lock(&plant.changed).clone();
        for rest in text.split(r#""path":""#).skip(1) {
            let path = rest.split('"').next().unwrap_or_default();
            let since = changed.get(path).filter(|since| **since > begun);
            took.extend(
                since.map(|since| at.saturating_duration_since(*since).as_secs_f64() * 1e3),
            );
        }
    }
    took
}

/// Takes what comes, of many at once.
fn drain(mut sockets: Vec<WebSocket<TcpStream>>, over: &AtomicBool) {
    for socket in &mut sockets {
        let _ = socket.get_ref().set_nonblocking(true);
    }
    let mut bytes = vec![0; 64 << 10];
    while !over.load(Ordering::Relaxed) {
        for socket in &mut sockets {
            // As fast as can be: what they are told is none of theirs.
            while !matches!(socket.get_mut().read(&mut bytes), Ok(0) | Err(_)) {}
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// What one case took.
struct Case {
    /// Of one core, in percent.
    share: f64,
    memory: f64,
    took: Vec<f64>,
    changes: f64,
}

fn case(
    process: u32,
    (address, token): (&str, &str),
    plant: &Plant,
    count: usize,
) -> Result<Case, String> {
    let sockets = (0..count).map(|_| subscribe(address, token));
    let mut sockets = sockets.collect::<Result<Vec<_>, _>>()?;
    let judges = sockets.split_off(count.saturating_sub(JUDGES));
    let over = AtomicBool::new(false);
    std::thread::scope(|scope: &Scope<'_, '_>| {
        let over = &over;
        scope.spawn(move || drain(sockets, over));
        let until = Instant::now() + WARM_UP + ROUND;
        let judging: Vec<_> = judges
            .into_iter()
            .map(|socket| scope.spawn(move || judge(socket, plant, until)))
            .collect();
        std::thread::sleep(WARM_UP);
        let (begun, before) = (Instant::now(), used(process));
        let changes = plant.count.load(Ordering::Relaxed);
        std::thread::sleep(until.saturating_duration_since(begun));
        let (passed, after) = (begun.elapsed().as_secs_f64(), used(process));
        let changes = plant.count.load(Ordering::Relaxed) - changes;
        over.store(true, Ordering::Relaxed);
        let took = judging.into_iter().filter_map(|judge| judge.join().ok());
        let took = took.flatten().collect();
        let (before, after) = (before?, after?);
        Ok(Case {
            share: (after.0 - before.0) / passed * 100.0,
            memory: after.1 / f64::from(1 << 20),
            took,
            changes: changes as f64 / passed,
        })
    })
}

/// The daemon's processor time for one of these requests, in ms.
fn get(
    process: u32,
    (address, token): (&str, &str),
    (path, count): (&str, u32),
    idle: f64,
) -> Result<f64, String> {
    let stream = TcpStream::connect(address).map_err(|why| why.to_string())?;
    let _ = stream.set_nodelay(true);
    let head = format!("Host: {address}\r\nAuthorization: Bearer {token}\r\n");
    let (begun, before) = (Instant::now(), used(process)?);
    for _ in 0..count {
        let answer = ask(&stream, "GET", path, &head, "")?;
        if !answer.starts_with("HTTP/1.1 200") {
            return Err(format!("GET {path}: {answer}"));
        }
    }
    let passed = begun.elapsed().as_secs_f64();
    let used = used(process)?.0 - before.0 - passed * idle / 100.0;
    Ok(used / f64::from(count) * 1e3)
}

/// What was measured.
pub struct Clients {
    /// Subscribers, by their number.
    pub subscribers: Table,
    /// Requests.
    pub gets: Table,
}

impl fmt::Display for Clients {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}\n{}", self.subscribers, self.gets)
    }
}

/// Measures all of it.
pub fn measure() -> Result<Clients, String> {
    build()?;
    let plant = Arc::new(Plant {
        changed: Mutex::default(),
        due: Mutex::new((Instant::now(), 0)),
        count: AtomicUsize::new(0),
    });
    let folder = Folder::new(&std::env::temp_dir(), "subscribers")?;
    let mut site = String::new();
    for line in 0..LINES {
        let listener = TcpListener::bind("127.0.0.1:0").map_err(|why| why.to_string())?;
        let port = listener.local_addr().map_err(|why| why.to_string())?;
        site.push_str(&format!("[line.l{line}]\nport = \"tcp:{port}\"\n"));
        for board in 1..=BOARDS {
            site.push_str(&format!(
                "[module.b{line}_{board}]\nline = \"l{line}\"\nmodel = \"erc8\"\n\
                 address = {board}\npoll = \"50ms\"\n"
            ));
        }
        let plant = Arc::clone(&plant);
        std::thread::spawn(move || {
            while let Ok((stream, _)) = listener.accept() {
                plant.serve(line, stream);
            }
        });
    }
    let (config, socket) = (folder.path("site.toml"), folder.path("socket"));
    std::fs::write(&config, site).map_err(|why| format!("{config}: {why}"))?;
    let listen = ["--listen", "127.0.0.1:0", "--socket", &socket];
    let words = [&["serve", "--config", &config], &listen[..]].concat();
    let (daemon, told) = start(&words, "Ctrl-C")?;
    let address = address_in(&told)?;
    let body = r#"{"name":"bench","role":"viewer"}"#;
    let stream = UnixStream::connect(&socket).map_err(|why| format!("{socket}: {why}"))?;
    let made = ask(stream, "POST", "/api/v1/tokens", "Host: railbus\r\n", body)?;
    let token = made.split(r#""token":""#).nth(1);
    let token = token.and_then(|rest| rest.split('"').next());
    let token = token.ok_or_else(|| format!("no token: {made}"))?;
    std::thread::sleep(Duration::from_secs(5));
    let mut cases: [Vec<Case>; CASES.len()] = Default::default();
    let mut gets: [Vec<f64>; GETS.len()] = Default::default();
    for _ in 0..ROUNDS {
        for (count, cases) in CASES.iter().zip(&mut cases) {
            cases.push(case(daemon.id(), (address, token), &plant, *count)?);
        }
        let idle = cases[0].last().map_or(0.0, |case| case.share);
        for ((path, _, count), took) in GETS.iter().zip(&mut gets) {
            took.push(get(daemon.id(), (address, token), (path, *count), idle)?);
        }
    }
    let mut requests = Table::new(&["request", "what", "processor time, ms"]);
    for ((path, what, _), took) in GETS.iter().zip(&mut gets) {
        requests.row(&[
            &format!("`GET {path}`"),
            what,
            &format!("{:.3}", median(took)),
        ]);
    }
    let mut table = Table::new(&[
        "subscribers",
        "changes/s",
        "of one core",
        "median, ms",
        "p99",
        "memory, MiB",
    ]);
    for (count, cases) in CASES.iter().zip(&cases) {
        let of = |what: fn(&Case) -> f64| median(&mut cases.iter().map(what).collect::<Vec<_>>());
        let mut took: Vec<f64> = cases.iter().flat_map(|case| case.took.clone()).collect();
        let (half, most) = match took.is_empty() {
            true => (String::new(), String::new()),
            false => (
                format!("{:.1}", median(&mut took)),
                format!("{:.1}", percentile(&mut took, 99)),
            ),
        };
        table.row(&[
            &count.to_string(),
            &format!("{:.0}", of(|case| case.changes)),
            &format!("{:.1} %", of(|case| case.share)),
            &half,
            &most,
            &format!("{:.1}", of(|case| case.memory)),
        ]);
    }
    Ok(Clients {
        subscribers: table,
        gets: requests,
    })
}
