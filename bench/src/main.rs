//! What the codec and the line master cost.
//!
//! ```text
//! railbus-bench [all] [--write FILE]   measure everything; without a file `docs/performance.md`
//! railbus-bench codec                  instructions of the codec
//! railbus-bench codec --update         the same, and write them into `codec-limits.toml`
//! railbus-bench line                   the line master on a line that takes no time
//! railbus-bench line --count           only its user instructions
//! railbus-bench paced                  the line master on a line whose characters take theirs
//! railbus-bench gateway                the whole program: writes, changes, a flood, many lines
//! railbus-bench gateway --check        the same, and fails where a limit is exceeded
//! railbus-bench gateway --write        the same, into its section of the page
//! railbus-bench clients                what followers and requests cost the daemon
//! railbus-bench clients --write        the same, into its section of the page
//! railbus-bench modbus                 the Modbus TCP server beside others
//! railbus-bench modbus --write         the same, into its section of the page
//! railbus-bench --check                what must never get worse; for CI
//! ```
//!
//! Instructions are counted by `valgrind --tool=callgrind` over a program that does the same
//! thing a few or many times: in the difference start and end of the program cancel out, and
//! the number is the same in every run on every load. Times are medians of interleaved rounds.
//! Beside everything stands its *floor*: the least program with the same bytes in and out.

mod clients;
mod codec;
mod count;
mod daemon;
mod floor;
mod gateway;
mod jobs;
mod latency;
mod limits;
mod line;
mod live;
mod master;
mod modbus;
mod modbus_client;
mod modbus_servers;
mod paced;
mod page;
mod responder;
mod scene;
mod table;

use codec::After;
use std::process::ExitCode;

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    match run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("railbus-bench: {why}");
            ExitCode::FAILURE
        }
    }
}

/// The page of all that is measured.
const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/performance.md");

const USAGE: &str = "usage: railbus-bench \
    [all [--write FILE] | codec [--check | --update] | line [--count] | paced | \
    gateway [--check | --write] | clients [--write] | modbus [--write] | --check]";

fn run(args: &[&str]) -> Result<(), String> {
    match *args {
        [] | ["all"] => page::write(PAGE),
        ["all", "--write", file] => page::write(file),
        ["codec"] => codec::table(After::Nothing).map(|table| print!("{table}")),
        ["codec", "--check"] => codec::table(After::Check).map(|table| print!("{table}")),
        ["--update"] | ["codec", "--update"] => {
            codec::table(After::Update).map(|table| print!("{table}"))
        }
        ["line"] => line::table().map(|table| print!("{table}")),
        ["line", "--count"] => line::counts().map(|counts| print!("{counts}")),
        ["paced"] => paced::tables().map(|[wire, strict]| print!("{wire}\n{strict}")),
        ["gateway"] => gateway::measure().map(|told| print!("{told}")),
        ["clients"] => clients::measure().map(|told| print!("{told}")),
        ["clients", "--write"] => page::renew_clients(PAGE),
        ["modbus"] => modbus::measure().map(|told| print!("{told}")),
        ["modbus", "--write"] => page::renew_modbus(PAGE),
        ["gateway", "--write"] => page::renew_gateway(PAGE),
        ["gateway", "--check"] => gateway::measure().and_then(|told| {
            print!("{told}");
            told.check()
        }),
        ["--check"] | ["all", "--check"] => page::check(),
        // The programs that are measured.
        ["--one", name, "--iterations", times] => codec::one(name, times),
        ["--modbus-floor"] => modbus_servers::be_floor(),
        ["--master", name, scene, baud, path, count] => {
            let number = |text: &str| text.parse().map_err(|_| format!("`{text}` is no number"));
            let (baud, count): (u32, u32) = (number(baud)?, number(count)?);
            master::be(name, (scene, baud), path, count as usize)
        }
        _ => Err(USAGE.to_owned()),
    }
}
