//! Where traffic comes from: a port, the daemon, or a capture file.

use super::texts::SniffText;
use crate::backend::Frames;
use crate::commands::Context;
use crate::commands::place::{Place, port_failure};
use railbus_api::types::{FrameEvent, LineInfo};
use railbus_app::failure::Failure;
use railbus_host::{AnyPort, LineName, Port, PortError, SerialOptions};
use railbus_sniff::capture::{Damage, Direction, LINK_TYPE, ReadStep, Reader};
use railbus_wire::{Baud, Character, Instant, SerialSettings};
use railbus_words::Code;
use railbus_words::hex;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time;

/// Something received, and on which line.
#[derive(Debug)]
pub(in crate::commands) enum Received {
    /// Bytes, and the time at which the last of them ended.
    Bytes(Instant, Vec<u8>),
    /// A whole frame of the master, and when it ended.
    Sent(Instant, Vec<u8>),
    /// A whole frame of any sender, and when it ended.
    Whole(Instant, Vec<u8>),
    /// Events were lost.
    Lost(u64),
}

/// A clock in microseconds since 1970 that never goes back.
#[derive(Clone, Copy, Debug)]
pub(in crate::commands) struct Clock {
    epoch: u64,
    start: time::Instant,
}

impl Clock {
    pub(in crate::commands) fn new() -> Clock {
        let epoch = jiff::Timestamp::now().as_microsecond();
        Clock {
            epoch: u64::try_from(epoch).unwrap_or_default(),
            start: time::Instant::now(),
        }
    }

    pub(in crate::commands) fn now(self) -> Instant {
        let passed = self.start.elapsed().as_micros();
        Instant(self.epoch + u64::try_from(passed).unwrap_or_default())
    }

    /// The time from now until then.
    pub(in crate::commands) fn until(self, then: Instant) -> time::Duration {
        time::Duration::from_micros(then.since(self.now()).0)
    }
}

/// A port that is only listened to.
#[derive(Debug)]
pub(in crate::commands) struct Listening {
    port: AnyPort,
    place: Place,
    buffer: Vec<u8>,
}

impl Listening {
    pub(in crate::commands) async fn open(
        context: &Context,
        place: &Place,
    ) -> Result<Listening, Failure> {
        if let LineName::ModbusTcp { .. } = place.port {
            let message = context.lang.get(SniffText::NothingToHear).to_owned();
            return Err(Failure::new(Code::Usage, message));
        }
        let options = SerialOptions {
            settings: place.settings,
            listen_only: true,
            ..SerialOptions::default()
        };
        let mut port = AnyPort::new(&place.port, options);
        let opened = port.open().await;
        opened.map_err(|error| port_failure(context, place, &error))?;
        Ok(Listening {
            port,
            place: place.clone(),
            buffer: vec![0; 4_096],
        })
    }

    pub(in crate::commands) async fn next(
        &mut self,
        context: &Context,
        clock: Clock,
    ) -> Result<Received, Failure> {
        let read = self.port.read(&mut self.buffer).await;
        let count =
            read.map_err(|error| port_failure(context, &self.place, &PortError::of_loss(&error)))?;
        let bytes = self.buffer.get(..count).unwrap_or_default();
        Ok(Received::Bytes(clock.now(), bytes.to_vec()))
    }

    pub(in crate::commands) fn close(&mut self) {
        self.port.close();
    }
}

/// The source.
#[derive(Debug)]
pub(in crate::commands) enum Source {
    /// A port.
    Port(Box<Listening>),
    /// The daemon's own view of a line.
    Daemon(Frames),
}

impl Source {
    /// The next item; none if the daemon has ended.
    pub(in crate::commands) async fn next(
        &mut self,
        context: &Context,
        clock: Clock,
    ) -> Result<Option<Received>, Failure> {
        match self {
            Source::Port(port) => port.next(context, clock).await.map(Some),
            Source::Daemon(frames) => loop {
                let Some(event) = frames.next().await else {
                    return Ok(None);
                };
                let event = event.map_err(|problem| context.failure(&problem))?;
                if let Some(received) = received(event) {
                    return Ok(Some(received));
                }
            },
        }
    }
}

/// The line: the daemon names it first.
pub(in crate::commands) async fn line_of(
    context: &Context,
    frames: &mut Frames,
) -> Result<Wire, Failure> {
    match frames.next().await {
        Some(Ok(FrameEvent::Line { line })) => Ok(Wire::of(line)),
        Some(Err(problem)) => Err(context.failure(&problem)),
        Some(Ok(_)) | None => Err(Failure::of(context.lang, Code::NoDaemon)),
    }
}

/// The item of an event of the daemon, or of a line of our own.
pub(in crate::commands) fn received(event: FrameEvent) -> Option<Received> {
    let bytes = |text: &str| hex::parse(text);
    match event {
        FrameEvent::Line { .. } => None,
        FrameEvent::Gap { dropped } => Some(Received::Lost(dropped)),
        FrameEvent::Heard { at_us, bytes: text } => {
            Some(Received::Bytes(Instant(at_us), bytes(&text)?))
        }
        // The event's time is when the frame was written to the port.
        FrameEvent::Sent {
            at_us,
            baud,
            format,
            bytes: text,
        } => {
            let bytes = bytes(&text)?;
            let settings = settings(&format!("{baud} {format}")).unwrap_or(SerialSettings::FACTORY);
            let end = Instant(at_us) + settings.frame_time(bytes.len());
            Some(Received::Sent(end, bytes))
        }
    }
}

