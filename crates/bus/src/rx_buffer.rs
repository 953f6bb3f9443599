//! The received bytes: the echo is removed, and replies are kept apart from unsolicited bytes.

use crate::EchoMode;
use railbus_wire::{Decoded, Exchange, Instant, Malformed, Micros};

/// The most bytes kept after one request.
const HEARD_MAX: usize = 300;
/// This much silence ends what was overheard before it.
const SILENCE: Micros = Micros::from_millis(50);
/// A line without silence for this long babbles.
const BABBLE: Micros = Micros::from_millis(500);
/// This many requests in a row have to come back before a line that gave replies without an echo
/// counts as echoing: one may be from a second master that sends the same.
const SIGHTS: u8 = 2;
/// After this many replies in a row without an echo there is no echo any more.
const BARE_MAX: u8 = 3;

/// What is known of the adapter's echo. The line keeps checking, whatever was detected or
/// configured: adapters are exchanged and jumpers are set while it runs.
#[derive(Clone, Copy, Debug)]
enum Echo {
    Unknown,
    /// No echo, unless it is seen this many more times in a row: [`SIGHTS`] after a reply without
    /// one, fewer if only silence spoke against it or it was seen since.
    No {
        sights: u8,
    },
    /// There is an echo, though this many replies in a row came without one.
    Yes {
        bare: u8,
    },
}

/// A change in what is known of the echo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum EchoChange {
    /// A request came back on a line that is not known to echo.
    Seen,
    /// The same, and from now on the line counts as echoing.
    Found,
}

/// The bytes received since the last request.
#[derive(Debug)]
pub(crate) struct RxBuffer {
    buffer: [u8; HEARD_MAX],
    len: usize,
    echo: Echo,
    /// The wait is over, and a reply came without its echo.
    is_bare: bool,
    /// Where the echo ends and a reply may begin.
    reply_at: usize,
    /// How many bytes were received before the request can have been sent: they are not a reply.
    early: usize,
    /// The last request that was answered, to recognise a duplicate of its reply.
    last_answered: Option<Exchange<'static>>,
    duplicates: bool,
    /// How many more answered requests until the line is trusted not to duplicate.
    probation: u8,
    /// Since when others have not been silent, without any good reply.
    busy_since: Option<Instant>,
    babbles: bool,
}

impl RxBuffer {
    pub(crate) fn new(mode: EchoMode, probation: u8) -> RxBuffer {
        RxBuffer {
            buffer: [0; HEARD_MAX],
            len: 0,
            echo: match mode {
                EchoMode::Auto => Echo::Unknown,
                EchoMode::On => Echo::Yes { bare: 0 },
                EchoMode::Off => Echo::No { sights: SIGHTS },
            },
            is_bare: false,
            reply_at: 0,
            early: 0,
            last_answered: None,
            duplicates: false,
            probation,
            busy_since: None,
            babbles: false,
        }
    }

    /// Whether the adapter echoes; none while that is unknown.
    pub(crate) const fn echoes(&self) -> Option<bool> {
        match self.echo {
            Echo::Unknown => None,
            Echo::No { .. } => Some(false),
            Echo::Yes { .. } => Some(true),
        }
    }

    /// Whether the echo of the last request came and was removed.
    pub(crate) const fn took_echo(&self) -> bool {
        self.reply_at > 0
    }

    /// Everything received since the last request that was neither echo nor a good reply.
    pub(crate) fn heard(&self) -> &[u8] {
        self.buffer
            .get(self.reply_at.min(self.len)..self.len)
            .unwrap_or_default()
    }

    /// What may be the reply: empty while a known echo is incomplete.
    pub(crate) fn reply(&self) -> &[u8] {
        if self.lacks_echo() {
            &[]
        } else {
            self.buffer
                .get(self.reply_from()..self.len)
                .unwrap_or_default()
        }
    }

    /// Whether others were heard since the last good reply, or while the request was sent.
    pub(crate) const fn is_disturbed(&self) -> bool {
        // Its own echo is none of theirs.
        self.busy_since.is_some() || self.early > self.reply_at
    }

