//! What received bytes turned out to be: three outcomes, never two.

use crate::Address;
use core::fmt;

/// What the beginning of a run of bytes is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decoded<T> {
    /// A good beginning; at least `more` bytes are missing.
    Partial {
        /// How many bytes at least are missing, 1 or more.
        more: usize,
    },
    /// The first `len` bytes are a whole frame with this meaning.
    Whole {
        /// The frame's length in bytes.
        len: usize,
        /// What it says.
        value: T,
    },
    /// These bytes can't be the frame looked for, however many follow.
    Malformed(Malformed),
}

impl<T> Decoded<T> {
    /// The same outcome with another value.
    #[inline]
    pub fn map<U>(self, change: impl FnOnce(T) -> U) -> Decoded<U> {
        match self {
            Decoded::Partial { more } => Decoded::Partial { more },
            Decoded::Whole { len, value } => Decoded::Whole {
                len,
                value: change(value),
            },
            Decoded::Malformed(why) => Decoded::Malformed(why),
        }
    }

    /// The outcome of a further step on the value of a whole frame.
    #[inline]
    pub(crate) fn and_then<U>(self, step: impl FnOnce(T) -> Result<U, Malformed>) -> Decoded<U> {
        match self {
            Decoded::Whole { len, value } => match step(value) {
                Ok(value) => Decoded::Whole { len, value },
                Err(why) => Decoded::Malformed(why),
            },
            Decoded::Partial { more } => Decoded::Partial { more },
            Decoded::Malformed(why) => Decoded::Malformed(why),
        }
    }

    /// The value of a whole frame.
    #[inline]
    pub fn whole(self) -> Option<T> {
        match self {
            Decoded::Whole { value, .. } => Some(value),
            Decoded::Partial { .. } | Decoded::Malformed(_) => None,
        }
    }
}

/// Why bytes are not the frame that was looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Malformed {
    /// They don't begin as this kind of frame does.
    Start,
    /// They come from, or are meant for, another module.
    Address,
    /// They name another function or command, or one that does not exist.
    Function,
    /// They end early, or hold more or fewer values than were asked for.
    Length,
    /// The checksum is wrong.
    Checksum,
    /// They acknowledge something else than was commanded.
    Echo,
    /// A character stands where it may not.
    Syntax,
    /// A number is outside its range.
    Value,
    /// The end mark is not where the frame should end.
    End,
}

impl fmt::Display for Malformed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Malformed::Start => "does not begin like such a frame",
            Malformed::Address => "another module's address",
            Malformed::Function => "another function",
            Malformed::Length => "incomplete, or not the number of values asked for",
            Malformed::Checksum => "wrong checksum",
            Malformed::Echo => "acknowledges something else than was commanded",
            Malformed::Syntax => "a character stands where it may not",
            Malformed::Value => "a number out of its range",
            Malformed::End => "no end mark where the frame should end",
        })
    }
}

/// A reply as decoded: what it says and who says it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reply<R> {
    /// The address the reply carries. Replies of the ASCII protocol with data, and its `>`,
    /// carry none.
    pub from: Option<Address>,
    /// What it says.
    pub response: R,
}

impl<R> Reply<R> {
    #[inline]
    pub(crate) fn whole(len: usize, from: Address, response: R) -> Decoded<Reply<R>> {
        Decoded::Whole {
            len,
            value: Reply {
                from: Some(from),
                response,
            },
        }
    }
}

/// Needs `needed` bytes: the first of them, or how many are missing.
#[inline]
pub(crate) fn need<const N: usize>(rx: &[u8]) -> Result<&[u8; N], usize> {
    rx.first_chunk::<N>()
        .ok_or_else(|| N.saturating_sub(rx.len()))
}
