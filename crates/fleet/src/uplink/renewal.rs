//! When a site asks for its key to be valid for longer.

use crate::creds::SiteClaims;
use crate::message::{KeyAnswer, KeyRequest, KeyResult};
use prost::Message as _;
use std::time::Duration;

/// It asks once less than one part in so many is left of the time for which the key was issued.
const LAST_PART: u64 = 3;
/// How long until it asks again.
const AGAIN: Duration = Duration::from_secs(60 * 60);

/// The key of a site, as far as it has to be renewed.
#[derive(Debug, Default)]
pub(super) struct Renewal {
    /// The signed claims.
    token: String,
    /// Since when and until when they are valid, in seconds since 1970; none if for ever.
    valid: Option<(u64, u64)>,
    /// The time of the centre, in milliseconds since 1970, at a time since the start. The clock of
    /// a site may be years off.
    centre: Option<(i64, Duration)>,
    /// The number of the request that is not answered.
    asked: Option<u64>,
    next: Duration,
}

impl Renewal {
    /// The site has these claims now.
    pub(super) fn set_claims(&mut self, claims: &SiteClaims, token: String) {
        if self.token != token {
            self.next = Duration::ZERO;
        }
        self.token = token;
        self.valid = claims.expires.map(|expires| (claims.issued, expires));
    }

    /// The centre's time is this, in milliseconds since 1970; 0 if it did not say so.
    pub(super) fn set_centre(&mut self, now: Duration, centre_ms: i64) {
        self.centre = (centre_ms > 0).then_some((centre_ms, now));
    }

    /// For how many seconds the key is still valid, and for how many it was issued, by the clock of
    /// the centre, or of the site where that is not known; none where it does not expire.
    pub(super) fn left(&self, now: Duration, clock_ms: i64) -> Option<(u64, u64)> {
        let time_ms = match self.centre {
            Some((then, at)) => {
                let since = now.saturating_sub(at).as_millis();
                then.saturating_add(i64::try_from(since).unwrap_or(i64::MAX))
            }
            None => clock_ms,
        };
        let time = u64::try_from(time_ms / 1_000).unwrap_or_default();
        let left = |(issued, expires): (u64, u64)| {
            (expires.saturating_sub(time), expires.saturating_sub(issued))
        };
        self.valid.map(left)
    }

    /// Whether it asks now.
    pub(super) fn is_due(&self, now: Duration, clock_ms: i64) -> bool {
        let is_old = |(left, of): (u64, u64)| left.saturating_mul(LAST_PART) < of;
        self.next <= now && self.left(now, clock_ms).is_some_and(is_old)
    }

    /// It asks, by this number; what it says.
    pub(super) fn ask(&mut self, now: Duration, number: u64) -> Vec<u8> {
        self.asked = Some(number);
        self.next = now + AGAIN;
        let request = KeyRequest {
            token: self.token.clone(),
            key: String::new(),
        };
        request.encode_to_vec()
    }

    /// Whether this is the number of its request.
    pub(super) fn is_asked(&self, number: u64) -> bool {
        self.asked == Some(number)
    }

    /// The new claims in the answer, or why there are none. Whether they are of this site is not
    /// checked.
    pub(super) fn answer(&mut self, answer: Option<&[u8]>) -> Result<String, String> {
        self.asked = None;
        let answer = answer.ok_or("no answer")?;
        let answer = KeyAnswer::decode(answer).map_err(|error| error.to_string())?;
        match answer.end {
            Some(KeyResult::Token(token)) => Ok(token),
            Some(KeyResult::Refusal(refusal)) => Err(refusal.reason),
            None => Err("the answer can't be read".to_owned()),
        }
    }
}
