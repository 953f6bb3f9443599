//! The whole program as on a site: its latency beyond the wire, what a flood of clients costs a
//! line, and what many lines cost the machine. The release build of `railbus` is measured, with
//! simulated modules whose characters take their time at 9600.

use crate::daemon::{Folder, address_in, build, start};
use crate::latency::{self, DELTA_MAX, Measured, WRITE_MAX};
use crate::table::Table;
use std::fmt;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// By how much a flood may slow a line down, in percent.
pub const SLOWER_MAX: f64 = 20.0;
/// How much memory many lines may use, in MiB,
pub const MEMORY_MAX: f64 = 64.0;
/// and how much of one core, in percent.
pub const SHARE_MAX: f64 = 25.0;
/// How many lines, with this many modules each.
pub const LINES: usize = 32;
/// See [`LINES`].
pub const MODULES: usize = 8;
/// How long each measurement lasts.
const ROUND: Duration = Duration::from_secs(10);
/// How often each is repeated, alternating.
const ROUNDS: usize = 3;
/// New connections per second.
const CONNECTIONS: u32 = 1_000;
/// Connections that send half a request each.
const HALVES: usize = 100;

/// The number of exchanges, counted by the program and read over its socket.
fn exchanges(socket: &str) -> Result<f64, String> {
    let failed = |why: std::io::Error| format!("{socket}: {why}");
    let mut stream = std::os::unix::net::UnixStream::connect(socket).map_err(failed)?;
    let head = "GET /metrics HTTP/1.1\r\nHost: bench\r\nConnection: close\r\n\r\n";
    stream.write_all(head.as_bytes()).map_err(failed)?;
    let mut text = String::new();
    stream.read_to_string(&mut text).map_err(failed)?;
    let ok = text.lines().filter(|line| {
        line.starts_with("railbus_requests_total{") && line.contains("result=\"ok\"")
    });
    let count = |line: &str| line.rsplit(' ').next()?.parse::<f64>().ok();
    Ok(ok.filter_map(count).sum())
}

/// Exchanges per second while something else goes on.
fn rate(socket: &str) -> Result<f64, String> {
    let (begun, before) = (Instant::now(), exchanges(socket)?);
    std::thread::sleep(ROUND);
    Ok((exchanges(socket)? - before) / begun.elapsed().as_secs_f64())
}

/// Opens and closes this many connections per second, until it is over.
fn come_and_go(address: &str, over: &AtomicBool, made: &AtomicU64) {
    let mut due = Instant::now();
    let body = "x".repeat(64 << 10);
    while !over.load(Ordering::Relaxed) {
        due += Duration::from_secs(1) / CONNECTIONS;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let Ok(mut stream) = TcpStream::connect(address) else {
            continue;
        };
        let number = made.fetch_add(1, Ordering::Relaxed);
        // Every hundredth sends a body of the maximum size.
        if number.is_multiple_of(100) {
            let head = format!(
                "PUT /api/v1/points/pump/do0 HTTP/1.1\r\nHost: {address}\r\n\
                 Content-Length: {}\r\n\r\n{body}",
                body.len()
            );
            let _ = stream.write_all(head.as_bytes());
        }
    }
}

/// Sends half a request on many connections, and replaces those that are closed.
fn send_halves(address: &str, over: &AtomicBool) {
    while !over.load(Ordering::Relaxed) {
        let half = format!("GET /api/v1/points HTTP/1.1\r\nHost: {address}\r\nX: ");
        let open = (0..HALVES).filter_map(|_| {
            let mut stream = TcpStream::connect(address).ok()?;
            stream.write_all(half.as_bytes()).ok()?;
            Some(stream)
        });
        let open: Vec<TcpStream> = open.collect();
        for _ in 0..50 {
            if over.load(Ordering::Relaxed) {
                break;
            }
            std::thread::sleep(Duration::from_millis(200));
        }
        drop(open);
    }
}

/// Exchanges per second on the demo's line without a flood and with one, and the connections per
/// second of the flood.
fn flood() -> Result<[f64; 3], String> {
    let folder = Folder::new(&std::env::temp_dir(), "flood")?;
    let socket = folder.path("socket");
    let words = [
        "serve",
        "--demo",
        "--listen",
        "127.0.0.1:0",
        "--socket",
        &socket,
    ];
    let (_daemon, told) = start(&words, "Ctrl-C")?;
    let address = address_in(&told)?;
    std::thread::sleep(Duration::from_secs(3));
    let (mut calm, mut flooded, mut came) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        calm.push(rate(&socket)?);
        let (over, made) = (AtomicBool::new(false), AtomicU64::new(0));
        let rate = std::thread::scope(|scope| {
            scope.spawn(|| come_and_go(address, &over, &made));
            scope.spawn(|| send_halves(address, &over));
            let rate = rate(&socket);
            over.store(true, Ordering::Relaxed);
            rate
        });
        flooded.push(rate?);
        came.push(made.load(Ordering::Relaxed) as f64 / ROUND.as_secs_f64());
    }
    Ok([calm, flooded, came].map(|mut numbers| crate::table::median(&mut numbers)))
}