    const fn lacks_echo(&self) -> bool {
        matches!(self.echo, Echo::Yes { .. }) && self.reply_at == 0 && !self.is_bare
    }

    fn reply_from(&self) -> usize {
        self.reply_at.max(self.early).min(self.len)
    }

    pub(crate) fn forget(&mut self) {
        self.len = 0;
        self.reply_at = 0;
        self.early = 0;
        self.is_bare = false;
    }

    /// A request is sent: bytes received before are not its reply. True when the silence before it
    /// ends a babble; a babble that leaves room for requests goes on.
    pub(crate) fn prepare(&mut self, now: Instant, busy_until: Instant) -> bool {
        self.forget();
        self.babbles && now.since(busy_until) > SILENCE && self.fell_silent()
    }

    /// Not a babble, or no longer: true when it was one.
    pub(crate) const fn fell_silent(&mut self) -> bool {
        self.busy_since = None;
        core::mem::replace(&mut self.babbles, false)
    }

    /// A request was not answered; true when what was received instead makes a babble.
    pub(crate) fn missed(&mut self, now: Instant, busy_until: Instant) -> bool {
        let is_silent = now.since(busy_until) > SILENCE;
        if is_silent {
            self.busy_since = None;
        }
        !is_silent && !self.heard().is_empty() && self.goes_on(now)
    }

    /// Others are still sending; true when that makes it a babble.
    fn goes_on(&mut self, now: Instant) -> bool {
        let since = *self.busy_since.get_or_insert(now);
        let news = !self.babbles && now.since(since) > BABBLE;
        self.babbles |= news;
        news
    }

    /// Takes bytes received after a request. `too_early` are those received before it can have been
    /// sent: echo or collision, but not a reply.
    pub(crate) fn listen(
        &mut self,
        bytes: &[u8],
        exchange: &Exchange<'_>,
        sent: &[u8],
        too_early: bool,
    ) -> Option<EchoChange> {
        if matches!(self.echo, Echo::No { .. }) && too_early {
            return None;
        }
        self.push(bytes);
        if too_early {
            self.early = self.len;
        }
        if self.reply_at > 0 {
            return None;
        }
        let heard = self.buffer.get(..self.len).unwrap_or_default();
        let at = match self.echo {
            // No echo came when it was looked for, but a slow network may have delayed it.
            Echo::No { .. } => heard.starts_with(sent).then_some(0),
            // A glitch may stand before it.
            Echo::Yes { .. } | Echo::Unknown => {
                heard.windows(sent.len().max(1)).position(|run| run == sent)
            }
        }?;
        let news = match &mut self.echo {
            Echo::Yes { .. } => None,
            // A request that is its own acknowledgement says nothing; but once there may be an
            // echo, it is not an acknowledgement either.
            Echo::No { sights } if is_own_reply(exchange, sent) => {
                if *sights == SIGHTS {
                    return None;
                }
                None
            }
            Echo::No { sights } if *sights > 1 => {
                *sights -= 1;
                Some(EchoChange::Seen)
            }
            Echo::No { .. } | Echo::Unknown => {
                self.echo = Echo::Yes { bare: 0 };
                Some(EchoChange::Found)
            }
        };
        self.reply_at = at + sent.len();
        news
    }

    /// The wait for a reply is over: if nothing came back there is no echo. A reply without its
    /// echo still counts, unless it may be the echo of its own request.
    pub(crate) fn end_of_listening(&mut self, exchange: &Exchange<'_>, sent: &[u8]) {
        match self.echo {
            Echo::Unknown if self.len == 0 => self.echo = Echo::No { sights: 1 },
            Echo::Yes { .. } if self.reply_at == 0 && !is_own_reply(exchange, sent) => {
                let heard = self.buffer.get(self.early..self.len).unwrap_or_default();
                self.is_bare = matches!(exchange.decode_response(heard), Decoded::Whole { .. });
            }
            _ => {}
        }
    }

