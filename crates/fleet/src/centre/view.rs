//! What the centre tells of a site.

use super::KnownPoint;
use std::collections::BTreeMap;
use std::time::Duration;

/// Whether a site is connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SitePresence {
    /// The centre is not connected, or not long enough to tell.
    Unknown,
    /// Its heartbeats arrive.
    Online,
    /// They do not.
    Offline,
}

/// What the centre knows of a site.
#[derive(Clone, Debug)]
pub struct SiteView<'c> {
    /// Its name.
    pub name: &'c str,
    /// Whether it is connected.
    pub presence: SitePresence,
    /// The age of the last heartbeat of this session, by arrival.
    pub heard: Option<Duration>,
    /// The values are current: the site is online, everything its last heartbeat vouches for has
    /// arrived, and that heartbeat was sent less than 35 s ago.
    pub is_current: bool,
    /// The age of the values: how long ago the heartbeat that last confirmed all of them was sent.
    pub vouched: Option<Duration>,
    /// How many entries were not delivered at its last heartbeat; none unless online.
    pub behind: Option<u64>,
    /// How far its clock is ahead of the centre's, in milliseconds, not corrected for the latency
    /// of a message; none unless online.
    pub clock_ahead_ms: Option<i64>,
    /// Its present session, part of the subject of requests to it; empty if it never had one.
    pub session: &'c str,
    /// Its run, and at least how far its own time has come, in milliseconds; none unless online.
    pub time: Option<(&'c [u8], u64)>,
    /// Its version of railbus.
    pub version: &'c str,
    /// Until when its key is valid, in seconds since 1970; none where it does not expire.
    pub key_expires_s: Option<i64>,
    /// How long ago another machine with the site's key was refused the session.
    pub duplicate: Option<Duration>,
    /// Its points, by path.
    pub points: &'c BTreeMap<String, KnownPoint>,
}
