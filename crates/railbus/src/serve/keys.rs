//! Commands that are told twice and done once: an `Idempotency-Key` names the command, and who
//! asks again under it gets the first answer.

use crate::api::problem::Problem;
use axum::body::Bytes;
use std::collections::VecDeque;
use std::hash::{BuildHasher, Hash, RandomState};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::OnceCell;

/// How many keys are remembered.
const KEYS_MAX: usize = 256;
/// The longest key.
pub(super) const KEY_LEN_MAX: usize = 128;

/// The end of a command, as JSON text.
pub(super) type End = Result<Bytes, Problem>;

type Slot = Arc<OnceCell<End>>;

/// The newest keys. They are forgotten when the program ends.
#[derive(Debug, Default)]
pub(super) struct Keys {
    known: Mutex<VecDeque<(String, u64, Slot)>>,
    random: RandomState,
}

impl Keys {
    /// The place for the end of the command under this key; nothing where the key was used for
    /// another command.
    pub(super) fn slot(&self, key: &str, command: impl Hash) -> Option<Slot> {
        let command = self.random.hash_one(command);
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, same, slot)) = known.iter().find(|(name, ..)| name == key) {
            return (*same == command).then(|| Arc::clone(slot));
        }
        if known.len() >= KEYS_MAX {
            // One whose command is under way would be done again.
            let ended = known.iter().position(|(.., slot)| slot.initialized());
            known.remove(ended.unwrap_or_default());
        }
        let slot = Slot::default();
        known.push_back((key.to_owned(), command, Arc::clone(&slot)));
        Some(slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_key_stands_for_one_command() {
        let keys = Keys::default();
        let first = keys.slot("a", "pump.do0=on").unwrap();
        let end = first
            .get_or_init(async || Ok(Bytes::from_static(b"1")))
            .await
            .clone();
        let again = keys.slot("a", "pump.do0=on").unwrap();
        let same = again
            .get_or_init(async || Ok(Bytes::from_static(b"2")))
            .await
            .clone();
        assert_eq!(end, same);
        assert!(keys.slot("a", "pump.do0=off").is_none());
        let under_way = keys.slot("scene", "evening").unwrap();
        for number in 0..KEYS_MAX {
            let slot = keys.slot(&number.to_string(), 0).unwrap();
            let _ = slot.set(Ok(Bytes::new()));
        }
        assert!(keys.slot("a", "pump.do0=off").is_some(), "it is forgotten");
        let again = keys.slot("scene", "evening").unwrap();
        assert!(Arc::ptr_eq(&under_way, &again), "it is not done twice");
    }
}
