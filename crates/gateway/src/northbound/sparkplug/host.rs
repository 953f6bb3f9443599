//! The primary host application, as its `STATE` tells it.

use serde::Deserialize;

/// What a `STATE` says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub(super) struct HostState {
    online: bool,
    /// In milliseconds since 1970. Birth and death of one session of the host have the same.
    timestamp: u64,
}

/// What is known of the host. It outlives connections: what the broker kept may be of another
/// time.
#[derive(Debug, Default)]
pub(super) struct Host {
    is_online: bool,
    /// The time of the last state that counted.
    last: Option<u64>,
    /// The time of the last one that said that it is there.
    last_online: Option<u64>,
}

/// What a `STATE` means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum HostChange {
    /// It is there now.
    Came,
    /// It is gone.
    Went,
    /// Nothing new.
    Same,
    /// It is older than what is known, and does not count.
    Old,
}

impl HostState {
    /// Of the payload of a `STATE`.
    ///
    /// # Errors
    /// It is none.
    pub(super) fn parse(payload: &[u8]) -> Result<HostState, String> {
        serde_json::from_slice(payload).map_err(|error| error.to_string())
    }
}

impl Host {
    /// Whether it is there.
    pub(super) const fn is_online(&self) -> bool {
        self.is_online
    }

    /// A connection has begun: it must say again that it is there.
    pub(super) fn begin(&mut self) {
        self.is_online = false;
    }

    /// A `STATE` has come.
    pub(super) fn heard(&mut self, state: HostState) -> HostChange {
        let before = match state.online {
            true => self.last,
            false => self.last_online,
        };
        if before.is_some_and(|before| state.timestamp < before) {
            return HostChange::Old;
        }
        self.last = self.last.max(Some(state.timestamp));
        if state.online {
            self.last_online = Some(state.timestamp);
        }
        match (
            std::mem::replace(&mut self.is_online, state.online),
            state.online,
        ) {
            (false, true) => HostChange::Came,
            (true, false) => HostChange::Went,
            _ => HostChange::Same,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_state_is_an_error() {
        for wrong in [
            "",
            "ONLINE",
            "{}",
            "{\"online\":true}",
            "{\"online\":1,\"timestamp\":5}",
            "{\"online\":true,\"timestamp\":-5}",
        ] {
            assert!(HostState::parse(wrong.as_bytes()).is_err(), "{wrong}");
        }
        let state = HostState::parse(b"{\"timestamp\": 5, \"online\": true, \"x\": 1}");
        assert_eq!(
            state,
            Ok(HostState {
                online: true,
                timestamp: 5
            })
        );
    }

    /// The order of the primary host test of the TCK.
    #[test]
    fn a_state_counts_unless_it_is_older_than_what_is_known() {
        let mut host = Host::default();
        let mut heard = |online, timestamp| host.heard(HostState { online, timestamp });
        assert_eq!(heard(false, 10), HostChange::Same);
        assert_eq!(
            heard(true, 10),
            HostChange::Came,
            "birth and death are alike"
        );
        assert_eq!(heard(true, 10), HostChange::Same);
        assert_eq!(heard(false, 9), HostChange::Old);
        assert_eq!(heard(false, 10), HostChange::Went);
        assert_eq!(heard(true, 9), HostChange::Old);
        assert_eq!(heard(true, 11), HostChange::Came);
        host.begin();
        let mut heard = |online, timestamp| host.heard(HostState { online, timestamp });
        assert_eq!(heard(true, 10), HostChange::Old, "the broker kept it");
        assert_eq!(heard(true, 11), HostChange::Came);
    }
}
