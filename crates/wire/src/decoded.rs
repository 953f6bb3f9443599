//! The result of decoding received bytes: always one of three outcomes.

use crate::Address;
use core::fmt;

/// The result of decoding the beginning of some bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decoded<T> {
    /// A valid beginning; at least `more` bytes are missing.
    Partial {
        /// The least number of missing bytes, 1 or more.
        more: usize,
    },
    /// The first `len` bytes are a complete frame.
    Whole {
        /// The frame's length in bytes.
        len: usize,
        /// Its content.
        value: T,
    },
    /// These bytes can't be the expected frame, whatever follows.
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

    /// Applies a fallible step to the value of a complete frame.
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

    /// The value of a complete frame.
    #[inline]
    pub fn whole(self) -> Option<T> {
        match self {
            Decoded::Whole { value, .. } => Some(value),
            Decoded::Partial { .. } | Decoded::Malformed(_) => None,
        }
    }
}

/// Why bytes are not the expected frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Malformed {
    /// They do not begin like this kind of frame.
    Start,
    /// They come from, or are meant for, another module.
    Address,
    /// They name another function or command, or one that does not exist.
    Function,
    /// They end early, or contain more or fewer values than requested.
    Length,
    /// The checksum is wrong.
    Checksum,
    /// They acknowledge something other than what was sent.
    Echo,
    /// A character is not allowed at its position.
    Syntax,
    /// A number is out of range.
    Value,
    /// The end mark is not at the end of the frame.
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

/// A decoded reply: its sender and its content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reply<R> {
    /// The address the reply carries. Replies of the ASCII protocol with data, and its `>`,
    /// carry none.
    pub from: Option<Address>,
    /// Its content.
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

/// The first `needed` bytes, or how many are missing.
#[inline]
pub(crate) fn need<const N: usize>(rx: &[u8]) -> Result<&[u8; N], usize> {
    rx.first_chunk::<N>()
        .ok_or_else(|| N.saturating_sub(rx.len()))
}
