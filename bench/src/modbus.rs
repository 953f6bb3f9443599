//! The Modbus TCP server of the daemon: what it answers from what is known, beside a floor and
//! other servers in the same client, and what a dead module costs those who read the others.

use crate::daemon::{Folder, Running, build, start};
use crate::gateway::used;
use crate::modbus_client::{Coils, Flow, Reader, Writer, read, read_every};
use crate::modbus_servers;
use crate::table::{Table, median, percentile};
use rustix::process::Pid;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use std::fmt;
use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The most clients that the server takes.
pub const CLIENTS: usize = 32;
/// Connections, and requests under way on each.
const CASES: [(usize, u8); 3] = [(1, 1), (CLIENTS, 1), (CLIENTS, 16)];
/// How often each case is measured with each server, alternating, and for how long.
pub const ROUNDS: usize = 7;
const ROUND: Duration = Duration::from_millis(1_500);
/// The same of a dead module.
pub const DEAD_ROUNDS: usize = 3;
const DEAD_ROUND: Duration = Duration::from_secs(5);
/// How often each client reads meanwhile.
const EVERY: Duration = Duration::from_millis(10);
/// How long each server answers all clients before its memory is looked at.
const WARM_UP: Duration = Duration::from_secs(1);
/// How long a module may take to be known.
const KNOWN_MAX: Duration = Duration::from_secs(60);
/// The modules of the line, of which the last one loses its power.
pub const MODULES: u8 = 8;
/// The first of their coils.
const COIL: u16 = 60;

fn coils(unit: u8) -> Coils {
    Coils { unit, first: COIL }
}

/// A server that is measured.
struct Server {
    name: &'static str,
    address: SocketAddr,
    running: Running,
    /// Seconds of processor time that it uses in a second without clients.
    idle: f64,
    /// In MiB, without clients and with all of them.
    memory: [f64; 2],
    /// For each case what its rounds measured.
    cases: [Vec<Round>; CASES.len()],
}

/// One round of a case.
struct Round {
    rate: f64,
    count: f64,
    /// Seconds of processor time.
    used: f64,
    half: f64,
    most: f64,
}

impl Server {
    fn new(name: &'static str, address: SocketAddr, running: Running) -> Server {
        Server {
            name,
            address,
            running,
            idle: 0.0,
            memory: [0.0; 2],
            cases: Default::default(),
        }
    }

    /// Connections of which each reads one of the modules that keep their power.
    fn readers(&self, count: usize, depth: u8) -> Result<Vec<Reader>, String> {
        let reader = |number| {
            let unit = 1 + (number % usize::from(MODULES - 1)) as u8;
            Reader::open(self.address, (number, depth), coils(unit))
        };
        let readers = (0..count).map(reader).collect::<Result<_, _>>();
        readers.map_err(|why| format!("{}: {why}", self.name))
    }

    fn warm_up(&mut self) -> Result<(), String> {
        let (begun, before) = (Instant::now(), used(self.running.id())?);
        std::thread::sleep(WARM_UP);
        let without = used(self.running.id())?;
        self.idle = (without.0 - before.0) / begun.elapsed().as_secs_f64();
        let mut readers = self.readers(CLIENTS, 16)?;
        read(&mut readers, WARM_UP)?;
        let with = used(self.running.id())?;
        self.memory = [without.1, with.1].map(|bytes| bytes / f64::from(1 << 20));
        Ok(())
    }

    /// Lets all its threads run on these cores only.
    fn pin(&self, cores: &CpuSet) -> Result<(), String> {
        let failed = |why: std::io::Error| format!("{}: {why}", self.name);
        let threads = format!("/proc/{}/task", self.running.id());
        for thread in std::fs::read_dir(threads).map_err(failed)? {
            let name = thread.map_err(failed)?.file_name();
            let number = name.to_str().and_then(|name| name.parse().ok());
            if let Some(thread) = number.and_then(Pid::from_raw) {
                // Fails if it has ended meanwhile.
                let _ = sched_setaffinity(Some(thread), cores);
            }
        }
        Ok(())
    }

    /// A single client shares one core with the server: how long one core takes to wake another
    /// is not the server's, and differs by a factor of five.
    fn round(&mut self, case: usize) -> Result<(), String> {
        let all = sched_getaffinity(None).map_err(|why| why.to_string())?;
        if CASES[case].0 > 1 {
            return self.measure(case);
        }
        let mut one = CpuSet::new();
        one.set(
            (0..CpuSet::MAX_CPU)
                .find(|core| all.is_set(*core))
                .unwrap_or(0),
        );
        self.pin(&one)?;
        sched_setaffinity(None, &one).map_err(|why| why.to_string())?;
        let end = self.measure(case);
        sched_setaffinity(None, &all).map_err(|why| why.to_string())?;
        self.pin(&all)?;
        end
    }

