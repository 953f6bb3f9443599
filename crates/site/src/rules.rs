//! Rules as they are carried out, without clock and line: what is known is told to an [`Engine`],
//! which says when its rule acts, and when it wants to be asked again. The same engine runs live
//! and over the past ([`Replay`]).

mod clock;
mod engine;
mod past;
mod replay;

pub use clock::LATE_MAX_MS;
pub use engine::{ACTS_PER_HOUR, BETWEEN_ACTS, Deadline, Engine, Fact, Moment, Output, Phase};
pub(crate) use past::try_against;
pub use replay::{LISTED_MAX, Replay, Tried};
