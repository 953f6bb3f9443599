//! What the centre tells of a site.

use super::KnownPoint;
use crate::message::{ConfigPhaseKind, ConfigReport};
use crate::{CLOCKS_DIFFER_MS, COPY_GONE, KEY_ENDS_SOON_S};
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

/// Values that were current within this time, two heartbeats, need no attention yet.
const OLD: Duration = Duration::from_secs(20);

/// Why a site needs attention.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SiteAttention {
    /// It is offline.
    Offline,
    /// It is online, and not all of its values have been current for a while.
    NotCurrent,
    /// Another machine with its key asked to be this site, not long ago.
    Duplicate,
    /// Its clock differs from the centre's.
    Clock,
    /// Its key expires soon, and should have been renewed.
    Key,
    /// It did not keep the configuration that it was given last, or was changed since.
    Config,
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
    /// How far its configuration was at its last heartbeat; none where it takes none from the
    /// centre, and where the centre was connected anew since.
    pub config: Option<&'c ConfigReport>,
    /// Until when its key is valid, in seconds since 1970; none where it does not expire.
    pub key_expires_s: Option<i64>,
    /// How long ago another machine with the site's key was refused the session.
    pub duplicate: Option<Duration>,
    /// The groups that it is in, by name.
    pub groups: &'c [String],
    /// Its points, by path.
    pub points: &'c BTreeMap<String, KnownPoint>,
    /// Their paths in lower case, a line each.
    pub paths: &'c str,
}

impl SiteView<'_> {
    /// Why it needs attention, at this time in seconds since 1970.
    pub fn attention(&self, clock_s: i64) -> impl Iterator<Item = SiteAttention> {
        let is_online = self.presence == SitePresence::Online;
        let is_off = |ahead: i64| ahead.unsigned_abs() > CLOCKS_DIFFER_MS;
        let is_old = |ago: Duration| ago > OLD;
        let ends = self.key_expires_s.map(|at| at.saturating_sub(clock_s));
        let all = [
            (
                self.presence == SitePresence::Offline,
                SiteAttention::Offline,
            ),
            (
                is_online && !self.is_current && self.vouched.is_none_or(is_old),
                SiteAttention::NotCurrent,
            ),
            (
                self.duplicate.is_some_and(|ago| ago < COPY_GONE),
                SiteAttention::Duplicate,
            ),
            (
                self.clock_ahead_ms.is_some_and(is_off),
                SiteAttention::Clock,
            ),
            (
                ends.is_some_and(|left| left < KEY_ENDS_SOON_S.cast_signed()),
                SiteAttention::Key,
            ),
            (
                self.config.is_some_and(is_not_as_wanted),
                SiteAttention::Config,
            ),
        ];
        let is_so = |(is_so, why): (bool, SiteAttention)| is_so.then_some(why);
        all.into_iter().filter_map(is_so)
    }

    /// Whether all of these words, in lower case and without spaces, are found: each in its name,
    /// its version, the name of one of its groups or the path of one of its points.
    #[must_use]
    pub fn has_words(&self, words: &[String]) -> bool {
        words.iter().all(|word| {
            // Names are in lower case.
            self.name.contains(word.as_str())
                || self
                    .groups
                    .iter()
                    .any(|group| group.contains(word.as_str()))
                || self.paths.contains(word.as_str())
                || self.version.to_lowercase().contains(word.as_str())
        })
    }
}

