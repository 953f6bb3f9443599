//! What can go wrong on a line, how often, and how often it did.

use railbus_wire::Micros;

/// How likely something is each time, in millionths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Chance(u32);

impl Chance {
    /// It never happens.
    pub const NEVER: Chance = Chance(0);
    /// It happens every time.
    pub const ALWAYS: Chance = Chance(1_000_000);

    /// So many times of a million; more than that is every time.
    #[must_use]
    pub const fn per_million(millionths: u32) -> Chance {
        if millionths > Chance::ALWAYS.0 {
            Chance::ALWAYS
        } else {
            Chance(millionths)
        }
    }

    /// So many times of a hundred.
    #[must_use]
    pub const fn percent(percent: u32) -> Chance {
        Chance::per_million(percent.saturating_mul(10_000))
    }

    /// The likelihood in millionths.
    #[must_use]
    pub const fn millionths(self) -> u32 {
        self.0
    }

    /// The likelihood that either of two happens.
    const fn either(self, other: Chance) -> Chance {
        let both = self.0 as u64 * other.0 as u64 / Chance::ALWAYS.0 as u64;
        Chance(self.0 + other.0 - both as u32)
    }
}

/// A time to draw from, both ends included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Span {
    /// The shortest.
    pub from: Micros,
    /// The longest.
    pub to: Micros,
}

impl Span {
    /// So many milliseconds, from and to.
    #[must_use]
    pub const fn millis(from: u64, to: u64) -> Span {
        Span {
            from: Micros::from_millis(from),
            to: Micros::from_millis(to),
        }
    }
}

/// What goes wrong with a module, or, set for the line, with each module and the line itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Of each character: one bit, now and then two, turn over. Parity finds one, a stop bit
    /// may be the one. On the line: requests too.
    pub flip: Chance,
    /// Of each character: nobody hears it. On the line: requests too.
    pub lose_character: Chance,
    /// Of each request: the module that it is for does not hear it.
    pub lose_request: Chance,
    /// Of each reply: it is not sent, though the module believes so.
    pub lose_reply: Chance,
    /// Of each reply: its last character is another, so that no protocol takes it for a good
    /// one.
    pub spoil: Chance,
    /// Of each reply: a 00 comes before it, as drivers make it that switch on slowly.
    pub glitch_before: Chance,
    /// Of each reply: an FF comes after it.
    pub glitch_after: Chance,
    /// Of each reply: it comes late, and the module hears nothing until it has left.
    pub late: Chance,
    /// How much later.
    pub late_by: Span,
    /// Of each reply: it comes a second time.
    pub again: Chance,
    /// How long after the end of the first time.
    pub again_after: Span,
    /// Of each reply: it comes in two to four pieces.
    pub pieces: Chance,
    /// The pause between two pieces.
    pub pause: Span,
    /// Of each reply: garbage comes in its place.
    pub babble: Chance,
    /// How long the garbage lasts.
    pub babble_for: Span,
    /// The mean time between two loss-of-power events.
    pub cut_every: Option<Micros>,
    /// How long the power stays away.
    pub cut_for: Span,
    /// The mean time between noise of one to three characters; only where the line is idle,
    /// and only when set for the line.
    pub noise_every: Option<Micros>,
}

impl Faults {
    /// Nothing goes wrong.
    pub const NONE: Faults = Faults {
        flip: Chance::NEVER,
        lose_character: Chance::NEVER,
        lose_request: Chance::NEVER,
        lose_reply: Chance::NEVER,
        spoil: Chance::NEVER,
        glitch_before: Chance::NEVER,
        glitch_after: Chance::NEVER,
        late: Chance::NEVER,
        late_by: Span::millis(0, 0),
        again: Chance::NEVER,
        again_after: Span::millis(0, 0),
        pieces: Chance::NEVER,
        pause: Span::millis(0, 0),
        babble: Chance::NEVER,
        babble_for: Span::millis(0, 0),
        cut_every: None,
        cut_for: Span::millis(0, 0),
        noise_every: None,
    };

    /// The module hears and obeys, and never answers.
    pub const MUTE: Faults = Faults {
        lose_reply: Chance::ALWAYS,
        ..Faults::NONE
    };

    /// The module hears nothing.
    pub const DEAF: Faults = Faults {
        lose_request: Chance::ALWAYS,
        ..Faults::NONE
    };

    /// What goes wrong with a module on a line: either's faults, with the times of the module
    /// where it has that fault itself.
    pub(crate) const fn on(self, line: Faults) -> Faults {
        const fn times(own: Chance, module: Span, line: Span) -> Span {
            if own.0 == 0 { line } else { module }
        }
        let (cut_every, cut_for) = match self.cut_every {
            Some(_) => (self.cut_every, self.cut_for),
            None => (line.cut_every, line.cut_for),
        };
        Faults {
            flip: self.flip.either(line.flip),
            lose_character: self.lose_character.either(line.lose_character),
            lose_request: self.lose_request.either(line.lose_request),
            lose_reply: self.lose_reply.either(line.lose_reply),
            spoil: self.spoil.either(line.spoil),
            glitch_before: self.glitch_before.either(line.glitch_before),
            glitch_after: self.glitch_after.either(line.glitch_after),
            late: self.late.either(line.late),
            late_by: times(self.late, self.late_by, line.late_by),
            again: self.again.either(line.again),
            again_after: times(self.again, self.again_after, line.again_after),
            pieces: self.pieces.either(line.pieces),
            pause: times(self.pieces, self.pause, line.pause),
            babble: self.babble.either(line.babble),
            babble_for: times(self.babble, self.babble_for, line.babble_for),
            cut_every,
            cut_for,
            noise_every: None,
        }
    }
}

/// How often what went wrong, since the line was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Injected {
    /// Characters with a bit turned over.
    pub flips: u64,
    /// Characters that nobody heard.
    pub lost_characters: u64,
    /// Requests that the module they were for did not hear.
    pub lost_requests: u64,
    /// Replies that were not sent.
    pub lost_replies: u64,
    /// Replies whose last character became another.
    pub spoilt: u64,
    /// Characters added before or after a reply.
    pub glitches: u64,
    /// Replies that came late.
    pub late: u64,
    /// Replies that came a second time.
    pub again: u64,
    /// Replies that came in pieces.
    pub pieces: u64,
    /// Times that a module or the line babbled.
    pub babble: u64,
    /// Losses of power.
    pub cuts: u64,
    /// Times that noise came.
    pub noise: u64,
}

impl Injected {
    /// All of them.
    #[must_use]
    pub const fn total(&self) -> u64 {
        self.flips
            + self.lost_characters
            + self.lost_requests
            + self.lost_replies
            + self.spoilt
            + self.glitches
            + self.late
            + self.again
            + self.pieces
            + self.babble
            + self.cuts
            + self.noise
    }
}
