//! What a capture file says was asked and answered.

use crate::commands::Context;
use crate::commands::sniff::{Came, Capture, Ear};
use railbus_app::failure::Failure;
use railbus_sniff::{Frame, Heard, Input, Output, Reading, Role};
use railbus_wire::{Exchange, Instant, Micros, Protocol, Settings};
use railbus_words::Code;
use railbus_words::Lang;
use std::path::Path;

use super::ReplayText;

/// The most exchanges that are played.
const EXCHANGES_MAX: usize = 100_000;
/// The longest pause that is waited for.
pub(super) const PAUSE_MAX: Micros = Micros::from_secs(60);

/// A request as it was heard, and what came back.
#[derive(Clone, Debug)]
pub(super) struct Played {
    /// From the end of what came before to its beginning.
    pub(super) pause: Micros,
    pub(super) request: Vec<u8>,
    reading: Reading,
    pub(super) reply: Option<Reply>,
}

/// What came back, right or wrong, and how long after the request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Reply {
    pub(super) after: Micros,
    pub(super) bytes: Vec<u8>,
}

impl Played {
    /// What was asked; none where that is not known here.
    pub(super) fn exchange(&self) -> Option<Exchange<'_>> {
        self.reading.request(&self.request)
    }
}

/// The exchanges of the first line of a file.
#[derive(Debug)]
pub(super) struct Script {
    pub(super) settings: Settings,
    pub(super) played: Vec<Played>,
    last: Instant,
}

impl Script {
    /// The protocols that requests were made in.
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
        let mut script: Option<(Script, Ear)> = None;
        while let Some((line, came)) = capture.next(context)? {
            if *first.get_or_insert(line) != line {
                continue;
            }
            let (script, ear) = script.get_or_insert_with(|| {
                let wire = capture.wire(line);
                let script = Script {
                    settings: wire.settings,
                    played: Vec::new(),
                    last: Instant(0),
                };
                (script, Ear::new(wire.name, wire.settings, context.timeout))
            });
            script.hear(ear, &came);
            if script.played.len() > EXCHANGES_MAX {
                return Err(unplayable(context.lang, ReplayText::TooLong));
            }
        }
        match script {
            Some((script, _)) if !script.played.is_empty() => Ok(script),
            _ => Err(unplayable(context.lang, ReplayText::NothingToPlay)),
        }
    }

    fn hear(&mut self, ear: &mut Ear, came: &Came) {
        match came {
            Came::Sent(at, bytes) => ear.listener.handle(*at, Input::Sent(bytes)),
            Came::Bytes(at, bytes) | Came::Whole(at, bytes) => {
                ear.listener.handle(*at, Input::Bytes(bytes));
                ear.listener.handle(*at, Input::Silence);
            }
            Came::Lost(_) => {}
        }
        while let Output::Heard(heard) = ear.listener.poll() {
            if let Heard::Frame(frame) = heard {
                self.add(frame);
            }
        }
    }

    fn add(&mut self, frame: Frame) {
        let pause = match self.last {
            Instant(0) => Micros::ZERO,
            last => frame.at.since(last),
        };
        self.last = frame.end;
        let best = frame.readings.first().copied();
        match best {
            Some(reading) if reading.role == Some(Role::Request) => self.played.push(Played {
                pause,
                request: frame.bytes,
                reading,
                reply: None,
            }),
            // Whatever came after a request is played as its reply, damage and all.
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