    fn measure(&mut self, case: usize) -> Result<(), String> {
        let (connections, depth) = CASES[case];
        let mut readers = self.readers(connections, depth)?;
        let (begun, before) = (Instant::now(), used(self.running.id())?);
        let flow = read(&mut readers, ROUND).map_err(|why| format!("{}: {why}", self.name))?;
        let passed = begun.elapsed().as_secs_f64();
        let used = used(self.running.id())?.0 - before.0 - passed * self.idle;
        let Flow {
            rate,
            count,
            mut took,
            ..
        } = flow;
        self.cases[case].push(Round {
            rate,
            count,
            used,
            half: median(&mut took),
            most: percentile(&mut took, 99),
        });
        Ok(())
    }
}

/// A line of simulated modules, and a daemon that serves it.
struct Site {
    server: Server,
    control: String,
    _line: Running,
    _folder: Folder,
}

impl Site {
    fn start() -> Result<Site, String> {
        let folder = Folder::new(&std::env::temp_dir(), "modbus")?;
        let address = TcpListener::bind("127.0.0.1:0").and_then(|free| free.local_addr());
        let address = address.map_err(|why| why.to_string())?;
        let modules = (1..=MODULES).map(|unit| {
            format!("[module.m{unit}]\nline = \"l\"\nmodel = \"erc8\"\naddress = {unit}\n")
        });
        let (modules, port) = (modules.collect::<String>(), folder.path("line"));
        let line = |port: &str| format!("[line.l]\nport = \"{port}\"\n{modules}");
        let outlet = format!(
            "[outlet.scada]\ntype = \"modbus_tcp\"\nlisten = \"{address}\"\n\
             write = [\"m{MODULES}\"]\nwithin_ms = 3000\n"
        );
        let (plant, config) = (folder.path("plant.toml"), folder.path("site.toml"));
        for (path, text) in [
            (&plant, line(&format!("pty:{port}"))),
            (&config, line(&port) + &outlet),
        ] {
            std::fs::write(path, text).map_err(|why| format!("{path}: {why}"))?;
        }
        let (control, socket) = (folder.path("ctl"), folder.path("socket"));
        let (simulator, _) = start(&["sim", &plant, "--control", &control], "ctl")?;
        let listen = ["--listen", "127.0.0.1:0", "--socket", &socket];
        let words = [&["serve", "--config", &config], &listen[..]].concat();
        let (daemon, _) = start(&words, "Ctrl-C")?;
        let site = Site {
            server: Server::new("railbus", address, daemon),
            control,
            _line: simulator,
            _folder: folder,
        };
        (1..=MODULES).try_for_each(|unit| site.await_known(unit))?;
        Ok(site)
    }

    /// Waits until the coils of a unit are known.
    fn await_known(&self, unit: u8) -> Result<(), String> {
        let until = Instant::now() + KNOWN_MAX;
        loop {
            // It may not listen yet.
            let known = Writer::open(self.server.address, 0, coils(unit))
                .and_then(|mut client| client.is_known());
            match known {
                Ok(true) => return Ok(()),
                Ok(false) | Err(_) if Instant::now() < until => {
                    std::thread::sleep(Duration::from_millis(100));
                }
                Ok(false) => return Err(format!("nothing is known of unit {unit}")),
                Err(why) => return Err(why),
            }
        }
    }

    /// Gives an order to the simulator.
    fn order(&self, order: &str) -> Result<(), String> {
        let failed = |why: std::io::Error| format!("{}: {why}", self.control);
        let mut stream = UnixStream::connect(&self.control).map_err(failed)?;
        let order = format!("{order}\n");
        stream.write_all(order.as_bytes()).map_err(failed)?;
        let mut answer = String::new();
        let read = BufReader::new(stream).read_line(&mut answer);
        read.map_err(failed)?;
        match answer.starts_with("error") {
            true => Err(format!("the simulator to `{}`: {answer}", order.trim())),
            false => Ok(()),
        }
    }

    /// What readers of the other modules get: while all is well, and while one client keeps
    /// writing to a module without power.
    fn with_a_dead_module(&self) -> Result<Table, String> {
        let mut table = Table::new(&[
            "the module",
            "requests/s of the others",
            "median, ms",
            "p99",
            "most",
            "exceptions",
            "writes to it",
            "the median of their answers, ms",
        ]);
        let (mut alive, mut dead) = ((Flow::default(), Vec::new()), (Flow::default(), Vec::new()));
        let add = |all: &mut (Flow, Vec<f64>), (flow, took): (Flow, Vec<f64>)| {
            all.0.rate += flow.rate / DEAD_ROUNDS as f64;
            all.0.refused += flow.refused;
            all.0.took.extend(flow.took);
            all.1.extend(took);
        };
        for _ in 0..DEAD_ROUNDS {
            add(&mut alive, self.beside_writes(true)?);
            self.order(&format!("power m{MODULES} off"))?;
            add(&mut dead, self.beside_writes(false)?);
            self.order(&format!("power m{MODULES} on"))?;
            self.await_known(MODULES)?;
        }
        for (what, (mut flow, mut writes)) in [("answers", alive), ("has no power", dead)] {
            let Some(most) = flow.took.iter().copied().max_by(f64::total_cmp) else {
                return Err("nothing was read".to_owned());
            };
            let writing = match writes.is_empty() {
                true => String::new(),
                false => format!("{:.0}", median(&mut writes)),
            };
            table.row(&[
                what,
                &thousands(flow.rate),
                &format!("{:.2}", median(&mut flow.took) / 1e3),
                &format!("{:.2}", percentile(&mut flow.took, 99) / 1e3),
                &format!("{:.1}", most / 1e3),
                &flow.refused.to_string(),
                &writes.len().to_string(),
                &writing,
            ]);
        }
        Ok(table)
    }

