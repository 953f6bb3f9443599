//! Records frames in a capture file.

use crate::commands::Context;
use railbus_app::failure::Failure;
use railbus_app::frames::packet::packet;
use railbus_sniff::SniffEvent;
use railbus_sniff::capture;
use railbus_wire::SerialSettings;
use railbus_words::Code;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A capture file that is being written.
pub(in crate::commands) struct Recorder {
    path: PathBuf,
    out: Box<dyn Write>,
    lines: u32,
}

impl Recorder {
    /// A new file, or the standard output for `-`. An existing file is not overwritten.
    pub(in crate::commands) fn create(context: &Context, path: &Path) -> Result<Recorder, Failure> {
        let out: Box<dyn Write> = if path == Path::new("-") {
            Box::new(std::io::stdout())
        } else {
            let file = OpenOptions::new().write(true).create_new(true).open(path);
            Box::new(file.map_err(|error| failed(context, path, error))?)
        };
        Recorder::begin(context, path, out)
    }

    /// A pipe that another program has created and reads.
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

    /// Adds a line and returns its number.
    pub(in crate::commands) fn line(
        &mut self,
        context: &Context,
        name: &str,
        settings: SerialSettings,
    ) -> Result<u32, Failure> {
        self.put(context, &capture::interface(name, &settings.to_string()))?;
        self.lines += 1;
        Ok(self.lines - 1)
    }

    /// Records a frame. What is no frame, such as a missing reply, has no bytes to record; the
    /// times in the file show it.
    pub(in crate::commands) fn keep(
        &mut self,
        context: &Context,
        line: u32,
        heard: &SniffEvent,
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

fn failed(context: &Context, path: &Path, error: std::io::Error) -> Failure {
    let path = path.display().to_string();
    Failure::of(context.lang, Code::CaptureWrite)
        .because(format!("{path}: {error}"))
        .with_fact("file", path)
}