fn is_not_as_wanted(config: &ConfigReport) -> bool {
    match config.phase() {
        ConfigPhaseKind::Refused
        | ConfigPhaseKind::RolledBack
        | ConfigPhaseKind::LocalChange
        | ConfigPhaseKind::Interrupted => true,
        ConfigPhaseKind::Unspecified
        | ConfigPhaseKind::Unmanaged
        | ConfigPhaseKind::Current
        | ConfigPhaseKind::Pending
        | ConfigPhaseKind::Trying => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW_S: i64 = 1_795_910_400;
    const DAY_S: i64 = 86_400;

    fn well(points: &BTreeMap<String, KnownPoint>) -> SiteView<'_> {
        SiteView {
            name: "plant7",
            presence: SitePresence::Online,
            heard: Some(Duration::ZERO),
            is_current: true,
            vouched: Some(Duration::ZERO),
            behind: Some(0),
            clock_ahead_ms: Some(-30_000),
            session: "",
            time: None,
            version: "1.2.0-RC1",
            config: None,
            key_expires_s: Some(NOW_S + 21 * DAY_S),
            duplicate: Some(COPY_GONE),
            groups: &[],
            points,
            paths: "oven.k1\noven.k2\nhall.temperature\n",
        }
    }

    #[test]
    fn what_is_wrong_with_a_site_is_named() {
        use SiteAttention::{Clock, Config, Duplicate, Key, NotCurrent, Offline};
        let points = BTreeMap::new();
        let why = |view: SiteView<'_>| view.attention(NOW_S).collect::<Vec<_>>();
        let well = well(&points);
        assert_eq!(why(well.clone()), []);
        let a_moment = SiteView {
            is_current: false,
            vouched: Some(OLD),
            ..well.clone()
        };
        assert_eq!(why(a_moment), []);
        let never = SiteView {
            is_current: false,
            vouched: None,
            ..well.clone()
        };
        assert_eq!(why(never), [NotCurrent]);
        let away = SiteView {
            presence: SitePresence::Offline,
            is_current: false,
            clock_ahead_ms: None,
            ..well.clone()
        };
        assert_eq!(why(away.clone()), [Offline]);
        let unknown = SitePresence::Unknown;
        assert_eq!(
            why(SiteView {
                presence: unknown,
                ..away
            }),
            []
        );
        let bad = SiteView {
            is_current: false,
            vouched: Some(OLD + Duration::from_millis(1)),
            clock_ahead_ms: Some(30_001),
            key_expires_s: Some(NOW_S + 21 * DAY_S - 1),
            duplicate: Some(Duration::ZERO),
            ..well.clone()
        };
        assert_eq!(why(bad), [NotCurrent, Duplicate, Clock, Key]);
        let report = |phase: ConfigPhaseKind| ConfigReport {
            phase: phase.into(),
            ..ConfigReport::default()
        };
        let phases = (0..=8).map(|phase| ConfigPhaseKind::try_from(phase).unwrap());
        let told = phases.filter(|phase| {
            let config = report(*phase);
            let with = SiteView {
                config: Some(&config),
                ..well.clone()
            };
            let why = why(with);
            assert!(why.is_empty() || why == [Config]);
            !why.is_empty()
        });
        let told: Vec<_> = told.collect();
        let bad = [
            ConfigPhaseKind::Refused,
            ConfigPhaseKind::RolledBack,
            ConfigPhaseKind::LocalChange,
            ConfigPhaseKind::Interrupted,
        ];
        assert_eq!(told, bad);
        let expired = Some(NOW_S - DAY_S);
        assert_eq!(
            why(SiteView {
                key_expires_s: expired,
                ..well.clone()
            }),
            [Key]
        );
        assert_eq!(
            why(SiteView {
                key_expires_s: None,
                ..well
            }),
            []
        );
    }

    #[test]
    fn a_site_is_found_by_its_name_its_version_and_its_points() {
        let points = BTreeMap::new();
        let groups = ["hall-9".to_owned(), "north".to_owned()];
        let well = SiteView {
            groups: &groups,
            ..well(&points)
        };
        let has = |words: &str| {
            let words: Vec<_> = words.split(' ').map(str::to_owned).collect();
            well.has_words(&words)
        };
        for words in [
            "plant7",
            "ant",
            "rc1",
            "oven.k1",
            "temperature 1.2 plant",
            "k2 k1",
            "nor hall-9 oven",
        ] {
            assert!(has(words), "{words}");
        }
        for words in [
            "9north",
            "plant8",
            "oven.k3",
            "plant7 oven.k3",
            "k1oven",
            "RC1",
        ] {
            assert!(!has(words), "{words}");
        }
    }
}
