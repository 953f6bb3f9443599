//! `railbus`, the one program.
//!
//! The crates below it, from the wire up: `wire` (bytes), `device` (families), `bus` (a line),
//! `host` (ports), `commission` (scan, settings), `store` (disk), `site` (points, commands),
//! `words` (texts), `api` (messages), `app` (shared by programs), `client`, `plant` (simulated
//! lines), `gateway` (the daemon). Beside them `sim` (virtual time), `sniff` (listening), `nvm` (a
//! module's memory), `conformance` and `qemu` (tests).
//!
//! # Where things are
//! - A command: its file in `commands`, and a row of `VERBS` in `cli`. What all definitions share:
//!   `args`. `set` switches outputs, `config set` changes what a module stores.
//! - Where a command goes, to the daemon or to a line opened here: `backend`. Errors of the command
//!   line itself: `usage`.
//! - Texts and columns of one command: in its file or folder (`ls points` is the table of `get`);
//!   texts of several, and the headings of `ls`: `texts`. What
//!   gateway and commands share is not here but in `railbus_app`.

#![forbid(unsafe_code)]

mod args;
mod backend;
mod cli;
mod commands;
mod texts;
mod usage;

use railbus_app::render::{
    Format,
    colour::{Colour, Paint},
};
use railbus_words::{Lang, width};
use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args_os().collect();
    let lang = Lang::of_process(&arguments);
    let format = Format::of_process(&arguments);
    let colour = Colour::of_process(&arguments);
    match cli::run(lang, arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) if failure.is_told() && !format.is_json() => failure.exit_code(),
        Err(failure) => {
            let paint = Paint::of(colour, &std::io::stderr());
            let text = failure.tell(lang, format, paint, width::of_errors());
            // If stderr is closed, the error can't be reported anywhere.
            let _ = writeln!(std::io::stderr(), "{text}");
            failure.exit_code()
        }
    }
}
