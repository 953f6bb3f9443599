//! The content of the stores, in the types of the API.

use crate::render::csv::csv;
use jiff::Timestamp;
use railbus_api::past::{
    AckInfo, AuditInfo, BucketInfo, EventInfo, HistoryInfo, SampleInfo, StorageInfo, VerifiedInfo,
};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::SCHEMA;
use railbus_store::audit::{AuditRecord, Logged, Numbered, Verified};
use railbus_store::history::{
    Bucket, Chart, Event, HistoryError, Sample, Severity, Storage, StoredEvent, millis,
};

/// A timestamp of the database as RFC 3339.
pub fn moment(millis: i64) -> String {
    let moment = Timestamp::from_millisecond(millis);
    railbus_words::time::rfc3339(moment.unwrap_or(Timestamp::UNIX_EPOCH))
}

/// A chart of the point with this path, over an interval.
pub fn chart(
    point: &str,
    (from, to): (i64, i64),
    unit: Option<String>,
    chart: Chart,
) -> HistoryInfo {
    let (samples, buckets) = match chart {
        Chart::Samples(samples) => (Some(samples.into_iter().map(of_sample).collect()), None),
        Chart::Buckets(buckets) => (None, Some(buckets.into_iter().map(of_bucket).collect())),
    };
    HistoryInfo {
        schema: SCHEMA,
        point: point.to_owned(),
        from: moment(from),
        to: moment(to),
        unit,
        raw: samples.is_some(),
        samples,
        buckets,
    }
}

/// A sample of the history.
pub fn of_sample(sample: Sample) -> SampleInfo {
    SampleInfo {
        t: sample.t,
        v: sample.value,
        q: sample.grade.name().to_owned(),
    }
}

fn of_bucket(bucket: Bucket) -> BucketInfo {
    BucketInfo {
        t: bucket.t,
        min: bucket.values.map(|values| values.min),
        max: bucket.values.map(|values| values.max),
        mean: bucket.values.map(|values| values.mean),
        n: bucket.n,
        q: bucket.grade.name().to_owned(),
    }
}

/// An event, as reported live.
pub fn of_event(event: Event) -> EventInfo {
    let point = match (&event.module, event.point) {
        (Some(module), Some(label)) => Some(format!("{module}.{label}")),
        _ => None,
    };
    EventInfo {
        at: moment(millis(event.at)),
        id: event.id,
        kind: event.kind.name().to_owned(),
        severity: Severity::name(event.severity).to_owned(),
        module: event.module,
        point,
        line: event.line,
        who: event.who,
        via: event.via,
        what: event.what,
        before: event.before,
        after: event.after,
        end: event.end,
        code: event.code,
        text: event.text,
        acked: None,
    }
}

/// A stored event.
pub fn of_kept(kept: StoredEvent) -> EventInfo {
    EventInfo {
        acked: kept.acked.map(|ack| AckInfo {
            who: ack.who,
            at: moment(ack.at_ms),
            comment: ack.comment,
        }),
        ..of_event(kept.event)
    }
}

/// An entry of the audit log.
pub fn of_logged(entry: Logged) -> AuditInfo {
    AuditInfo {
        id: entry.id,
        at: of_millis(entry.at_ms),
        who: entry.who,
        via: entry.via,
        module: entry.module,
        what: entry.what,
        before: entry.before,
        after: entry.after,
        end: entry.end,
        hash: entry.hash,
    }
}

fn of_millis(millis: u64) -> String {
    moment(i64::try_from(millis).unwrap_or(i64::MAX))
}

/// The columns of the exported log.
pub const AUDIT_COLUMNS: [&str; 12] = [
    "seq", "at", "kind", "id", "who", "via", "module", "what", "before", "after", "end", "hash",
];

/// The result of verifying the chain.
pub fn verified(found: Verified) -> VerifiedInfo {
    VerifiedInfo {
        schema: SCHEMA,
        first: found.first,
        entries: found.entries,
        records: found.records,
        ok: found.broken_at.is_none(),
        broken_at: found.broken_at,
    }
}

/// The store can't be read.
pub fn unread(error: &std::io::Error) -> Problem {
    Problem::new(codes::HISTORY_FAILS).with("reason", error.to_string())
}

/// A record of the log as a row of a table.
pub fn audit_row(hash: &str, numbered: &Numbered) -> [String; AUDIT_COLUMNS.len()] {
    let own = String::clone;
    let none = String::new;
    let [kind, id, who, via, module, what, before, after, end] = match &numbered.record {
        AuditRecord::Begin {
            id,
            who,
            via,
            module,
            what,
            before,
        } => [
            "begin".to_owned(),
            own(id),
            own(who),
            own(via),
            own(module),
            own(what),
            own(before),
            none(),
            none(),
        ],
        AuditRecord::End { id, end, after } => {
            let [who, via, module, what, before] = [(); 5].map(|()| none());
            let (id, after, end) = (own(id), own(after), own(end));
            [
                "end".to_owned(),
                id,
                who,
                via,
                module,
                what,
                before,
                after,
                end,
            ]
        }
        AuditRecord::Start { version } => system_row("start", own(version)),
        AuditRecord::Stop => system_row("stop", none()),
        AuditRecord::Lost { records } => system_row("lost", records.to_string()),
        AuditRecord::Cut { seq, .. } => system_row("cut", seq.to_string()),
    };
    let (seq, at, hash) = (
        numbered.seq.to_string(),
        of_millis(numbered.at_ms),
        hash.to_owned(),
    );
    [
        seq, at, kind, id, who, via, module, what, before, after, end, hash,
    ]
}

/// The content of a record.
fn system_row(kind: &str, what: String) -> [String; 9] {
    let mut row: [String; 9] = Default::default();
    row[0] = kind.to_owned();
    row[5] = what;
    row
}

/// Size and limits: milliseconds and bytes.
pub fn storage(storage: Storage, audit_failing: bool, keep: (i64, u64)) -> StorageInfo {
    StorageInfo {
        schema: SCHEMA,
        history_bytes: storage.bytes,
        wal_bytes: storage.wal_bytes,
        points: storage.points,
        samples: storage.samples,
        oldest: storage.oldest_ms.map(moment),
        dropped: storage.dropped,
        disk_full: storage.disk_full,
        failing: storage.failing,
        audit_failing,
        keep_ms: keep.0,
        max_bytes: keep.1,
    }
}

/// Why the history gives no answer.
pub fn problem(error: &HistoryError) -> Problem {
    match error {
        HistoryError::NoSuchPoint => Problem::new(codes::NO_SUCH_POINT),
        HistoryError::TooLong => Problem::new(codes::TOO_MUCH_ASKED),
        HistoryError::Busy => Problem::new(codes::HISTORY_FAILS).with("reason", "busy"),
        HistoryError::Closed => Problem::new(codes::NO_HISTORY),
        HistoryError::Database(why) => {
            Problem::new(codes::HISTORY_FAILS).with("reason", why.as_str())
        }
    }
}

/// Records of the audit log with their hashes: rows of CSV, or one JSON document per line.
pub fn audit_text(records: &[(String, Numbered)], is_csv: bool) -> String {
    let lines = records.iter().map(|(hash, numbered)| {
        if is_csv {
            return csv(&audit_row(hash, numbered).each_ref().map(String::as_str));
        }
        let mut told = serde_json::to_value(numbered).unwrap_or_default();
        told["hash"] = hash.as_str().into();
        format!("{told}\n")
    });
    lines.collect()
}
