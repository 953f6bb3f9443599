//! What each monitored item may report without saying something false.
//!
//! Where a client sets no filter the library compares values only: it would never report that a
//! value has become stale. Such an item has no value while its status is not good, so that the
//! value changes too; and each change between statuses without a value changes how the value is
//! missing.
//!
//! Where an item has a sampling interval, the library reports a value that comes early later, with
//! a time that is not that of its reading: an item gets source timestamps only where the interval
//! could be revised to none.

use opcua::server::{CreateMonitoredItem, MonitoredItemHandle};
use opcua::types::{DataValue, DateTime, StatusCode, Variant};
use std::collections::HashMap;

/// The interval that the library takes for none, in milliseconds. It can't be set to 0.
const AT_ONCE: f64 = 0.000_1;

/// What an item may report.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ItemNeeds {
    /// Whether a change of the status alone is reported.
    sees_status: bool,
    /// Whether source timestamps are reported unchanged.
    keeps_time: bool,
    /// The source timestamp reported last.
    last: Option<DateTime>,
    /// The status reported last, and which of the two ways to have no value it took.
    status: Option<StatusCode>,
    is_empty: bool,
}

/// Whether a client has set a data change filter. The type has no name outside of the library; what
/// is not recognized counts as none, which is the safe side.
fn has_filter(item: &CreateMonitoredItem) -> bool {
    format!("{:?}", item.filter()).starts_with("DataChangeFilter(")
}

/// How many items may be created before everything begins anew: the library forgets neither those
/// of subscriptions that end nor says that they do.
pub(crate) const CREATED_MAX: usize = 100_000;

/// The monitored items of all clients.
#[derive(Debug, Default)]
pub(crate) struct Items {
    needs: HashMap<MonitoredItemHandle, ItemNeeds>,
    /// How many there were in all.
    created: usize,
}

impl Items {
    /// A client asks for an item, which begins with this value.
    pub(crate) fn created(&mut self, item: &mut CreateMonitoredItem, value: DataValue) {
        item.revise_sampling_interval(AT_ONCE);
        let needs = ItemNeeds {
            sees_status: has_filter(item),
            keeps_time: item.sampling_interval() == AT_ONCE,
            last: None,
            status: None,
            is_empty: false,
        };
        self.needs.insert(item.handle(), needs);
        self.created = self.created.saturating_add(1);
        let value = self.shaped(item.handle(), value);
        item.set_initial_value(value);
        item.set_status(StatusCode::Good);
    }

    /// Whether there were too many of them.
    pub(crate) const fn are_too_many(&self) -> bool {
        self.created >= CREATED_MAX
    }

    /// A client changed an item: its filter can't be seen, and its interval not be set.
    pub(crate) fn modified(&mut self, handle: MonitoredItemHandle) {
        if let Some(needs) = self.needs.get_mut(&handle) {
            (needs.sees_status, needs.keeps_time) = (false, false);
        }
    }

    /// An item is no more.
    pub(crate) fn deleted(&mut self, handle: MonitoredItemHandle) {
        self.needs.remove(&handle);
    }

    /// A value as this item reports it.
    pub(crate) fn shaped(
        &mut self,
        handle: MonitoredItemHandle,
        mut value: DataValue,
    ) -> DataValue {
        let Some(needs) = self.needs.get_mut(&handle) else {
            return DataValue {
                source_timestamp: None,
                ..value
            };
        };
        let is_good = value.status.is_none_or(|status| status.is_good());
        if !needs.sees_status && !is_good {
            // A client sees no difference; the library does.
            needs.is_empty ^= value.status != needs.status;
            value.value = needs.is_empty.then_some(Variant::Empty);
        }
        needs.status = value.status;
        // An earlier time than the last one, after the clock was set back, would be held up too.
        // The library may not take what comes without a time for news: it compares with the last
        // time that was reported.
        let is_later = match (needs.last, value.source_timestamp) {
            (Some(last), Some(time)) => time >= last,
            _ => true,
        };
        if !needs.keeps_time || !is_later {
            value.source_timestamp = None;
        }
        needs.last = value.source_timestamp.or(needs.last);
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HANDLE: MonitoredItemHandle = MonitoredItemHandle {
        subscription_id: 1,
        monitored_item_id: 2,
    };

    fn items(sees_status: bool, keeps_time: bool) -> Items {
        let needs = ItemNeeds {
            sees_status,
            keeps_time,
            last: None,
            status: None,
            is_empty: false,
        };
        Items {
            needs: HashMap::from([(HANDLE, needs)]),
            created: 1,
        }
    }

    fn at(ticks: i64) -> DateTime {
        DateTime::from(ticks)
    }

    fn value(status: StatusCode, ticks: i64) -> DataValue {
        DataValue {
            value: Some(Variant::Boolean(true)),
            status: Some(status),
            source_timestamp: Some(at(ticks)),
            ..DataValue::default()
        }
    }

    const STALE: StatusCode = StatusCode::UncertainLastUsableValue;

    #[test]
    fn an_item_without_a_filter_has_no_value_while_its_status_is_not_good() {
        let told = |sees_status, status| {
            let mut items = items(sees_status, true);
            items.shaped(HANDLE, value(status, 7)).value
        };
        let on = Some(Variant::Boolean(true));
        assert_eq!(
            (told(true, StatusCode::Good), told(true, STALE)),
            (on.clone(), on.clone())
        );
        assert_eq!(told(false, StatusCode::Good), on);
        assert_eq!(
            told(false, STALE).filter(|value| *value != Variant::Empty),
            None
        );
    }

    #[test]
    fn another_status_without_a_value_is_another_value_to_the_library() {
        let mut items = items(false, true);
        let mut told = |status| items.shaped(HANDLE, value(status, 7)).value;
        let stale = told(STALE);
        assert_eq!(told(STALE), stale, "nothing has changed");
        let offline = told(StatusCode::BadNoCommunication);
        assert_ne!(offline, stale);
        assert_ne!(told(StatusCode::BadConfigurationError), offline);
        assert_eq!(told(StatusCode::Good), Some(Variant::Boolean(true)));
    }

    #[test]
    fn a_time_is_that_of_the_reading_or_none() {
        let mut exact = items(true, true);
        let mut time = |ticks| exact.shaped(HANDLE, value(STALE, ticks)).source_timestamp;
        assert_eq!(time(20), Some(at(20)));
        assert_eq!(time(20), Some(at(20)), "the same reading, stale by now");
        assert_eq!(time(10), None, "the clock was set back");
        assert_eq!(time(11), None, "still before what the library goes by");
        assert_eq!(time(20), Some(at(20)));
        let mut held_up = items(true, false);
        let first = held_up.shaped(HANDLE, value(STALE, 20));
        assert_eq!(first.source_timestamp, None);
    }

    #[test]
    fn what_is_not_known_of_an_item_is_taken_for_the_worst() {
        let mut items = items(true, true);
        items.modified(HANDLE);
        let told = items.shaped(HANDLE, value(STALE, 20));
        assert_eq!(told.value.filter(|value| *value != Variant::Empty), None);
        assert_eq!(told.source_timestamp, None);
        items.deleted(HANDLE);
        assert_eq!(
            items.shaped(HANDLE, value(STALE, 20)).source_timestamp,
            None
        );
    }
}
