//! The list of sites: which of them are wanted, and how many there are.

use super::view::{SCHEMA, site};
use crate::events::unreadable;
use railbus_api::fleet::{FleetCounts, FleetGroup, FleetSites, HubConnection};
use railbus_api::problem::{Problem, codes};
use railbus_fleet::centre::{Centre, SitePresence, SiteView};
use std::collections::BTreeMap;
use std::time::Duration;

/// The longest search, in bytes, and the most words of it.
const SEARCH_MAX: usize = 256;
const WORDS_MAX: usize = 8;
/// The most groups that are told.
const GROUPS_TOLD: usize = 1_000;

/// The parameters, with descriptions.
pub(super) const QUERY: &[(&str, &str)] = &[
    (
        "search",
        "words, all of which are found in its name, its version, its groups or the paths of its \
         points",
    ),
    (
        "state",
        "online, offline, unknown, or attention: something is wrong with it",
    ),
    ("group", "the group that it is in"),
    ("limit", "how many are listed; all where it is not said"),
    ("offset", "how many are left out before these"),
];

/// Which sites are wanted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct SitesWanted {
    /// In lower case.
    words: Vec<String>,
    state: Option<StateWanted>,
    group: Option<String>,
    window: ListWindow,
}

/// Which part of a long list is listed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ListWindow {
    limit: Option<usize>,
    offset: usize,
}

impl ListWindow {
    /// That of the parameters `limit` and `offset`.
    ///
    /// # Errors
    /// [`codes::BAD_REQUEST`] if one can't be read.
    pub(super) fn of(asked: &BTreeMap<String, String>) -> Result<ListWindow, Problem> {
        let number = |key: &str| {
            let text = asked.get(key).map(|text| text.parse::<usize>());
            text.transpose().map_err(|_| unreadable(key))
        };
        Ok(ListWindow {
            limit: number("limit")?,
            offset: number("offset")?.unwrap_or_default(),
        })
    }

    /// Whether the one at this place of the whole list, from 0, is in it.
    pub(super) fn has(&self, place: usize) -> bool {
        let before = place.checked_sub(self.offset);
        before.is_some_and(|before| self.limit.is_none_or(|limit| before < limit))
    }
}

/// The state of the sites that are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StateWanted {
    Online,
    Offline,
    Unknown,
    Attention,
}

impl SitesWanted {
    /// Those of these parameters.
    ///
    /// # Errors
    /// [`codes::BAD_REQUEST`] if one can't be read.
    pub(super) fn of(asked: &BTreeMap<String, String>) -> Result<SitesWanted, Problem> {
        let search = asked.get("search").map_or("", String::as_str);
        // Letter by letter, as paths are: the end of a word is no matter.
        let lower = |word: &str| word.chars().flat_map(char::to_lowercase).collect();
        let words: Vec<String> = search.split_whitespace().map(lower).collect();
        if search.len() > SEARCH_MAX || words.len() > WORDS_MAX {
            let reason = "a search has at most 256 bytes and 8 words";
            return Err(Problem::new(codes::BAD_REQUEST).with("reason", reason));
        }
        let state = match asked.get("state").map(String::as_str) {
            None => None,
            Some("online") => Some(StateWanted::Online),
            Some("offline") => Some(StateWanted::Offline),
            Some("unknown") => Some(StateWanted::Unknown),
            Some("attention") => Some(StateWanted::Attention),
            Some(_) => return Err(unreadable("state")),
        };
        Ok(SitesWanted {
            words,
            state,
            group: asked.get("group").cloned(),
            window: ListWindow::of(asked)?,
        })
    }

    /// Whether this site is among them, at this time in seconds since 1970.
    pub(super) fn finds(&self, view: &SiteView<'_>, clock_s: i64) -> bool {
        self.takes(view, view.attention(clock_s).next().is_some())
    }

    fn takes(&self, view: &SiteView<'_>, has_attention: bool) -> bool {
        let is_so = match self.state {
            None => true,
            Some(StateWanted::Online) => view.presence == SitePresence::Online,
            Some(StateWanted::Offline) => view.presence == SitePresence::Offline,
            Some(StateWanted::Unknown) => view.presence == SitePresence::Unknown,
            Some(StateWanted::Attention) => has_attention,
        };
        let is_in = |group: &String| view.groups.contains(group);
        is_so && self.group.as_ref().is_none_or(is_in) && view.has_words(&self.words)
    }
}

/// The sites that are wanted, at this time since the start, and in seconds since 1970; and so many
/// records besides what the centre heard were not understood.
pub(super) fn sites(
    (centre, unreadable): (&Centre, u64),
    wanted: &SitesWanted,
    (now, clock_s): (Duration, i64),
    error: Option<Problem>,
) -> FleetSites {
    let mut told = FleetSites {
        schema: SCHEMA,
        connection: HubConnection {
            connected: centre.is_connected(),
            error,
            unreadable: centre.unreadable().saturating_add(unreadable),
        },
        total: 0,
        counts: FleetCounts::default(),
        groups: groups(centre),
        sites: Vec::new(),
    };
    for view in centre.sites(now) {
        let has_attention = view.attention(clock_s).next().is_some();
        let counts = &mut told.counts;
        counts.all += 1;
        counts.attention += usize::from(has_attention);
        match view.presence {
            SitePresence::Online => counts.online += 1,
            SitePresence::Offline => counts.offline += 1,
            SitePresence::Unknown => counts.unknown += 1,
        }
        if !wanted.takes(&view, has_attention) {
            continue;
        }
        if wanted.window.has(told.total) {
            told.sites.push(site(&view, clock_s));
        }
        told.total += 1;
    }
    told
}

fn groups(centre: &Centre) -> Vec<FleetGroup> {
    let groups = centre.groups().into_iter().take(GROUPS_TOLD);
    let told = |(group, sites): (&str, usize)| FleetGroup {
        group: group.to_owned(),
        sites,
    };
    groups.map(told).collect()
}

#[cfg(test)]
pub(super) mod tests;
