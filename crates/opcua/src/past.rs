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
    /// The times at its start and at its end for which there are no bounds, as far as that is still
    /// to be told.
    unbound: [Option<i64>; 2],
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
        unbound: [None; 2],
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
    let page = match next {
        None if bounds => match bounded(history, path, asked).await {
            Ok(asked) => page(history, path, asked).await,
            Err(error) => Err(error),
        },
        None => page(history, path, asked).await,
        Some(Some(next)) => page(history, path, next).await,
        Some(None) => return node.set_status(StatusCode::BadContinuationPointInvalid),
    };
    match page {
        Ok((kept, next)) => {
            let of = |kept: &Kept| {
                kept.as_ref()
                    .map_or_else(|at| no_bound(*at), |s| value(kind, s))
            };
            let mut values: Vec<DataValue> = kept.iter().map(of).collect();
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

/// A sample, or the time of a bound that there is not.
type Kept = Result<Sample, i64>;

/// A span with the values that it lies between [OPC UA part 11, 4.4].
async fn bounded(
    history: &History,
    path: &str,
    asked: HistorySpan,
) -> Result<HistorySpan, HistoryError> {
    let HistorySpan { from, to, .. } = asked;
    // The times that the client gave, where it gave them.
    let shift = i64::from(asked.is_reverse);
    let lower = (from != i64::MIN).then(|| from - shift);
    let upper = (to != i64::MAX).then(|| if from + 1 == to { from } else { to - shift });
    let mut span = asked;
    if let Some(at) = lower {
        match history.in_force(path, at + 1).await? {
            Some(before) => span.from = before.t,
            None => span.unbound[0] = Some(at),
        }
    }
    if let Some(at) = upper {
        match history.samples(path, at, i64::MAX).await?.first() {
            Some(after) => span.to = after.t + 1,
            None => span.unbound[1] = Some(at),
        }
    }
    if asked.is_reverse {
        span.unbound.reverse();
    }
    Ok(span)
}

/// The next values, in the order asked for, and where it goes on; none at the end.
async fn page(
    history: &History,
    path: &str,
    asked: HistorySpan,
) -> Result<(Vec<Kept>, Option<HistorySpan>), HistoryError> {
    let most = asked.most.unwrap_or(PIECE_MAX).min(PIECE_MAX);
    let [start, end] = asked.unbound;
    let mut kept: Vec<Kept> = start.map(Err).into_iter().collect();
    let rest = HistorySpan {
        unbound: [None, end],
        ..asked
    };
    if kept.len() == most {
        return Ok((kept, Some(rest)));
    }
    let (samples, next) = piece(history, path, rest, most - kept.len()).await?;
    kept.extend(samples.into_iter().map(Ok));
    let next = match (next, end) {
        (None, Some(end)) if kept.len() < most => {
            kept.push(Err(end));
            None
        }
        // Only that is left.
        (None, Some(_)) => Some(HistorySpan {
            from: rest.to,
            ..rest
        }),
        (next, _) => next,
    };
    Ok((kept, next))
}

/// So many samples, in the order asked for, and where it goes on; none at the end.
async fn piece(
    history: &History,
    path: &str,
    asked: HistorySpan,
    most: usize,
) -> Result<(Vec<Sample>, Option<HistorySpan>), HistoryError> {
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

/// What stands for a bound that there is not.
fn no_bound(time: i64) -> DataValue {
    DataValue {
        status: Some(StatusCode::BadBoundNotFound),
        source_timestamp: Some(at(time)),
        ..DataValue::default()
    }
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
                unbound: [None; 2],
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

    /// A history with values at these minutes, and what is read of it, page by page.
    struct Minutes(History, std::path::PathBuf);

    /// The time of a minute.
    const fn minute(nth: i64) -> i64 {
        1_700_000_000_000 + nth * 60_000
    }

    impl Minutes {
        fn new(name: &str) -> Minutes {
            let unique = format!("railbus-opcua-past-{}-{name}", std::process::id());
            let folder = std::env::temp_dir().join(unique);
            std::fs::create_dir_all(&folder).unwrap();
            let history = History::open(&folder, Keep::default()).unwrap();
            for nth in [0, 2, 3, 5, 6] {
                let sample = Sample {
                    t: minute(nth),
                    value: Some(1.0),
                    grade: SampleQuality::Good,
                };
                assert!(history.sample("oven.k1".into(), sample));
            }
            Minutes(history, folder)
        }

        /// The minutes of the values on each page; `None` for a bound that there is not.
        async fn read(
            &self,
            (from, to): (i64, i64),
            most: u32,
            bounds: bool,
        ) -> Vec<Vec<Option<i64>>> {
            let mut span = asked(Some(minute(from)), Some(minute(to)), most).unwrap();
            if bounds {
                span = bounded(&self.0, "oven.k1", span).await.unwrap();
            }
            let (mut pages, mut next) = (Vec::new(), Some(span));
            while let Some(asked) = next {
                let kept;
                (kept, next) = page(&self.0, "oven.k1", asked).await.unwrap();
                let of = |kept: &Kept| kept.ok().map(|kept| (kept.t - minute(0)) / 60_000);
                pages.push(kept.iter().map(of).collect());
            }
            pages
        }
    }

    impl Drop for Minutes {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.1);
        }
    }

    #[tokio::test]
    async fn pages_have_every_value_once_and_none_is_empty() {
        let kept = Minutes::new("pages");
        let [n0, n2, n3, n5] = [0, 2, 3, 5].map(Some);
        assert_eq!(kept.read((0, 6), 2, false).await, [[n0, n2], [n3, n5]]);
        assert_eq!(kept.read((5, -1), 2, false).await, [[n5, n3], [n2, n0]]);
        let pages = [vec![None], vec![n0], vec![n2]];
        assert_eq!(kept.read((-1, 2), 1, true).await, pages);
        let last = kept.read((6, 7), 1, true).await;
        assert_eq!(last, [[Some(6)], [None]]);
    }

    #[tokio::test]
    async fn a_span_has_the_bounds_of_the_published_table() {
        // [OPC UA part 11, 4.4, table 1]: values at 5:00, 5:02, 5:03, 5:05 and 5:06.
        let kept = Minutes::new("bounds");
        let [n0, n2, n3, n5, n6] = [0, 2, 3, 5, 6].map(Some);
        for (span, bounds, values) in [
            ((0, 5), true, vec![n0, n2, n3, n5]),
            ((0, 5), false, vec![n0, n2, n3]),
            ((1, 4), true, vec![n0, n2, n3, n5]),
            ((1, 4), false, vec![n2, n3]),
            ((5, 0), true, vec![n5, n3, n2, n0]),
            ((5, 0), false, vec![n5, n3, n2]),
            ((4, 1), true, vec![n5, n3, n2, n0]),
            ((4, 1), false, vec![n3, n2]),
            ((-1, 5), true, vec![None, n0, n2, n3, n5]),
            ((-1, 5), false, vec![n0, n2, n3]),
            ((1, 7), true, vec![n0, n2, n3, n5, n6, None]),
            ((1, 7), false, vec![n2, n3, n5, n6]),
            ((7, 1), true, vec![None, n6, n5, n3, n2, n0]),
            ((3, 3), true, vec![n3]),
        ] {
            let pages = kept.read(span, 0, bounds).await;
            assert_eq!(pages, [values], "{span:?}, {bounds}");
        }
    }

    #[test]
    fn just_after_a_value_is_not_at_its_time() {
        let later = DateTime::from(at(10).ticks() + 1);
        assert_eq!((since(later), after(later)), (11, 11));
    }
}
