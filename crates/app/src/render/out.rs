//! The two streams: results go to stdout, everything else to stderr.

use crate::failure::Failure;
use railbus_words::Code;
use railbus_words::Lang;
use std::io::{ErrorKind, Write};
use std::ops::ControlFlow;

/// Writes a part of the result. `Break` if the reader has closed the pipe, which is not an error.
pub fn put(lang: Lang, text: &str) -> Result<ControlFlow<()>, Failure> {
    let mut stdout = std::io::stdout();
    match stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush())
    {
        Ok(()) => Ok(ControlFlow::Continue(())),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(ControlFlow::Break(())),
        Err(error) => Err(Failure::of(lang, Code::Output).because(error)),
    }
}

/// Writes the whole result.
pub fn result(lang: Lang, text: &str) -> Result<(), Failure> {
    put(lang, text).map(|_| ())
}

/// Prints a message besides the result. If even stderr is closed, it is lost.
pub fn note(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}
