//! The page of all measurements, and the check of those that must never get worse.

use crate::clients::{self, Clients};
use crate::codec::{self, After};
use crate::count::What;
use crate::gateway::{self, MEMORY_MAX, SHARE_MAX, SLOWER_MAX};
use crate::latency::{DELTA_MAX, WRITE_MAX};
use crate::line::{self, ADDED_MAX, INSTRUCTIONS_MAX};
use crate::master::Master;
use crate::modbus::{self, CLIENTS, DEAD_ROUNDS, Modbus, ROUNDS};
use crate::paced::{self, STRICT};
use crate::scene::NAMES;
use std::process::Command;

/// By how many percent [`INSTRUCTIONS_MAX`] may be exceeded with another compiler.
const TOLERANCE: u64 = 3;

/// Measures everything and writes the page.
pub fn write(file: &str) -> Result<(), String> {
    println!("codec");
    let codec = codec::table(After::Nothing)?;
    println!("line that takes no time");
    let line = line::table()?;
    println!("line whose characters take their time");
    let [wires, strict] = paced::tables()?;
    println!("gateway");
    let gateway = of_gateway(&gateway::measure()?);
    println!("clients");
    let clients = of_clients(&clients::measure()?);
    println!("modbus");
    let modbus = of_modbus(&modbus::measure()?);
    let date = date();
    let by_hand = by_hand(file);
    let page = format!(
        "# Performance

Written by `cargo xtask bench`, {date}, on 2 shared cores. Only compare numbers within a table:
times depend on the machine and its load. Instruction counts (callgrind, user space) are repeatable.
Everything is compared with its *floor*: the smallest program with the same bytes in and out.

## A line that takes no time

The whole line master (`railbus_host::Line`: queue, ghosts, timing, events to an observer) polls one
Modbus RTU module over a pseudo-terminal; no gaps are required, and the module replies immediately.
Both ends share one core, and the masters take turns, so the time added to the floor is work; times
are the median exchange of the quietest of 15 rounds. An exchange is a request and its reply;
`railbus commands` submits one write after the other and awaits each, which takes two exchanges, the
write and its read-back, and a hand-over between two tasks.

{line}
Limits: {INSTRUCTIONS_MAX} instructions, no allocation, {ADDED_MAX} µs added while polling. On a
tokio runtime with timers enabled, which the line itself does not need, an exchange costs about 350
instructions more. Nothing sleeps for a fixed time. The floor sleeps in `read`, the asynchronous
masters in `epoll_wait`, which the kernel may wake sooner: so the added time can even be negative,
and differences of a few µs say less than the instruction counts.

## A line whose characters take their time

The same over a virtual wire: the responder paces characters at 10 bits each, replies after 3.5
characters (rtu) or 5 ms (the others), and checks the gap before each request. The gap is 3.5
characters (rtu), or what the model needs (`demo`: 20, 10 and 5 ms). The limit is
`1 / ((request + reply) * character + turnaround + silence)`. Percentages are relative to the limit,
medians of interleaved runs; the responder's own lateness is not counted. A master above 100 % does
not keep the gap. The other masters are measured with the coils of `rtu`. The first {warm_up}
requests are not counted: after opening a port, the line master waits 100 ms after each of the first
20 replies for a duplicate.

{wires}
Limits: nothing too early; within 1 % of the floor. Both wait with the same kernel timer, so what is
missing to 100 % is how late the kernel wakes a task, which depends on the load: a row in which
railbus and floor differ by more than that was disturbed, in either direction.

## A module that insists on 3.5 silent characters

At 9600, {STRICT} requests. A master that sends too early loses that request, runs into its timeout,
and is therefore late enough for the next one.

{strict}
{clients}
{gateway}
{modbus}
## Codec

Instructions for one exchange. A server reads a request and writes its reply, a client the reverse;
all checks included.

{codec}
`before` and `limit` are those of `bench/codec-limits.toml`.
{by_hand}",
        warm_up = paced::WARM_UP,
    );
    std::fs::write(file, page).map_err(|why| format!("{file} cannot be written: {why}"))?;
    println!("written: {file}");
    Ok(())
}

