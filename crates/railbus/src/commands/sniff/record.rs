//! Frames kept in a capture file.

use super::words;
use crate::commands::Context;
use railbus_app::failure::Failure;
use railbus_sniff::capture::{self, Direction};
use railbus_sniff::{Frame, Heard, Role, Verdict};
use railbus_wire::Settings;
use railbus_words::Code;
use railbus_words::Lang;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A capture file that is written.
pub(in crate::commands) struct Recorder {
    path: PathBuf,
    out: Box<dyn Write>,
    lines: u32,
}

impl Recorder {
    /// A new file, or the standard output for `-`. A file that is there already is not touched.
    pub(in crate::commands) fn create(context: &Context, path: &Path) -> Result<Recorder, Failure> {
        let out: Box<dyn Write> = if path == Path::new("-") {
            Box::new(std::io::stdout())
        } else {
            let file = OpenOptions::new().write(true).create_new(true).open(path);
            Box::new(file.map_err(|error| failed(context, path, error))?)
        };
        Recorder::begin(context, path, out)
    }

    /// A pipe that somebody has made and reads.
    pub(in crate::commands) fn pipe(context: &Context, path: &Path) -> Result<Recorder, Failure> {
        let pipe = OpenOptions::new().write(true).open(path);
        let pipe = pipe.map_err(|error| failed(context, path, error))?;
        Recorder::begin(context, path, Box::new(pipe))
    }

    fn begin(context: &Context, path: &Path, out: Box<dyn Write>) -> Result<Recorder, Failure> {
        let mut recorder = Recorder {
            path: path.to_owned(),
            out,
            lines: 0,
        };
        let program = concat!("railbus ", env!("CARGO_PKG_VERSION"));
        recorder.put(context, &capture::header(program))?;
        Ok(recorder)
    }

    /// Adds a line and gives its number.
    pub(in crate::commands) fn line(
        &mut self,
        context: &Context,
        name: &str,
        settings: Settings,
    ) -> Result<u32, Failure> {
        self.put(context, &capture::interface(name, &settings.to_string()))?;
        self.lines += 1;
        Ok(self.lines - 1)
    }

    /// Keeps a frame. What is no frame, such as a missing reply, has no bytes to keep; who reads
    /// the file sees it from the times.
    pub(in crate::commands) fn keep(
        &mut self,
        context: &Context,
        line: u32,
        heard: &Heard,
    ) -> Result<(), Failure> {
        match packet(context.lang, line, heard) {
            Some(packet) => self.put(context, &packet),
            None => Ok(()),
        }
    }

    fn put(&mut self, context: &Context, bytes: &[u8]) -> Result<(), Failure> {
        let written = self.out.write_all(bytes).and_then(|()| self.out.flush());
        written.map_err(|error| failed(context, &self.path, error))
    }
}

/// A frame as a capture file keeps it; none of what has no bytes.
pub(crate) fn packet(lang: Lang, line: u32, heard: &Heard) -> Option<Vec<u8>> {
    let Heard::Frame(frame) = heard else {
        return None;
    };
    let comment = format!("{}: {}", frame.verdict.name(), words::of(lang, heard));
    let direction = direction(frame);
    Some(capture::packet(
        line,
        frame.at,
        &frame.bytes,
        direction,
        &comment,
    ))
}

/// Whose a frame was. Of a broken one that is a guess, and no reader is to rely on it.
fn direction(frame: &Frame) -> Option<Direction> {
    if let Verdict::Bad(_) = frame.verdict {
        return None;
    }
    match frame.readings.first()?.role? {
        Role::Request => Some(Direction::Out),
        Role::Reply => Some(Direction::In),
    }
}

fn failed(context: &Context, path: &Path, error: std::io::Error) -> Failure {
    let path = path.display().to_string();
    Failure::of(context.lang, Code::CaptureWrite)
        .because(format!("{path}: {error}"))
        .with_fact("file", path)
}
