//! The latency of the whole program beyond the wire: of a write over HTTP, and until a change
//! reaches a WebSocket client. The modules are the demo's, at 9600, polled as fast as the line
//! allows.

use crate::daemon::{Folder, Running, address_in, start};
use crate::live::{Live, Said};
use crate::responder::{Heard, Pty, Wire};
use crate::table::{Table, median, percentile};
use std::fs::File;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;

/// What 99 of 100 writes may take beyond the wire's own time, with commits that cost nothing, in
/// ms.
pub const WRITE_MAX: f64 = 5.0;
/// What a change may take from the last byte of its reply to a client, at the median, in ms.
pub const DELTA_MAX: f64 = 10.0;
/// How many writes are measured.
pub const WRITES: usize = 400;
/// How long changes are measured.
const LOOK: Duration = Duration::from_secs(120);
/// After the port is opened, the timeout of the first replies is longer, since they may come twice.
const WARM_UP: Duration = Duration::from_secs(12);
/// The outputs that are written in turn.
const OUTPUTS: [&str; 4] = ["pump/do0", "gate/do0", "oven/k1", "yard/k1"];
/// A folder in memory, where no disk adds a delay.
const IN_MEMORY: &str = "/dev/shm";

/// The traffic of the line, and what each exchange was about.
type Passed = (Vec<Heard>, Vec<Said>);

/// The daemon, with the modules on its line.
struct Rig {
    daemon: Running,
    address: String,
    token: String,
    line: JoinHandle<Result<Passed, String>>,
    _folder: Folder,
}

impl Rig {
    /// Starts all of it, with the daemon's files in a folder below this.
    fn start(below: &Path, moving: bool) -> Result<Rig, String> {
        let folder = Folder::new(below, "latency")?;
        let pty = Pty::new()?;
        let site = include_str!("../../crates/plant/src/demo.toml");
        let site = site.replace("PORT", &pty.path.display().to_string());
        let (config, socket) = (folder.path("site.toml"), folder.path("socket"));
        std::fs::write(&config, site).map_err(|why| format!("{config}: {why}"))?;
        let line = std::thread::spawn(move || {
            let mut live = Live::new(moving)?;
            let wire = Wire {
                baud: 9_600,
                strict: false,
                // The daemon may need that core.
                spins: false,
            };
            let record = pty.serve(&mut live, Some(wire))?;
            Ok((record, live.said))
        });
        let listen = ["--listen", "127.0.0.1:0", "--socket", &socket];
        let words = [&["serve", "--config", &config], &listen[..]].concat();
        let (daemon, told) = start(&words, "Ctrl-C")?;
        let address = address_in(&told)?.to_owned();
        let body = r#"{"name":"bench","role":"operator"}"#;
        let stream = UnixStream::connect(&socket).map_err(|why| format!("{socket}: {why}"))?;
        let made = ask(stream, "POST", "/api/v1/tokens", "Host: railbus\r\n", body)?;
        let token = made.split(r#""token":""#).nth(1);
        let token = token.and_then(|rest| rest.split('"').next());
        let token = token.ok_or_else(|| format!("no token: {made}"))?.to_owned();
        std::thread::sleep(WARM_UP);
        Ok(Rig {
            daemon,
            address,
            token,
            line,
            _folder: folder,
        })
    }

    fn connect(&self) -> Result<TcpStream, String> {
        let stream = TcpStream::connect(&self.address).map_err(|why| why.to_string())?;
        stream.set_nodelay(true).map_err(|why| why.to_string())?;
        Ok(stream)
    }

    /// The traffic of the line from its start until now.
    fn stop(self) -> Result<Passed, String> {
        drop(self.daemon);
        let ended = self.line.join();
        ended.map_err(|_| "the line has panicked".to_owned())?
    }
}

/// One request and its whole answer.
pub fn ask(
    mut stream: impl Read + Write,
    method: &str,
    path: &str,
    lines: &str,
    body: &str,
) -> Result<String, String> {
    let length = body.len();
    let request = format!(
        "{method} {path} HTTP/1.1\r\n{lines}Content-Type: application/json\r\n\
         Content-Length: {length}\r\n\r\n{body}"
    );
    let failed = |why: std::io::Error| format!("{method} {path}: {why}");
    stream.write_all(request.as_bytes()).map_err(failed)?;
    let mut answer = Vec::new();
    let mut buffer = [0; 4_096];
    loop {
        let count = stream.read(&mut buffer).map_err(failed)?;
        answer.extend_from_slice(buffer.get(..count).unwrap_or_default());
        let text = String::from_utf8_lossy(&answer);
        if let Some((head, rest)) = text.split_once("\r\n\r\n")
            && rest.len() >= length_in(head)
        {
            return Ok(text.into_owned());
        }
        if count == 0 {
            return Err(format!("{method} {path}: {text}"));
        }
    }
}

fn length_in(head: &str) -> usize {
    let head = head.to_ascii_lowercase();
    let length = head
        .lines()
        .find_map(|line| line.strip_prefix("content-length:"));
    length
        .and_then(|length| length.trim().parse().ok())
        .unwrap_or(0)
}

/// What one write took, in ms.
struct Took {
    /// Until the client had the answer.
    all: f64,
    /// The part of the wire.
    wire: f64,
    /// How many other exchanges the line carried before it, except the one in progress.
    overtaken: usize,
}

/// How long a byte takes through a pseudo-terminal to a waiting reader, in ms, until it is over:
/// this shows how busy the machine is with other things.
fn crossings(over: &AtomicBool) -> Result<Vec<f64>, String> {
    let pty = Pty::new()?;
    let mut end = File::open(&pty.path).map_err(|why| why.to_string())?;
    let (sent, moments) = mpsc::channel();
    let mut took = Vec::new();
    std::thread::scope(|scope| {
        let pty = &pty;
        scope.spawn(move || {
            while !over.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(7));
                if sent.send(Instant::now()).is_err() || pty.write(b"x").is_err() {
                    return;
                }
            }
        });
        while let Ok(begun) = moments.recv() {
            end.read_exact(&mut [0]).map_err(|why| why.to_string())?;
            took.push(millis(begun.elapsed()));
        }
        Ok(took)
    })
}

