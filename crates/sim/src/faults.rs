//! The faults of a line, how often they occur, and how often they did.

use railbus_wire::Micros;

/// A probability, in millionths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Chance(u32);

impl Chance {
    /// Never.
    pub const NEVER: Chance = Chance(0);
    /// Always.
    pub const ALWAYS: Chance = Chance(1_000_000);

    /// This many times in a million; more is always.
    #[must_use]
    pub const fn per_million(millionths: u32) -> Chance {
        if millionths > Chance::ALWAYS.0 {
            Chance::ALWAYS
        } else {
            Chance(millionths)
        }
    }

    /// This many times in a hundred.
    #[must_use]
    pub const fn percent(percent: u32) -> Chance {
        Chance::per_million(percent.saturating_mul(10_000))
    }

    /// The probability in millionths.
    #[must_use]
    pub const fn millionths(self) -> u32 {
        self.0
    }

    /// The probability of either of two.
    const fn either(self, other: Chance) -> Chance {
        let both = self.0 as u64 * other.0 as u64 / Chance::ALWAYS.0 as u64;
        Chance(self.0 + other.0 - both as u32)
    }
}

/// A range of durations to draw from, inclusive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DurationRange {
    /// The shortest.
    pub from: Micros,
    /// The longest.
    pub to: Micros,
}

impl DurationRange {
    /// A range in milliseconds.
    #[must_use]
    pub const fn millis(from: u64, to: u64) -> DurationRange {
        DurationRange {
            from: Micros::from_millis(from),
            to: Micros::from_millis(to),
        }
    }
}

/// The faults of a module or, set for the line, of every module and of the line itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Per character: one bit, occasionally two, are flipped. Parity detects one; it may be the
    /// stop bit. On the line: requests, too.
    pub flip: Chance,
    /// Per character: it is lost. On the line: requests, too.
    pub lose_character: Chance,
    /// Per request: its module does not receive it.
    pub lose_request: Chance,
    /// Per reply: it is not sent, though the module believes so.
    pub lose_reply: Chance,
    /// Per reply: its last character is changed, so that no protocol accepts it.
    pub spoil: Chance,
    /// Per reply: preceded by a 00, as from drivers that switch on slowly.
    pub glitch_before: Chance,
    /// Per reply: followed by an FF.
    pub glitch_after: Chance,
    /// Per reply: sent late, and the module receives nothing until it has been sent.
    pub late: Chance,
    /// The delay.
    pub late_by: DurationRange,
    /// Per reply: sent twice.
    pub again: Chance,
    /// The time from the end of the first one to the second.
    pub again_after: DurationRange,
    /// Per reply: sent in two to four pieces.
    pub pieces: Chance,
    /// The pause between pieces.
    pub pause: DurationRange,
    /// Per reply: garbage is sent instead.
    pub babble: Chance,
    /// The duration of the garbage.
    pub babble_for: DurationRange,
    /// The mean time between losses of power.
    pub cut_every: Option<Micros>,
    /// The duration of a loss of power.
    pub cut_for: DurationRange,
    /// The mean time between bursts of noise of one to three characters; only while the line is
    /// idle, and only when set for the line.
    pub noise_every: Option<Micros>,
}

impl Faults {
    /// No faults.
    pub const NONE: Faults = Faults {
        flip: Chance::NEVER,
        lose_character: Chance::NEVER,
        lose_request: Chance::NEVER,
        lose_reply: Chance::NEVER,
        spoil: Chance::NEVER,
        glitch_before: Chance::NEVER,
        glitch_after: Chance::NEVER,
        late: Chance::NEVER,
        late_by: DurationRange::millis(0, 0),
        again: Chance::NEVER,
        again_after: DurationRange::millis(0, 0),
        pieces: Chance::NEVER,
        pause: DurationRange::millis(0, 0),
        babble: Chance::NEVER,
        babble_for: DurationRange::millis(0, 0),
        cut_every: None,
        cut_for: DurationRange::millis(0, 0),
        noise_every: None,
    };

    /// The module receives and obeys, but never replies.
    pub const MUTE: Faults = Faults {
        lose_reply: Chance::ALWAYS,
        ..Faults::NONE
    };

    /// The module receives nothing.
    pub const DEAF: Faults = Faults {
        lose_request: Chance::ALWAYS,
        ..Faults::NONE
    };

    /// The faults of a module on a line: both combined, with the module's own durations where it
    /// has that fault itself.
    pub(crate) const fn on(self, line: Faults) -> Faults {
        const fn times(own: Chance, module: DurationRange, line: DurationRange) -> DurationRange {
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

/// Counts of faults since the line was created.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Injected {
    /// Characters with flipped bits.
    pub flips: u64,
    /// Lost characters.
    pub lost_characters: u64,
    /// Requests that their module did not receive.
    pub lost_requests: u64,
    /// Replies that were not sent.
    pub lost_replies: u64,
    /// Replies with a changed last character.
    pub spoilt: u64,
    /// Characters added before or after a reply.
    pub glitches: u64,
    /// Late replies.
    pub late: u64,
    /// Duplicated replies.
    pub again: u64,
    /// Replies in pieces.
    pub pieces: u64,
    /// Babbles of a module or the line.
    pub babble: u64,
    /// Losses of power.
    pub cuts: u64,
    /// Bursts of noise.
    pub noise: u64,
}

impl Injected {
    /// The sum of all.
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
