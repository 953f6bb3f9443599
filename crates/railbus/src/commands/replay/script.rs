//! The requests and replies of a capture file.

use crate::commands::Context;
use crate::commands::sniff::{Capture, ListenedLine, Received};
use railbus_app::failure::Failure;
use railbus_sniff::{FrameRole, Input, Output, Reading, SniffEvent, SniffedFrame};
use railbus_wire::{Exchange, Instant, Micros, Protocol, SerialSettings};
use railbus_words::Code;
use railbus_words::Lang;
use std::path::Path;

use super::ReplayText;

/// The most exchanges that are played back.
const EXCHANGES_MAX: usize = 100_000;
/// The longest pause that is kept.
pub(super) const PAUSE_MAX: Micros = Micros::from_secs(60);

/// A request as captured, and its reply.
#[derive(Clone, Debug)]
pub(super) struct Played {
    /// The time from the end of the previous frame to its beginning.
    pub(super) pause: Micros,
    pub(super) request: Vec<u8>,
    reading: Reading,
    pub(super) reply: Option<Reply>,
}

/// The reply, right or wrong, and how long after the request it came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Reply {
    pub(super) after: Micros,
    pub(super) bytes: Vec<u8>,
}

impl Played {
    /// The request; none if its protocol is unknown.
    pub(super) fn exchange(&self) -> Option<Exchange<'_>> {
        self.reading.request(&self.request)
    }
}

/// The exchanges of the first line of a file.
#[derive(Debug)]
pub(super) struct Script {
    pub(super) settings: SerialSettings,
    pub(super) played: Vec<Played>,
    last: Instant,
}

impl Script {
    /// The protocols of the requests.
    pub(super) fn protocols(&self) -> Vec<Protocol> {
        let spoken = |protocol: &Protocol| {
            let mut played = self.played.iter();
            played.any(|played| played.reading.protocol == *protocol)
        };
        Protocol::ALL.into_iter().filter(spoken).collect()
    }

    pub(super) fn read(context: &Context, path: &Path) -> Result<Script, Failure> {
        let mut capture = Capture::open(context, path)?;
        let mut first = None;
        let mut script: Option<(Script, ListenedLine)> = None;
        while let Some((line, received)) = capture.next(context)? {
            if *first.get_or_insert(line) != line {
                continue;
            }
            let (script, listened) = script.get_or_insert_with(|| {
                let wire = capture.wire(line);
                let script = Script {
                    settings: wire.settings,
                    played: Vec::new(),
                    last: Instant(0),
                };
                (
                    script,
                    ListenedLine::new(wire.name, wire.settings, context.timeout),
                )
            });
            script.hear(listened, &received);
            if script.played.len() > EXCHANGES_MAX {
                return Err(unplayable(context.lang, ReplayText::TooLong));
            }
        }
        match script {
            Some((script, _)) if !script.played.is_empty() => Ok(script),
            _ => Err(unplayable(context.lang, ReplayText::NothingToPlay)),
        }
    }

    fn hear(&mut self, listened: &mut ListenedLine, received: &Received) {
        match received {
            Received::Sent(at, bytes) => listened.listener.handle(*at, Input::Sent(bytes)),
            Received::Bytes(at, bytes) | Received::Whole(at, bytes) => {
                listened.listener.handle(*at, Input::Bytes(bytes));
                listened.listener.handle(*at, Input::Silence);
            }
            Received::Lost(_) => {}
        }
        while let Output::Heard(heard) = listened.listener.poll() {
            if let SniffEvent::Frame(frame) = heard {
                self.add(frame);
            }
        }
    }

    fn add(&mut self, frame: SniffedFrame) {
        let pause = match self.last {
            Instant(0) => Micros::ZERO,
            last => frame.at.since(last),
        };
        self.last = frame.end;
        let best = frame.readings.first().copied();
        match best {
            Some(reading) if reading.role == Some(FrameRole::Request) => self.played.push(Played {
                pause,
                request: frame.bytes,
                reading,
                reply: None,
            }),
            // Whatever followed a request is played as its reply, damaged or not.
            _ => {
                let open = self
                    .played
                    .last_mut()
                    .filter(|played| played.reply.is_none());
                if let Some(played) = open {
                    played.reply = Some(Reply {
                        after: pause,
                        bytes: frame.bytes,
                    });
                }
            }
        }
    }
}

fn unplayable(lang: Lang, why: ReplayText) -> Failure {
    Failure::new(Code::NothingToPlay, lang.get(why).to_owned()).diagnosed()
}