/// The section at the end of the page, which is written by hand.
const BY_HAND: &str = "\n## Before and after the rebuild\n";

/// That section as it is in this file, so that it survives; empty where there is none.
fn by_hand(file: &str) -> String {
    let page = std::fs::read_to_string(file).unwrap_or_default();
    page.split_once(BY_HAND)
        .map_or_else(String::new, |(_, text)| format!("{BY_HAND}{text}"))
}

/// The headings of the sections that can be renewed alone, and of the one after them.
const HEADINGS: [&str; 4] = [
    "## Clients\n",
    "## The gateway\n",
    "## The Modbus TCP server\n",
    "## Codec\n",
];

/// Measures the whole program, and rewrites that section of the page.
pub fn renew_gateway(file: &str) -> Result<(), String> {
    renew(file, 1, || gateway::measure().map(|told| of_gateway(&told)))
}

/// Measures what clients cost, and rewrites that section of the page.
pub fn renew_clients(file: &str) -> Result<(), String> {
    renew(file, 0, || clients::measure().map(|told| of_clients(&told)))
}

/// Measures the Modbus TCP server, and rewrites that section of the page.
pub fn renew_modbus(file: &str) -> Result<(), String> {
    renew(file, 2, || modbus::measure().map(|told| of_modbus(&told)))
}

/// Rewrites the section below one of [`HEADINGS`].
fn renew(
    file: &str,
    heading: usize,
    section: impl FnOnce() -> Result<String, String>,
) -> Result<(), String> {
    let failed = |why: std::io::Error| format!("{file}: {why}");
    let page = std::fs::read_to_string(file).map_err(failed)?;
    let find = |number: usize| HEADINGS.get(number).and_then(|text| page.find(text));
    let (Some(begin), Some(end)) = (find(heading), find(heading + 1)) else {
        return Err(format!("{file} lacks a section"));
    };
    let section = section()?;
    let page = format!("{}{section}\n{}", &page[..begin], &page[end..]);
    std::fs::write(file, page).map_err(failed)
}

/// How the program was built, and how busy the machine was.
fn circumstances() -> String {
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split(' ').next().unwrap_or_default();
    let built = match std::env::var("CARGO_PROFILE_RELEASE_LTO").as_deref() {
        Ok("off") => "of a build without link-time optimisation",
        _ => "of a build as users get it",
    };
    format!("{built};\nat its end the load average was {load}, on 2 cores")
}

/// The page's section about clients.
fn of_clients(measured: &Clients) -> String {
    let Clients { subscribers, gets } = measured;
    format!(
        "## Clients

Measured {date} with `railbus-bench clients`, {circumstances}.

256 relays of 32 boards behind TCP change by themselves, 200 times a second, and are noticed by
polling every 50 ms. Subscribers of `points/#` over WebSockets; 8 of them measure from the reply
that has the change to the message that tells it. Medians of 3 rounds of 6 s, alternating; all in
the daemon, with its polling and its history.

{subscribers}
Of these times up to 50 ms are the pace of the stream: with so many changes there is always a batch
that waits. Goals for 500: 50 % of one core, p99 100 ms.

The processor time of one request at the same site, on a connection that stays open, less what the
daemon uses without it.

{gets}
Goals: 0.1 ms for one point, 0.2 ms for 256.
",
        date = date(),
        circumstances = circumstances(),
    )
}