/// A line of a capture file.
#[derive(Clone, Debug)]
pub(in crate::commands) struct Wire {
    pub(in crate::commands) name: String,
    pub(in crate::commands) settings: SerialSettings,
}

impl Wire {
    pub(in crate::commands) fn of(line: LineInfo) -> Wire {
        let settings = settings(&format!("{} {}", line.baud, line.format));
        Wire {
            settings: settings.unwrap_or(SerialSettings::FACTORY),
            name: line.line,
        }
    }
}

/// A capture file that is read piece by piece.
#[derive(Debug)]
pub(in crate::commands) struct Capture {
    path: PathBuf,
    file: File,
    reader: Reader,
    buffer: Vec<u8>,
    /// How much of the buffer has been processed.
    done: usize,
    ended: bool,
    /// The number of packets with other link types.
    pub(in crate::commands) skipped: u64,
}

/// How much of a file is read at once, in bytes.
const PIECE: usize = 64 << 10;

impl Capture {
    pub(in crate::commands) fn open(context: &Context, path: &Path) -> Result<Capture, Failure> {
        let file = File::open(path).map_err(|error| unreadable(context, path, error))?;
        Ok(Capture {
            path: path.to_owned(),
            file,
            reader: Reader::new(),
            buffer: Vec::new(),
            done: 0,
            ended: false,
            skipped: 0,
        })
    }

    /// The lines found so far.
    pub(in crate::commands) fn wire(&self, number: usize) -> Wire {
        let interface = self.reader.interfaces().get(number);
        let name = interface.map(|interface| interface.name.clone());
        let settings = interface.and_then(|interface| settings(&interface.description));
        Wire {
            name: name
                .filter(|name| !name.is_empty())
                .unwrap_or_else(|| number.to_string()),
            settings: settings.unwrap_or(SerialSettings::FACTORY),
        }
    }

    /// The next frame and the number of its line; none at the end.
    pub(in crate::commands) fn next(
        &mut self,
        context: &Context,
    ) -> Result<Option<(usize, Received)>, Failure> {
        loop {
            let rest = self.buffer.get(self.done..).unwrap_or_default();
            let broken = |why| unreadable(context, &self.path, why);
            match self.reader.next(rest) {
                Ok(ReadStep::Other(len)) => self.done += len,
                Ok(ReadStep::Packet(len, packet)) => {
                    self.done += len;
                    let known = self.reader.interfaces().get(packet.line);
                    if known.is_none_or(|line| line.link_type != LINK_TYPE) {
                        self.skipped += 1;
                        continue;
                    }
                    let bytes = packet.bytes.to_vec();
                    let (at, line, direction) = (packet.at, packet.line, packet.direction);
                    let settings = self.wire(line).settings;
                    let end = at + settings.frame_time(bytes.len());
                    let received = match direction {
                        Some(Direction::Out) => Received::Sent(end, bytes),
                        _ => Received::Whole(end, bytes),
                    };
                    return Ok(Some((line, received)));
                }
                Ok(ReadStep::More(_)) if self.ended && rest.is_empty() => return Ok(None),
                Ok(ReadStep::More(_)) if self.ended => {
                    return Err(broken(context.lang.get(SniffText::FileEnds).to_owned()));
                }
                Ok(ReadStep::More(_)) => self.fill(context)?,
                Err(why) => {
                    let reason = context.lang.get(reason(why.why));
                    let values: &[(&str, &dyn std::fmt::Display)] =
                        &[("at", &why.at), ("why", &reason)];
                    return Err(broken(context.lang.fill(SniffText::FileBroken, values)));
                }
            }
        }
    }

    /// Reads on. The buffer holds at most a block and a piece.
    fn fill(&mut self, context: &Context) -> Result<(), Failure> {
        self.buffer.drain(..self.done.min(self.buffer.len()));
        self.done = 0;
        let limit = PIECE as u64;
        let read = (&self.file).take(limit).read_to_end(&mut self.buffer);
        let count = read.map_err(|error| unreadable(context, &self.path, error))?;
        self.ended = count == 0;
        Ok(())
    }
}

fn unreadable(context: &Context, path: &Path, why: impl ToString) -> Failure {
    let path = path.display().to_string();
    Failure::of(context.lang, Code::Capture)
        .because(format!("{path}: {}", why.to_string()))
        .with_fact("file", path)
}

const fn reason(why: Damage) -> SniffText {
    match why {
        Damage::NoCapture => SniffText::NoCapture,
        Damage::Length => SniffText::BlockLength,
        Damage::TooMuch => SniffText::BlockTooMuch,
        Damage::Interface => SniffText::BlockLine,
        Damage::Packet => SniffText::BlockPacket,
    }
}

/// Parses `9600 8N1`, as in our own files.
fn settings(text: &str) -> Option<SerialSettings> {
    let (baud, format) = text.split_once(' ')?;
    Some(SerialSettings {
        baud: Baud::from_rate(baud.parse().ok()?)?,
        character: Character::from_name(format)?,
    })
}
