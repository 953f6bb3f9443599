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
pub(crate) fn span(
    details: &ReadRawModifiedDetails,
    times: TimestampsToReturn,
) -> Result<HistorySpan, StatusCode> {
    // Values of the past without their times say nothing [OPC UA part 4, 5.10.3].
    if times == TimestampsToReturn::Neither {
        return Err(StatusCode::BadTimestampsToReturnInvalid);
    }
    if details.is_read_modified {
        return Err(StatusCode::BadHistoryOperationUnsupported);
    }
    // Where a time is left out, the standard has the number say how many.
    let most = match details.num_values_per_node {
        0 => None,
        count => Some(usize::try_from(count).unwrap_or(usize::MAX)),
    };
    let of = |at: &DateTime| (!at.is_null()).then_some(*at);
    let span = |from, to, is_reverse| HistorySpan {
        from,
        to,
        is_reverse,
        most,
    };
    Ok(match (of(&details.start_time), of(&details.end_time)) {
        // The end is not part of it, in either direction. A start alone is one, and so is an end.
        (Some(from), Some(to)) if from == to => span(since(from), since(from) + 1, false),
        (Some(from), Some(to)) if from < to => span(since(from), since(to), false),
        (Some(from), Some(to)) => span(after(to), after(from), true),
        (Some(from), None) if most.is_some() => span(since(from), i64::MAX, false),
        (None, Some(to)) if most.is_some() => span(i64::MIN, after(to), true),
        _ => return Err(StatusCode::BadInvalidArgument),
    })
}

/// Milliseconds since 1970: the first that are not before this time. Those of the history have no
/// more digits; a client that goes on from just after a value must not get it again.
fn since(time: DateTime) -> i64 {
    let millis = time.as_chrono().timestamp_millis();
    millis + i64::from(at(millis) < time)
}

/// The first that are after this time.
fn after(time: DateTime) -> i64 {
    time.as_chrono().timestamp_millis() + 1
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
    let mut samples = match asked.is_reverse {
        false => history.samples(path, from, to).await?,
        true => {
            // One more says whether there are more.
            let mut samples = history.last(path, from, to, most + 1).await?;
            samples.retain(|sample| sample.t >= from);
            samples.reverse();
            samples
        }
    };
    let is_whole = samples.len() <= most && samples.len() < PIECE_MAX;
    samples.truncate(most);
    let last = samples.last().map(|sample| sample.t);
    let rest = |last| match asked.is_reverse {
        false => HistorySpan {
            from: last + 1,
            ..asked
        },
        true => HistorySpan { to: last, ..asked },
    };
    let next = last.filter(|_| !is_whole).map(rest);
    Ok((samples, next.filter(|next| next.from < next.to)))
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
    use railbus_store::history::{Keep, millis};

    fn details(from: Option<i64>, to: Option<i64>, most: u32) -> ReadRawModifiedDetails {
        let time = |ms: Option<i64>| ms.map_or_else(DateTime::null, at);
        ReadRawModifiedDetails {
            is_read_modified: false,
            start_time: time(from),
            end_time: time(to),
            num_values_per_node: most,
            return_bounds: false,
        }
    }

    fn asked(from: Option<i64>, to: Option<i64>, most: u32) -> Result<HistorySpan, StatusCode> {
        span(&details(from, to, most), TimestampsToReturn::Source)
    }

    #[test]
    fn values_of_the_past_have_their_times() {
        let details = details(Some(10), Some(20), 0);
        let end = span(&details, TimestampsToReturn::Neither);
        assert_eq!(end, Err(StatusCode::BadTimestampsToReturnInvalid));
        assert!(span(&details, TimestampsToReturn::Server).is_ok());
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
        assert_eq!(asked(None, Some(20), 5), of(i64::MIN, 21, true, Some(5)));
        assert_eq!(asked(Some(10), Some(10), 0), of(10, 11, false, None));
        let wrong = Err(StatusCode::BadInvalidArgument);
        assert_eq!(asked(Some(10), None, 0), wrong);
        assert_eq!(asked(None, None, 5), wrong);
    }

    #[test]
    fn a_time_goes_there_and_back() {
        let now = millis(SystemTime::now());
        assert_eq!((since(at(now)), after(at(now))), (now, now + 1));
    }

    #[tokio::test]
    async fn pages_have_every_value_once_and_none_is_empty() {
        let unique = format!("railbus-opcua-past-{}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        std::fs::create_dir_all(&folder).unwrap();
        let history = History::open(&folder, Keep::default()).unwrap();
        let now = millis(SystemTime::now());
        let times: Vec<i64> = (0..4).map(|nth| now - 1_000 + nth).collect();
        for &t in &times {
            let sample = Sample {
                t,
                value: Some(1.0),
                grade: SampleQuality::Good,
            };
            assert!(history.sample("oven.k1".into(), sample));
        }
        for is_reverse in [false, true] {
            let mut next = Some(HistorySpan {
                from: times[0],
                to: times[3] + 1,
                is_reverse,
                most: Some(2),
            });
            let mut pages = Vec::new();
            while let Some(asked) = next {
                let samples;
                (samples, next) = piece(&history, "oven.k1", asked).await.unwrap();
                pages.push(samples.iter().map(|sample| sample.t).collect::<Vec<_>>());
            }
            let mut expected = times.clone();
            if is_reverse {
                expected.reverse();
            }
            assert_eq!(pages, [&expected[..2], &expected[2..]], "{is_reverse}");
        }
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn just_after_a_value_is_not_at_its_time() {
        let later = DateTime::from(at(10).ticks() + 1);
        assert_eq!((since(later), after(later)), (11, 11));
    }
}
