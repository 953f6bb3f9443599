//! `railbus`, the one program: every command on every line goes through here.

#![forbid(unsafe_code)]

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
            // Where even stderr is gone there is nobody left to tell.
            let _ = writeln!(std::io::stderr(), "{text}");
            failure.exit_code()
        }
    }
}