    /// Takes the good reply out of [`RxBuffer::reply`] and keeps the bytes around it. True when it
    /// shows that the echo is gone.
    pub(crate) fn answered(
        &mut self,
        exchange: &Exchange<'static>,
        sent: &[u8],
        skip: usize,
        len: usize,
    ) -> bool {
        let from = (self.reply_from() + skip).min(self.len);
        // If more bytes came than an echo has room for, a corrupted echo may be among them.
        let is_bare = self.reply_at == 0 && from < sent.len();
        let mut is_gone = false;
        match &mut self.echo {
            Echo::No { sights: SIGHTS } => {}
            Echo::No { sights } if is_bare && !is_own_reply(exchange, sent) => *sights = SIGHTS,
            Echo::No { .. } => {}
            Echo::Unknown if is_bare => self.echo = Echo::No { sights: SIGHTS },
            Echo::Unknown => {}
            Echo::Yes { bare } if self.is_bare => {
                *bare += 1;
                is_gone = *bare == BARE_MAX;
            }
            Echo::Yes { bare } => *bare = 0,
        }
        if is_gone {
            self.echo = Echo::No { sights: SIGHTS };
        }
        self.cut(skip, len);
        self.last_answered = Some(*exchange);
        self.probation = self.probation.saturating_sub(1);
        is_gone
    }

    /// Takes `len` bytes out of [`RxBuffer::reply`], after `skip` others.
    pub(crate) fn cut(&mut self, skip: usize, len: usize) {
        let from = (self.reply_from() + skip).min(self.len);
        let to = (from + len).min(self.len);
        if to < self.len {
            self.buffer.copy_within(to..self.len, from);
        }
        self.len -= to - from;
    }

    /// How much of [`RxBuffer::heard`] was received before the good reply that was taken out after
    /// `skip` others.
    pub(crate) fn heard_before(&self, skip: usize) -> usize {
        (self.reply_from() + skip)
            .min(self.len)
            .saturating_sub(self.reply_at)
    }

    /// Takes `len` bytes out of [`RxBuffer::heard`], after `skip` others. What may be the reply is
    /// not known afterwards.
    pub(crate) fn cut_heard(&mut self, skip: usize, len: usize) {
        self.early = 0;
        self.cut(skip, len);
    }

    /// Takes unsolicited bytes; true when they make a babble.
    pub(crate) fn overhear(&mut self, now: Instant, busy_until: Instant, bytes: &[u8]) -> bool {
        if now.since(busy_until) > SILENCE {
            self.forget();
            self.busy_since = None;
        }
        if self.len + bytes.len() > HEARD_MAX {
            self.forget();
        }
        self.push(bytes);
        self.goes_on(now)
    }

    /// Whether the last good reply is among the overheard bytes again.
    pub(crate) fn holds_duplicate(&self) -> bool {
        self.last_answered.is_some_and(|exchange| {
            matches!(
                exchange.find_response(self.heard()),
                (_, Decoded::Whole { .. })
            )
        })
    }

    /// Whether the same reply may come twice on this line.
    pub(crate) const fn is_cautious(&self) -> bool {
        self.duplicates || self.probation > 0
    }

    /// A reply came twice; true for the first time.
    pub(crate) const fn become_cautious(&mut self) -> bool {
        !core::mem::replace(&mut self.duplicates, true)
    }

    /// Why the received bytes are not a reply; none if there were none.
    pub(crate) fn why(&self, exchange: &Exchange<'_>) -> Option<Malformed> {
        if self.lacks_echo() && self.len > 0 {
            return Some(Malformed::Start);
        }
        let heard = self.reply();
        if heard.is_empty() {
            return None;
        }
        match exchange.find_response(heard) {
            (_, Decoded::Malformed(why)) => Some(why),
            (_, Decoded::Partial { .. } | Decoded::Whole { .. }) => Some(Malformed::Length),
        }
    }

    fn push(&mut self, bytes: &[u8]) {
        let room = self.buffer.get_mut(self.len..).unwrap_or_default();
        let count = bytes.len().min(room.len());
        if let (Some(to), Some(from)) = (room.get_mut(..count), bytes.get(..count)) {
            to.copy_from_slice(from);
            self.len += count;
        }
    }
}

/// Whether a module acknowledges this request by repeating it.
pub(crate) fn is_own_reply(exchange: &Exchange<'_>, sent: &[u8]) -> bool {
    matches!(exchange.decode_response(sent), Decoded::Whole { .. })
}
