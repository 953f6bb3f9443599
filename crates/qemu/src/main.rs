//! Serves boards in QEMU on a pseudo terminal, as one line.
//!
//! ```text
//! railbus-qemu LINK --images FOLDER --module name=oven,model=erc8,addr=3 [--module ...]
//! railbus-qemu demo FOLDER RAILBUS [ARGUMENT...]
//! ```
//!
//! With the first, standard input is the modules' panel, with the commands of `interop/rig`; at its
//! end the program ends, and the boards with it. The second one is the demo: its five modules as
//! boards, whose inputs move like those of the simulated modules, under `railbus serve`.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    unreachable_pub,
    reason = "it is a program, and shares a file with another one"
)]

mod demo;
#[path = "../../../interop/rig/src/describe.rs"]
mod describe;
mod signals;

use railbus_conformance::{Bench, Outside};
use railbus_qemu::{Board, Hub, Pty};
use std::io::BufRead;
use std::path::Path;
use std::process::ExitCode;
use std::sync::mpsc::{self, Receiver};

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let done = match &args[..] {
        [word, images, railbus, args @ ..] if word == "demo" => demo::run(images, railbus, args),
        args => serve(args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("railbus-qemu: {why}");
            ExitCode::FAILURE
        }
    }
}

/// Runs until standard input ends, or a signal comes.
fn serve(args: &[String]) -> Result<(), String> {
    let [link, flag, images, modules @ ..] = args else {
        return Err(String::from("say LINK --images FOLDER --module ..."));
    };
    if flag != "--images" {
        return Err(format!("`{flag}` is not `--images`"));
    }
    let orders = orders().map_err(|error| error.to_string())?;
    let pty = Pty::open(Path::new(link)).map_err(|error| format!("{link}: {error}"))?;
    let mut line = Line {
        hub: Hub::new(),
        boards: Vec::new(),
        pty,
    };
    for pair in modules.chunks(2) {
        match pair {
            [flag, text] if flag == "--module" => line.add(Path::new(images), text)?,
            _ => return Err(format!("`{}` is not understood", pair.join(" "))),
        }
    }
    line.pty
        .join(&line.hub)
        .map_err(|error| error.to_string())?;
    println!("ok");
    for order in orders.into_iter().map_while(|order| order) {
        match line.obey(order.trim()) {
            Ok(answer) if answer.is_empty() => println!("ok"),
            Ok(answer) => println!("ok {answer}"),
            Err(why) => println!("error {why}"),
        }
    }
    Ok(())
}

/// The lines of standard input; none when it has ended, or a signal has come.
fn orders() -> std::io::Result<Receiver<Option<String>>> {
    let (says, orders) = mpsc::sync_channel(1);
    signals::tell(says.clone(), None)?;
    std::thread::spawn(move || {
        let lines = std::io::stdin().lock().lines().map_while(Result::ok);
        let mut orders = lines.map(Some).chain([None]);
        orders.try_for_each(|order| says.send(order))
    });
    Ok(orders)
}

/// The boards, their line, and the port for a master.
struct Line {
    hub: Hub,
    boards: Vec<(String, Board)>,
    pty: Pty,
}

impl Line {
    fn add(&mut self, images: &Path, text: &str) -> Result<(), String> {
        let module = describe::module(text)?;
        let board = Board::with(images, &module.setup, module.options, module.eeprom);
        let mut board = board.map_err(|error| format!("{text}: {error}"))?;
        board.join(&self.hub).map_err(|error| error.to_string())?;
        self.boards.push((module.name, board));
        Ok(())
    }

    /// Executes a line of the panel.
    fn obey(&mut self, order: &str) -> Result<String, String> {
        let words: Vec<&str> = order.split_whitespace().collect();
        match words[..] {
            // A pseudo terminal has no parity, and neither has QEMU's UART.
            ["parity", _] => Ok(String::new()),
            ["outputs", name] => {
                let outputs = self
                    .find(name)?
                    .machine()
                    .and_then(|machine| machine.outputs());
                outputs
                    .map(|on| format!("{on:X}"))
                    .map_err(|error| error.to_string())
            }
            // A delayed board may have replied and not yet changed its speed.
            ["runs", name, rate] => {
                let rate = number(rate)?;
                match self.find(name)?.runs_at(rate) {
                    Ok(true) => Ok(String::new()),
                    Ok(false) => Err(format!("{name} does not run at {rate}")),
                    Err(error) => Err(error.to_string()),
                }
            }
            ["silence"] => {
                let said = self.silence().map_err(|error| error.to_string())?;
                Ok(said.to_string())
            }
            [verb, name, ref rest @ ..] => self.act(verb, name, rest).map(|()| String::new()),
            _ => Err(format!("`{order}` is not understood")),
        }
    }

    /// How many bytes come to a master that expects none: by then the boards have received what it
    /// sent last and, by their own clocks, had the time to reply.
    fn silence(&mut self) -> std::io::Result<usize> {
        let before = self.pty.heard();
        self.pty.settle()?;
        for (_, board) in &mut self.boards {
            board.keep_silence()?;
        }
        Ok(self.pty.heard() - before)
    }

    fn act(&mut self, verb: &str, name: &str, rest: &[&str]) -> Result<(), String> {
        let hub = self.hub.clone();
        let board = self.find(name)?;
        let mut outside = *board.outside();
        let done = match (verb, rest) {
            ("power", ["off"]) => {
                board.power_off();
                Ok(())
            }
            ("power", [word @ ("on" | "cycle")]) => {
                if *word == "cycle" {
                    board.power_off();
                }
                board.power_on().and_then(|()| board.join(&hub))
            }
            _ => {
                surround(&mut outside, verb, rest)?;
                board.surround(&outside)
            }
        };
        done.map_err(|error| error.to_string())
    }

    fn find(&mut self, name: &str) -> Result<&mut Board, String> {
        let found = self.boards.iter_mut().find(|(known, _)| known == name);
        found
            .map(|(_, board)| board)
            .ok_or_else(|| format!("no module `{name}`"))
    }
}

fn surround(outside: &mut Outside, verb: &str, rest: &[&str]) -> Result<(), String> {
    match (verb, rest) {
        ("init", ["ground"]) => outside.init = true,
        ("init", ["open"]) => outside.init = false,
        ("dip", [dip]) => outside.dip = number(dip)?,
        ("levels", [levels]) => outside.levels = number(levels)?,
        ("analog", [channel, value]) => {
            let channel: usize = number(channel)?;
            let analog = outside.analogs.get_mut(channel);
            *analog.ok_or("no such input")? = number(value)?;
        }
        _ => return Err(format!("`{verb} {}` is not understood", rest.join(" "))),
    }
    Ok(())
}

fn number<T: TryFrom<i64>>(text: &str) -> Result<T, String> {
    let wide: Option<i64> = text.parse().ok();
    let fits = wide.and_then(|wide| T::try_from(wide).ok());
    fits.ok_or_else(|| format!("`{text}` is no number that fits"))
}
