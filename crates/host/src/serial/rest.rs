//! Whether a terminal is at rest: nothing was sent through it for so long that no reply can still
//! come.
//!
//! Linux updates the time stamp of a terminal's device when it is written to, but coarsely, so
//! that typing can't be observed: the stamp changes only with the first write in each block of
//! eight seconds. So the last write was before the end of the stamp's block, and if that end is
//! long ago, so is the write. Reading and opening do not change the stamp.

use std::time::{Duration, SystemTime};

/// The stamp changes once in this many seconds, counted from the epoch; a power of two.
const BLOCK_SECS: i64 = 8;
/// After this time no late reply can come.
pub(super) const REST: Duration = Duration::from_millis(500);

/// Whether a terminal with this time stamp, in whole seconds, is at rest by now. A stamp in the
/// future, after the clock was set back, says nothing.
pub(super) fn is_rested(now: SystemTime, stamp: i64) -> bool {
    let Some(end) = (stamp & !(BLOCK_SECS - 1)).checked_add(BLOCK_SECS) else {
        return false;
    };
    let rested = u64::try_from(end)
        .ok()
        .and_then(|end| SystemTime::UNIX_EPOCH.checked_add(Duration::from_secs(end)))
        .and_then(|end| end.checked_add(REST));
    rested.is_some_and(|rested| now >= rested)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> SystemTime {
        SystemTime::UNIX_EPOCH + Duration::from_millis(millis)
    }

    #[test]
    fn a_write_at_any_time_is_noticed_for_as_long_as_a_reply_may_come() {
        // The kernel's rule: a write changes the stamp only in another block.
        let mut stamp = 0;
        let writes = [100, 7_999, 8_000, 8_700, 15_999, 40_100, 47_900];
        for write in writes {
            let second = i64::try_from(write / 1_000).unwrap();
            if second / BLOCK_SECS != stamp / BLOCK_SECS {
                stamp = second;
            }
            for later in [0, 1, 499] {
                assert!(!is_rested(at(write + later), stamp), "{write} + {later}");
            }
        }
    }

    #[test]
    fn it_has_rested_half_a_second_after_the_end_of_the_block() {
        assert!(!is_rested(at(24_499), 17));
        assert!(is_rested(at(24_500), 17));
        assert!(is_rested(at(1_000_000), 17));
    }

    #[test]
    fn a_stamp_that_cant_be_tells_nothing() {
        assert!(!is_rested(at(1_000), 5_000));
        assert!(!is_rested(at(1_000), i64::MAX));
        assert!(!is_rested(at(1_000), i64::MIN));
        assert!(!is_rested(at(0), -1));
    }
}
