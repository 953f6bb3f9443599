//! The execution of rules, without clock and line: an [`RuleEngine`] is given the facts, and
//! returns when its rule acts and when it must be polled next. The same engine runs live and over
//! the history ([`Replay`]).

mod clock;
mod engine;
mod past;
mod replay;

pub use clock::LATE_MAX_MS;
pub use engine::{ACTS_PER_HOUR, BETWEEN_ACTS, Deadline, Fact, Moment, Output, Phase, RuleEngine};
pub(crate) use past::try_against;
pub use replay::{LISTED_MAX, Replay, Tried};
