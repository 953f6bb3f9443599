//! Serves simulated modules on a pseudo-terminal, at the speed of a real line, for third-party
//! masters.
//!
//! ```text
//! railbus-interop-rig LINK --module name=oven,model=erc8,addr=3 [--module ...]
//! ```
//!
//! Standard input is the panel of the modules (`panel.rs`); at its end the program exits.

mod describe;
mod line;
mod panel;
mod pty;

use line::Served;
use pty::Pty;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match prepare(&args).and_then(|(served, pty)| serve(served, &pty)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("railbus-interop-rig: {why}");
            ExitCode::FAILURE
        }
    }
}

fn prepare(args: &[String]) -> Result<(Served, Pty), String> {
    let (link, flags) = args
        .split_first()
        .ok_or("the path of the link is missing")?;
    let modules = flags.chunks(2).map(|pair| match pair {
        [flag, text] if flag == "--module" => describe::module(text),
        _ => Err(format!("`{}` is not understood", pair.join(" "))),
    });
    let modules = modules.collect::<Result<Vec<_>, _>>()?;
    let served = Served::new(modules).map_err(|error| error.to_string())?;
    let pty = Pty::open(Path::new(link)).map_err(|error| format!("{link}: {error}"))?;
    println!("ok");
    Ok((served, pty))
}

/// Until standard input ends.
fn serve(mut served: Served, pty: &Pty) -> Result<(), String> {
    let stdin = rustix::stdio::stdin();
    let mut panel = Vec::new();
    let mut buffer = [0; 4096];
    loop {
        let quiet = served.run();
        let heard = served.take_heard();
        if !heard.is_empty() {
            pty.write(&heard);
        }
        let mut fds = [
            PollFd::from_borrowed_fd(pty.fd(), PollFlags::IN),
            PollFd::from_borrowed_fd(stdin, PollFlags::IN),
        ];
        let quiet = quiet.and_then(|quiet| Timespec::try_from(quiet).ok());
        match poll(&mut fds, quiet.as_ref()) {
            Ok(_) | Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.to_string()),
        }
        let [from_master, from_panel] = fds.map(|fd| !fd.revents().is_empty());
        if from_master {
            let (bytes, settings) = pty
                .read(&mut buffer, served.character)
                .map_err(|error| error.to_string())?;
            if let Some(settings) = settings.filter(|_| !bytes.is_empty()) {
                served.send(bytes, settings);
            }
        }
        if from_panel {
            match rustix::io::read(stdin, &mut buffer) {
                Ok(0) => return Ok(()),
                Ok(count) => panel.extend_from_slice(&buffer[..count]),
                Err(error) => return Err(error.to_string()),
            }
            while let Some(end) = panel.iter().position(|&byte| byte == b'\n') {
                let line: Vec<u8> = panel.drain(..=end).collect();
                let order = String::from_utf8_lossy(&line);
                let done = match order.trim() {
                    "silence" => silence(&mut served, pty),
                    order => panel::obey(&mut served, order),
                };
                match done {
                    Ok(answer) if answer.is_empty() => println!("ok"),
                    Ok(answer) => println!("ok {answer}"),
                    Err(why) => println!("error {why}"),
                }
            }
        }
    }
}

/// How many bytes come in reply to what a master sent last, however late that arrives here.
fn silence(served: &mut Served, pty: &Pty) -> Result<String, String> {
    let rest = pty.rest(served.character);
    let (bytes, settings) = rest.map_err(|error| error.to_string())?;
    if let Some(settings) = settings.filter(|_| !bytes.is_empty()) {
        served.send(&bytes, settings);
    }
    Ok(served.silence().to_string())
}
