//! The history, as it was kept: raw values with their times, oldest or newest first.

use crate::known::{kept_variant, time};
use opcua::server::ContinuationPoint;
use opcua::server::node_manager::HistoryNode;
use opcua::types::{
    DataValue, DateTime, HistoryData, ReadRawModifiedDetails, StatusCode, TimestampsToReturn,
};
use railbus_device::PointKind;
use railbus_store::history::{History, HistoryError, PIECE_MAX, Sample, SampleQuality};
use std::time::{Duration, SystemTime};

/// A reading that goes on where it stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct HistorySpan {
    /// Since when, in milliseconds since 1970.
    from: i64,
    /// Before when.
    to: i64,
    /// The newest first.
    is_reverse: bool,
    /// How many at most; none for all.
    most: Option<usize>,
}

/// What a client asks for; the status if that can't be read.
pub(crate) fn span(details: &ReadRawModifiedDetails) -> Result<HistorySpan, StatusCode> {
    if details.is_read_modified {
        return Err(StatusCode::BadHistoryOperationUnsupported);
    }
    // Where a time is left out, the standard has the number say how many.
    let most = match details.num_values_per_node {
        0 => None,
        count => Some(usize::try_from(count).unwrap_or(usize::MAX)),
    };
    let of = |at: &DateTime| (!at.is_null()).then(|| to_millis(at));
    let span = |from, to, is_reverse| HistorySpan {
        from,
        to,
        is_reverse,
        most,
    };
    Ok(match (of(&details.start_time), of(&details.end_time)) {
        // The end is not part of it, in either direction.
        (Some(from), Some(to)) if from <= to => span(from, to.max(from + 1), false),
        (Some(from), Some(to)) => span(to + 1, from + 1, true),
        (Some(from), None) if most.is_some() => span(from, i64::MAX, false),
        (None, Some(to)) if most.is_some() => span(i64::MIN, to, true),
        _ => return Err(StatusCode::BadInvalidArgument),
    })
}

/// Milliseconds since 1970. The times of the history have no more digits.
fn to_millis(at: &DateTime) -> i64 {
    at.as_chrono().timestamp_millis()
}

/// Reads the values of a point for a client.
pub(crate) async fn read(
    history: &History,
    node: &mut HistoryNode,
    (path, kind): (&str, PointKind),
    (asked, bounds): (HistorySpan, bool),
    times: TimestampsToReturn,
) {
    let next = node
        .continuation_point()
        .map(|point| point.get::<HistorySpan>().copied());
    let asked = match next {
        None => asked,
        Some(Some(next)) => next,
        Some(None) => return node.set_status(StatusCode::BadContinuationPointInvalid),
    };
    match piece(history, path, asked).await {
        Ok((samples, next)) => {
            let is_first = node.continuation_point().is_none();
            let mut values: Vec<DataValue> = Vec::new();
            if bounds && is_first && !asked.is_reverse {
                values.extend(bound(history, path, kind, (asked.from, &samples)).await);
            }
            values.extend(samples.iter().map(|sample| value(kind, sample)));
            values.iter_mut().for_each(|value| with_times(value, times));
            let status = match values.is_empty() {
                true => StatusCode::GoodNoData,
                false => StatusCode::Good,
            };
            node.set_result(HistoryData {
                data_values: Some(values),
            });
            node.set_status(status);
            node.set_next_continuation_point(
                next.map(|next| ContinuationPoint::new(Box::new(next))),
            );
        }
        // It exists, but was never read.
        Err(HistoryError::NoSuchPoint) => {
            node.set_result(HistoryData {
                data_values: Some(Vec::new()),
            });
            node.set_status(StatusCode::GoodNoData);
        }
        Err(_) => node.set_status(StatusCode::BadResourceUnavailable),
    }
}