/// Writes like [`ask_for_writes`], and how busy the machine was with other things meanwhile.
fn writes(below: &Path) -> Result<(Vec<Took>, Vec<f64>), String> {
    let over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let crossings = scope.spawn(|| crossings(&over));
        let took = ask_for_writes(below);
        over.store(true, Ordering::Relaxed);
        let crossings = crossings.join();
        let crossings = crossings.map_err(|_| "the byte has panicked".to_owned())??;
        Ok((took?, crossings))
    })
}

/// Verified writes, one after the other at moments that are independent of the line's.
fn ask_for_writes(below: &Path) -> Result<Vec<Took>, String> {
    let rig = Rig::start(below, false)?;
    let mut stream = rig.connect()?;
    let lines = format!(
        "Host: {}\r\nAuthorization: Bearer {}\r\n",
        rig.address, rig.token
    );
    let mut spans = Vec::new();
    for number in 0..WRITES {
        let path = format!("/api/v1/points/{}", OUTPUTS[number % OUTPUTS.len()]);
        let on = (number / OUTPUTS.len()).is_multiple_of(2);
        let body = format!(r#"{{"value":{on}}}"#);
        let sent = Instant::now();
        let answer = ask(&mut stream, "PUT", &path, &lines, &body)?;
        let answered = Instant::now();
        if !answer.contains(r#""confirmed":"readback""#) {
            return Err(format!("a write was not verified: {answer}"));
        }
        spans.push((sent, answered));
        std::thread::sleep(Duration::from_millis(20 + number as u64 * 37 % 101));
    }
    let (record, said) = rig.stop()?;
    let took = |(sent, answered)| {
        let took = took(sent, answered, &record, &said);
        took.ok_or_else(|| "a write was not seen on the line".to_owned())
    };
    spans.into_iter().map(took).collect()
}

/// What the wire needs for a write: the rest of the exchange in progress when the write comes to
/// the line, the write, its read-back, and the silence before each.
fn took(sent: Instant, answered: Instant, record: &[Heard], said: &[Said]) -> Option<Took> {
    let of = |number: usize| Some((record.get(number)?, said.get(number)?));
    let write = (0..record.len())
        .find(|n| of(*n).is_some_and(|(heard, said)| heard.began >= sent && !said.is_poll))?;
    let module = said.get(write)?.module;
    let readback = (write + 1..record.len())
        .take_while(|n| record.get(*n).is_some_and(|heard| heard.ended <= answered))
        .filter(|n| said.get(*n).is_some_and(|said| said.module == module))
        .last()?;
    let needed = |number: usize| {
        let heard = record.get(number)?;
        let before = record.get(number.checked_sub(1)?)?.ended;
        let from = before.max(heard.began.checked_sub(heard.gap)?).max(sent);
        Some(heard.ended.saturating_duration_since(from))
    };
    let first = record.iter().position(|heard| heard.ended > sent)?;
    let mut wire = needed(write)? + needed(readback)?;
    if first < write {
        wire += needed(write - 1)?;
    }
    let others = (write - first).saturating_sub(1) + (readback - write - 1);
    Some(Took {
        all: millis(answered - sent),
        wire: millis(wire),
        overtaken: others,
    })
}

fn millis(span: Duration) -> f64 {
    span.as_secs_f64() * 1e3
}

/// From the last byte of a reply that shows a change to the client that receives it, in ms.
fn deltas() -> Result<Vec<f64>, String> {
    let rig = Rig::start(&std::env::temp_dir(), true)?;
    let url = format!("ws://{}/api/v1/ws", rig.address);
    let mut request = url.into_client_request().map_err(|why| why.to_string())?;
    let bearer = format!("Bearer {}", rig.token).parse();
    let bearer = bearer.map_err(|_| "the token is no header".to_owned())?;
    request.headers_mut().insert("Authorization", bearer);
    let failed = |why: tungstenite::Error| format!("WebSocket: {why}");
    let (mut socket, _) =
        tungstenite::client(request, rig.connect()?).map_err(|why| format!("WebSocket: {why}"))?;
    let wish = tungstenite::Message::text(r#"{"sub":["points/#"]}"#);
    socket.send(wish).map_err(failed)?;
    let begun = Instant::now();
    let mut told = Vec::new();
    while begun.elapsed() < LOOK {
        let message = socket.read().map_err(failed)?;
        let at = Instant::now();
        if message
            .to_text()
            .is_ok_and(|text| text.starts_with(r#"{"type":"delta""#))
        {
            told.push(at);
        }
    }
    let until = begun + LOOK - Duration::from_secs(2);
    let (record, said) = rig.stop()?;
    let changes = record.iter().zip(&said).filter(|(heard, said)| {
        said.is_poll && said.changed && heard.ended > begun && heard.ended < until
    });
    let took = changes.map(|(heard, _)| {
        let first = told.iter().find(|at| **at >= heard.ended);
        first.map_or(f64::INFINITY, |at| millis(*at - heard.ended))
    });
    Ok(took.collect())
}

/// What was measured, in ms.
pub struct Measured {
    /// 99 of 100 writes took no more than this beyond the wire's own time.
    pub added: f64,
    /// The median time until a change reached a client.
    pub delta: f64,
}

/// The tables of both, and the limited values.
pub fn tables() -> Result<([Table; 2], Measured), String> {
    let mut first = Table::new(&[
        "state folder",
        "writes",
        "in all, median",
        "the wire's own",
        "added, median",
        "p99",
        "most",
        "overtaken",
        "a byte, p99",
    ]);
    let mut measured = Vec::new();
    let places = [
        ("in memory", Path::new(IN_MEMORY)),
        ("on a disk", &std::env::temp_dir()),
    ];
    for (name, below) in places {
        let (took, mut crossings) = writes(below)?;
        let mut all: Vec<f64> = took.iter().map(|took| took.all).collect();
        let mut wire: Vec<f64> = took.iter().map(|took| took.wire).collect();
        let mut added: Vec<f64> = took.iter().map(|took| took.all - took.wire).collect();
        let p99 = percentile(&mut added, 99);
        first.row(&[
            name,
            &took.len().to_string(),
            &format!("{:.1}", median(&mut all)),
            &format!("{:.1}", median(&mut wire)),
            &format!("{:.2}", median(&mut added)),
            &format!("{p99:.2}"),
            &format!("{:.2}", percentile(&mut added, 100)),
            &took
                .iter()
                .filter(|took| took.overtaken > 0)
                .count()
                .to_string(),
            &format!("{:.2}", percentile(&mut crossings, 99)),
        ]);
        measured.push(p99);
    }
    let mut second = Table::new(&["changes", "median", "p99", "most"]);
    let mut took = deltas()?;
    let delta = median(&mut took);
    second.row(&[
        &took.len().to_string(),
        &format!("{delta:.2}"),
        &format!("{:.2}", percentile(&mut took, 99)),
        &format!("{:.2}", percentile(&mut took, 100)),
    ]);
    let added = measured.first().copied().unwrap_or(f64::INFINITY);
    Ok(([first, second], Measured { added, delta }))
}
