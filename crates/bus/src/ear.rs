//! What is heard: echo taken out, replies kept apart from what comes unasked.

use crate::EchoMode;
use railbus_wire::{Decoded, Exchange, Instant, Malformed, Micros};

/// The most bytes kept of what is heard after one request.
const HEARD_MAX: usize = 300;
/// A silence so long ends what was overheard before it.
const SILENCE: Micros = Micros::from_millis(50);
/// A line that was not silent for so long babbles.
const BABBLE: Micros = Micros::from_millis(500);

/// What was heard since the last request.
#[derive(Debug)]
pub(crate) struct Ear {
    buffer: [u8; HEARD_MAX],
    len: usize,
    /// Whether the adapter echoes; nothing while that is not known.
    pub(crate) echoes: Option<bool>,
    /// Where the echo ends and a reply may begin.
    reply_at: usize,
    /// So many bytes were heard before the request can have left: they are no reply.
    early: usize,
    /// The last request that was answered, to know its reply when it comes again.
    last_answered: Option<Exchange<'static>>,
    duplicates: bool,
    /// So many answered requests until the line is trusted not to duplicate.
    probation: u8,
    /// Since when the line was never silent.
    busy_since: Option<Instant>,
    babbles: bool,
}

impl Ear {
    pub(crate) fn new(mode: EchoMode, probation: u8) -> Ear {
        Ear {
            buffer: [0; HEARD_MAX],
            len: 0,
            echoes: match mode {
                EchoMode::Auto => None,
                EchoMode::On => Some(true),
                EchoMode::Off => Some(false),
            },
            reply_at: 0,
            early: 0,
            last_answered: None,
            duplicates: false,
            probation,
            busy_since: None,
            babbles: false,
        }
    }

    /// Everything heard since the last request that was neither echo nor a good reply.
    pub(crate) fn heard(&self) -> &[u8] {
        self.buffer
            .get(self.reply_at.min(self.len)..self.len)
            .unwrap_or_default()
    }

    /// What may be the reply: nothing as long as a known echo has not come back whole.
    pub(crate) fn reply(&self) -> &[u8] {
        if self.lacks_echo() {
            &[]
        } else {
            self.buffer
                .get(self.reply_from()..self.len)
                .unwrap_or_default()
        }
    }

    const fn lacks_echo(&self) -> bool {
        matches!(self.echoes, Some(true)) && self.reply_at == 0
    }

    fn reply_from(&self) -> usize {
        self.reply_at.max(self.early).min(self.len)
    }

    pub(crate) fn forget(&mut self) {
        self.len = 0;
        self.reply_at = 0;
        self.early = 0;
    }

    /// A request goes out: what was heard before it is no reply to it. True when that ends a
    /// babble.
    pub(crate) fn prepare(&mut self) -> bool {
        self.forget();
        self.busy_since = None;
        core::mem::take(&mut self.babbles)
    }

    /// Takes bytes heard after a request. `too_early` are those heard before it can have left:
    /// echo or collision, but no reply. True when the echo was found out just now.
    pub(crate) fn listen(
        &mut self,
        bytes: &[u8],
        exchange: &Exchange<'_>,
        sent: &[u8],
        too_early: bool,
    ) -> bool {
        if self.echoes == Some(false) && too_early {
            return false;
        }
        self.push(bytes);
        if too_early {
            self.early = self.len;
        }
        if self.reply_at > 0 {
            return false;
        }
        let heard = self.buffer.get(..self.len).unwrap_or_default();
        let echo_at = match self.echoes {
            // It was silent when it was looked for, as a slow network may be. What is its own
            // acknowledgement says nothing.
            Some(false) => (heard.starts_with(sent) && !is_own_reply(exchange, sent)).then_some(0),
            // A glitch may stand before it.
            Some(true) | None => heard.windows(sent.len().max(1)).position(|run| run == sent),
        };
        let Some(at) = echo_at else { return false };
        self.reply_at = at + sent.len();
        self.echoes.replace(true) != Some(true)
    }

    /// The wait for a reply is over: a line that gave nothing back has no echo.
    pub(crate) fn end_of_listening(&mut self) {
        if self.echoes.is_none() && self.len == 0 {
            self.echoes = Some(false);
        }
    }

    /// A good reply stood in [`Ear::reply`]: it is taken out, and what stood around it is kept.
    pub(crate) fn answered(
        &mut self,
        exchange: Exchange<'static>,
        sent: &[u8],
        skip: usize,
        len: usize,
    ) {
        let from = (self.reply_from() + skip).min(self.len);
        // Where more was heard than has room for an echo, one may be in it, disturbed.
        if self.echoes.is_none() && from < sent.len() {
            self.echoes = Some(false);
        }
        self.cut(skip, len);
        self.last_answered = Some(exchange);
        self.probation = self.probation.saturating_sub(1);
    }

    /// Takes `len` bytes out of [`Ear::reply`], after `skip` others.
    pub(crate) fn cut(&mut self, skip: usize, len: usize) {
        let from = (self.reply_from() + skip).min(self.len);
        let to = (from + len).min(self.len);
        self.buffer.copy_within(to..self.len, from);
        self.len -= to - from;
    }

    /// Takes bytes that nobody asked for; true when they make a babble.
    pub(crate) fn overhear(&mut self, now: Instant, busy_until: Instant, bytes: &[u8]) -> bool {
        if now.since(busy_until) > SILENCE {
            self.forget();
            self.busy_since = None;
        }
        if self.len + bytes.len() > HEARD_MAX {
            self.forget();
        }
        self.push(bytes);
        let since = *self.busy_since.get_or_insert(now);
        let news = !self.babbles && now.since(since) > BABBLE;
        self.babbles |= news;
        news
    }

    /// Whether the last good reply stands among the bytes overheard once more.
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

    /// A reply came twice; true when that is news.
    pub(crate) const fn become_cautious(&mut self) -> bool {
        !core::mem::replace(&mut self.duplicates, true)
    }

    /// Why what was heard is no reply; nothing where nothing was heard.
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
fn is_own_reply(exchange: &Exchange<'_>, sent: &[u8]) -> bool {
    matches!(exchange.decode_response(sent), Decoded::Whole { .. })
}