    /// One round: what the readers got, and how long each write took, in ms.
    fn beside_writes(&self, done: bool) -> Result<(Flow, Vec<f64>), String> {
        let mut readers = self.server.readers(CLIENTS - 1, 1)?;
        let mut writer = Writer::open(self.server.address, CLIENTS - 1, coils(MODULES))?;
        // An exception is an answer, too.
        writer.is_known()?;
        let over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let over = &over;
            let writing = scope.spawn(move || {
                let mut took = Vec::new();
                while !over.load(Ordering::Relaxed) {
                    let begun = Instant::now();
                    if writer.write()? != done {
                        return Err(format!("a write was done: {}", !done));
                    }
                    took.push(begun.elapsed().as_secs_f64() * 1e3);
                }
                Ok(took)
            });
            let flow = read_every(&mut readers, EVERY, DEAD_ROUND);
            over.store(true, Ordering::Relaxed);
            let took = writing.join().map_err(|_| "the writer has panicked")??;
            Ok((flow?, took))
        })
    }
}

/// What was measured.
pub struct Modbus {
    /// Requests, by connections and depth.
    pub rates: Table,
    /// Memory.
    pub memory: Table,
    /// A module without power.
    pub dead: Table,
}

impl fmt::Display for Modbus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}\n{}\n{}", self.rates, self.memory, self.dead)
    }
}

/// A number that is read more easily with a comma.
fn thousands(number: f64) -> String {
    let number = number.round() as u64;
    match number / 1_000 {
        0 => number.to_string(),
        high @ 1..1_000 => format!("{high},{:03}", number % 1_000),
        high => format!("{},{:03},{:03}", high / 1_000, high % 1_000, number % 1_000),
    }
}

/// Measures all of it.
pub fn measure() -> Result<Modbus, String> {
    build()?;
    let mut site = Site::start()?;
    let peers = [
        ("floor", modbus_servers::start_floor()?),
        ("tokio-modbus", modbus_servers::start_tokio_modbus()?),
        ("libmodbus", modbus_servers::start_libmodbus()?),
    ];
    let mut peers = peers.map(|(name, (running, at))| Server::new(name, at, running));
    let mut servers: Vec<&mut Server> = peers.iter_mut().collect();
    servers.insert(1, &mut site.server);
    for server in &mut servers {
        server.warm_up()?;
    }
    for case in 0..CASES.len() {
        for _ in 0..ROUNDS {
            for server in &mut servers {
                server.round(case)?;
            }
        }
    }
    let (rates, memory) = (rates(&servers), memory(&servers));
    let dead = site.with_a_dead_module()?;
    Ok(Modbus {
        rates,
        memory,
        dead,
    })
}

fn rates(servers: &[&mut Server]) -> Table {
    let mut table = Table::new(&[
        "connections × depth",
        "server",
        "requests/s",
        "to the floor",
        "median, µs",
        "p99, µs",
        "processor time of a request, µs",
    ]);
    for (case, (connections, depth)) in CASES.into_iter().enumerate() {
        for server in servers {
            let rounds = &server.cases[case];
            let of =
                |what: fn(&Round) -> f64| median(&mut rounds.iter().map(what).collect::<Vec<_>>());
            let floor = servers.first().map_or(&[][..], |floor| &floor.cases[case]);
            let ratios = rounds.iter().zip(floor);
            let mut ratios: Vec<f64> = ratios.map(|(it, floor)| it.rate / floor.rate).collect();
            let sum = |what: fn(&Round) -> f64| rounds.iter().map(what).sum::<f64>();
            table.row(&[
                &format!("{connections} × {depth}"),
                server.name,
                &thousands(of(|round| round.rate)),
                &format!("{:.0} %", median(&mut ratios) * 100.0),
                &format!("{:.0}", of(|round| round.half)),
                &format!("{:.0}", of(|round| round.most)),
                &format!(
                    "{:.2}",
                    sum(|round| round.used) / sum(|round| round.count) * 1e6
                ),
            ]);
        }
    }
    table
}

fn memory(servers: &[&mut Server]) -> Table {
    let mut table = Table::new(&["server", "memory, MiB", "with 32 clients", "more"]);
    for server in servers {
        let [without, with] = server.memory;
        table.row(&[
            server.name,
            &format!("{without:.1}"),
            &format!("{with:.1}"),
            &format!("{:.1}", with - without),
        ]);
    }
    table
}