/// The plant of many lines, as the simulator and the daemon have it.
fn plant(folder: &Folder) -> Result<[String; 2], String> {
    let mut texts = [String::new(), String::new()];
    for line in 0..LINES {
        let port = folder.path(&format!("line{line}"));
        for (text, port) in texts.iter_mut().zip([format!("pty:{port}"), port]) {
            text.push_str(&format!("[line.l{line}]\nport = \"{port}\"\n"));
            for module in 1..=MODULES {
                text.push_str(&format!(
                    "[module.m{line}_{module}]\nline = \"l{line}\"\nmodel = \"erc8\"\n\
                     address = {module}\n"
                ));
            }
        }
    }
    let mut paths = Vec::new();
    for (name, text) in ["plant.toml", "site.toml"].iter().zip(texts) {
        let path = folder.path(name);
        std::fs::write(&path, text).map_err(|why| format!("{path}: {why}"))?;
        paths.push(path);
    }
    <[String; 2]>::try_from(paths).map_err(|_| "two files".to_owned())
}

/// The processor time in seconds and the memory in bytes that a process has used.
pub fn used(process: u32) -> Result<(f64, f64), String> {
    let read = |name: &str| {
        let path = format!("/proc/{process}/{name}");
        std::fs::read_to_string(&path).map_err(|why| format!("{path}: {why}"))
    };
    let stat = read("stat")?;
    let after_name = stat.rsplit(") ").next().unwrap_or_default();
    let ticks = after_name.split(' ').skip(11).take(2);
    // The kernel reports hundredths to programs, whatever it uses itself.
    let seconds = ticks
        .filter_map(|ticks| ticks.parse::<f64>().ok())
        .sum::<f64>()
        / 100.0;
    let status = read("status")?;
    let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes = resident.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    Ok((seconds, kilobytes.unwrap_or(f64::NAN) * 1_024.0))
}

/// Memory in MiB, share of a processor and exchanges per second of a site with many lines.
fn many() -> Result<[f64; 3], String> {
    let folder = Folder::new(&std::env::temp_dir(), "many")?;
    let [plant, site] = plant(&folder)?;
    let control = folder.path("ctl");
    let (_sim, _) = start(&["sim", &plant, "--control", &control], "ctl")?;
    let socket = folder.path("socket");
    let words = [
        "serve",
        "--listen",
        "127.0.0.1:0",
        "--socket",
        &socket,
        "--config",
        &site,
    ];
    let (daemon, _) = start(&words, "Ctrl-C")?;
    // The timeout of the first replies is longer, since they may come twice.
    std::thread::sleep(Duration::from_secs(15));
    let (begun, before) = (Instant::now(), used(daemon.id())?);
    let rate = rate(&socket)?;
    let after = used(daemon.id())?;
    let share = (after.0 - before.0) / begun.elapsed().as_secs_f64() * 100.0;
    Ok([after.1 / f64::from(1 << 20), share, rate])
}

/// The results, and which of them exceed their limits.
pub struct Gateway {
    /// Writes over HTTP.
    pub writes: Table,
    /// Changes, until a WebSocket client has them.
    pub deltas: Table,
    /// A flood of clients.
    pub flood: Table,
    /// Many lines.
    pub many: Table,
    exceeded: Vec<String>,
}

impl Gateway {
    /// Fails if a limit is exceeded.
    pub fn check(&self) -> Result<(), String> {
        if self.exceeded.is_empty() {
            return Ok(());
        }
        Err(self.exceeded.join("; "))
    }
}

impl fmt::Display for Gateway {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Gateway {
            writes,
            deltas,
            flood,
            many,
            ..
        } = self;
        write!(f, "{writes}\n{deltas}\n{flood}\n{many}")
    }
}

/// Measures everything.
pub fn measure() -> Result<Gateway, String> {
    build()?;
    let ([writes, deltas], Measured { added, delta }) = latency::tables()?;
    let [calm, flooded, came] = flood()?;
    let slower = 100.0 - flooded / calm * 100.0;
    let mut flood = Table::new(&[
        "exchanges/s",
        "the same in a flood",
        "slower by",
        "connections/s",
    ]);
    flood.row(&[
        &format!("{calm:.1}"),
        &format!("{flooded:.1}"),
        &format!("{slower:.1} %"),
        &format!("{came:.0}"),
    ]);
    let [memory, share, rate] = many()?;
    let mut many = Table::new(&[
        "lines × modules",
        "exchanges/s",
        "memory, MiB",
        "of one core",
    ]);
    many.row(&[
        &format!("{LINES} × {MODULES}"),
        &format!("{rate:.0}"),
        &format!("{memory:.1}"),
        &format!("{share:.1} %"),
    ]);
    let limits = [
        (
            "what a write takes beyond the wire, p99, ms",
            added,
            WRITE_MAX,
        ),
        ("a change to a client, median, ms", delta, DELTA_MAX),
        ("a line in a flood is slower, %", slower, SLOWER_MAX),
        ("memory of many lines, MiB", memory, MEMORY_MAX),
        ("many lines of one core, %", share, SHARE_MAX),
    ];
    // Not a number exceeds every limit.
    let beyond = limits
        .into_iter()
        .filter(|(_, is, most)| is > most || is.is_nan());
    let exceeded = beyond.map(|(what, is, most)| format!("{what}: {is:.1}, the limit is {most}"));
    Ok(Gateway {
        writes,
        deltas,
        flood,
        many,
        exceeded: exceeded.collect(),
    })
}