/// The page's section about the whole program.
fn of_gateway(measured: &gateway::Gateway) -> String {
    let gateway::Gateway {
        writes,
        deltas,
        flood,
        many,
        ..
    } = measured;
    format!(
        "## The gateway

Measured {date} with `railbus-bench gateway`, {circumstances}.

Writes over HTTP to the demo's five modules at 9600, which are polled as fast as the line allows, at
times unrelated to the polling: from the first byte of the request to the last byte of the answer
that says `readback`, in ms. The wire time is the rest of the exchange in progress, the write, its
read-back, and the gap before each. Nothing is sent before the entry in the audit log is durable:
with the state folder in memory that costs nothing; on a disk, it costs the difference. A write that
waits for the disk may be *overtaken* by a poll that begins meanwhile; all of that poll counts as
added. In a write, bytes of host and modules pass through a pseudo-terminal four times, and there
are as many timed waits; *a byte*, which is sent through another pseudo-terminal all the while,
shows how late a busy machine is.

{writes}
Limit: p99 {WRITE_MAX} ms in memory.

From the last byte of a reply that contains a changed input to the WebSocket client that is
notified, in ms.

{deltas}
Limit: {DELTA_MAX} ms in the median.

The released program with the demo's five modules at 9600, polled as fast as the line allows: alone,
and while clients connect and disconnect, every hundredth with a body of 64 KB, and 100 more each
send half a request and wait. Medians of 3 rounds of 10 s, alternating.

{flood}
Limit: {SLOWER_MAX} %.

Many lines in one process, each at 9600 with modules that reply immediately; memory is resident
memory.

{many}
Limits: {MEMORY_MAX} MiB, {SHARE_MAX} % of one core.
",
        date = date(),
        circumstances = circumstances(),
    )
}

/// The page's section about the Modbus TCP server.
fn of_modbus(measured: &Modbus) -> String {
    let Modbus {
        rates,
        memory,
        dead,
    } = measured;
    format!(
        "## The Modbus TCP server

Measured {date} with `railbus-bench modbus`, {circumstances}.

Reads of eight coils of a site with {modules} modules at 9600, from a client with one thread. The
floor is the smallest server on tokio: it looks at the length of a message and replies with the same
bytes. tokio-modbus is its server with a service that does nothing. Each server is a process that
answers on one thread; railbus polls its line meanwhile. Of depth 16 are 16 requests in one write,
and the next 16 when all are answered; what they take is the time of all 16. A single client shares
one core with the server. Medians of {ROUNDS} rounds of 1.5 s, alternating; the ratio is that of
neighbouring rounds. The processor time is that of the server's process, in the kernel and outside,
less what it uses without clients.

{rates}
Goals: 1 × 1 no slower than tokio-modbus; 32 × 1 more than 305,000 and 32 × 16 no less than
1,500,000 a second on a quiet machine. On a machine with two cores the client has one of them: where
railbus and floor are as fast, it is the client that was measured, and the processor time says more.

{memory}
Goal: no more than 8 MiB for {CLIENTS} clients.

31 clients read seven modules, each every 10 ms and all at once, and one keeps switching an output
of the eighth: while that answers, and while the simulator keeps it without power. {DEAD_ROUNDS}
rounds of 5 s of each, alternating. An exception is a value that was older than 2 s.

{dead}
Goal: p99 5 ms.
",
        date = date(),
        circumstances = circumstances(),
        modules = modbus::MODULES,
    )
}

fn date() -> String {
    let date = Command::new("date").args(["-u", "+%Y-%m-%d"]).output();
    date.map_or_else(
        |_| "undated".to_owned(),
        |output| String::from_utf8_lossy(&output.stdout).trim().to_owned(),
    )
}

/// Checks what does not depend on the machine.
pub fn check() -> Result<(), String> {
    print!("{}", codec::table(After::Check)?);
    let instructions = line::per_exchange(Master::Ours, What::Instructions)?.round() as u64;
    println!("line master: {instructions} instructions of {INSTRUCTIONS_MAX}");
    if instructions > INSTRUCTIONS_MAX + INSTRUCTIONS_MAX * TOLERANCE / 100 {
        return Err("the line master costs too many instructions".to_owned());
    }
    let allocations = line::per_exchange(Master::Ours, What::Allocations)?;
    println!("line master: {allocations:.2} allocations");
    if allocations > 0.01 {
        return Err("the line master allocates".to_owned());
    }
    for scene in NAMES {
        let (too_early, requests) = paced::too_early(scene, 38_400)?;
        println!("{scene}: {too_early} of {requests} requests too early");
        if too_early > 0 {
            return Err("the line master does not keep the silence".to_owned());
        }
    }
    let answers = paced::answers(Master::Ours)?.unwrap_or(0);
    println!("module that insists on the silence: {answers} of {STRICT} answers");
    if answers < STRICT {
        return Err("the line master loses requests".to_owned());
    }
    Ok(())
}