/// The next samples, in the order asked for, and where it goes on; none at the end.
async fn piece(
    history: &History,
    path: &str,
    asked: HistorySpan,
) -> Result<(Vec<Sample>, Option<HistorySpan>), HistoryError> {
    let most = asked.most.unwrap_or(PIECE_MAX).min(PIECE_MAX);
    let HistorySpan { from, to, .. } = asked;
    if asked.is_reverse {
        // One more says whether there are more.
        let mut samples = history.last(path, from, to, most).await?;
        samples.retain(|sample| sample.t >= from);
        samples.reverse();
        let last = samples.last().map(|sample| sample.t);
        let next = last.filter(|last| samples.len() == most && *last > from);
        return Ok((samples, next.map(|to| HistorySpan { to, ..asked })));
    }
    let mut samples = history.samples(path, from, to).await?;
    let is_whole = samples.len() <= most && samples.len() < PIECE_MAX;
    samples.truncate(most);
    let last = samples.last().map(|sample| sample.t);
    let next = last.filter(|last| !is_whole && *last + 1 < to);
    Ok((
        samples,
        next.map(|last| HistorySpan {
            from: last + 1,
            ..asked
        }),
    ))
}

/// The value at the beginning, where the client wants bounds and no sample is at that very time.
async fn bound(
    history: &History,
    path: &str,
    kind: PointKind,
    (from, samples): (i64, &[Sample]),
) -> Option<DataValue> {
    if samples.first().is_some_and(|first| first.t == from) {
        return None;
    }
    Some(match history.in_force(path, from).await {
        Ok(Some(sample)) => value(kind, &sample),
        _ => DataValue {
            status: Some(StatusCode::BadBoundNotFound),
            source_timestamp: Some(at(from)),
            ..DataValue::default()
        },
    })
}

fn value(kind: PointKind, sample: &Sample) -> DataValue {
    let status = match sample.grade {
        SampleQuality::Good => StatusCode::Good,
        SampleQuality::Stale => StatusCode::UncertainLastUsableValue,
        SampleQuality::Bad => StatusCode::BadNoData,
    };
    DataValue {
        value: sample
            .value
            .filter(|_| sample.grade != SampleQuality::Bad)
            .map(|value| kept_variant(kind, value)),
        status: Some(status),
        source_timestamp: Some(at(sample.t)),
        server_timestamp: Some(at(sample.t)),
        ..DataValue::default()
    }
}

/// Only the times that a client wants.
pub(crate) fn with_times(value: &mut DataValue, times: TimestampsToReturn) {
    let source = matches!(times, TimestampsToReturn::Source | TimestampsToReturn::Both);
    let server = matches!(times, TimestampsToReturn::Server | TimestampsToReturn::Both);
    if !source {
        value.source_timestamp = None;
    }
    if !server {
        value.server_timestamp = None;
    }
}

/// A time in milliseconds since 1970.
fn at(ms: i64) -> DateTime {
    let since = Duration::from_millis(ms.unsigned_abs());
    time(match ms < 0 {
        true => SystemTime::UNIX_EPOCH,
        false => SystemTime::UNIX_EPOCH + since,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_store::history::millis;

    fn asked(from: Option<i64>, to: Option<i64>, most: u32) -> Result<HistorySpan, StatusCode> {
        let time = |ms: Option<i64>| ms.map_or_else(DateTime::null, at);
        span(&ReadRawModifiedDetails {
            is_read_modified: false,
            start_time: time(from),
            end_time: time(to),
            num_values_per_node: most,
            return_bounds: false,
        })
    }

    #[test]
    fn a_span_goes_from_its_start_to_its_end() {
        let of = |from, to, is_reverse, most| {
            Ok(HistorySpan {
                from,
                to,
                is_reverse,
                most,
            })
        };
        assert_eq!(asked(Some(10), Some(20), 0), of(10, 20, false, None));
        assert_eq!(asked(Some(20), Some(10), 5), of(11, 21, true, Some(5)));
        assert_eq!(asked(Some(10), None, 5), of(10, i64::MAX, false, Some(5)));
        assert_eq!(asked(None, Some(20), 5), of(i64::MIN, 20, true, Some(5)));
        let wrong = Err(StatusCode::BadInvalidArgument);
        assert_eq!(asked(Some(10), None, 0), wrong);
        assert_eq!(asked(None, None, 5), wrong);
    }

    #[test]
    fn a_time_goes_there_and_back() {
        let now = millis(SystemTime::now());
        assert_eq!(to_millis(&at(now)), now);
    }
}
