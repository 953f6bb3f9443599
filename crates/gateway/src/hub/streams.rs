//! Documents in streams: stored by compare-and-set, read from the leader, and deleted.

use super::link::DESIRED_STREAM;
use async_nats::jetstream::Context;
use async_nats::jetstream::ErrorCode;
use async_nats::jetstream::context::{PublishError, PublishErrorKind};
use async_nats::jetstream::message::PublishMessage;
use async_nats::jetstream::stream::LastRawMessageErrorKind;
use railbus_api::problem::{Problem, codes};
use railbus_fleet::centre::{StoreEnd, document_subject};
use std::error::Error as _;

/// The latest document of a subject and its revision; none if there is none.
pub(super) type LastDocument = Option<(Vec<u8>, u64)>;

/// The streams of which a removed site leaves nothing, and how its subjects begin there: what it
/// said, and what it was to be.
const OF_SITES: [(&str, &str); 3] = [
    ("STATE", "rb.up"),
    ("DATA", "rb.up"),
    (DESIRED_STREAM, "rb.desired"),
];

/// Stores a document, provided that the latest one of its subject has this revision.
pub(super) async fn put(
    streams: &Context,
    subject: String,
    payload: Vec<u8>,
    after: u64,
) -> (StoreEnd, Option<Problem>) {
    let message = PublishMessage::build()
        .payload(payload.into())
        .expected_last_subject_sequence(after);
    let stored = match streams.send_publish(subject, message).await {
        Ok(sent) => sent.await.map(|stored| stored.sequence),
        Err(error) => Err(error),
    };
    match stored {
        Ok(number) => (StoreEnd::Stored(number), None),
        Err(error) => match error.kind() {
            PublishErrorKind::WrongLastSequence => (StoreEnd::Conflict, None),
            _ if is_in_flight(&error) => (StoreEnd::Conflict, None),
            _ => {
                let problem = Problem::new(codes::FLEET_NOT_STORED);
                let problem = problem.with("reason", error.to_string());
                (StoreEnd::Unknown, Some(problem))
            }
        },
    }
}

/// Whether servers refuse it because another one of its subject is on its way among them.
fn is_in_flight(error: &PublishError) -> bool {
    let source = error.source();
    let said = source.and_then(|source| source.downcast_ref::<async_nats::jetstream::Error>());
    said.is_some_and(|error| error.error_code() == ErrorCode::STREAM_WRONG_LAST_SEQUENCE_CONSTANT)
}

/// Reads the latest document of a subject from the leader of its stream; none if that fails.
pub(super) async fn last_of(
    streams: &Context,
    stream: &str,
    subject: &str,
) -> Option<LastDocument> {
    let stream = streams.get_stream_no_info(stream).await.ok()?;
    match stream.get_last_raw_message_by_subject(subject).await {
        Ok(found) => Some(Some((found.payload.to_vec(), found.sequence))),
        Err(error) => match error.kind() {
            LastRawMessageErrorKind::NoMessageFound => Some(None),
            _ => None,
        },
    }
}

/// How far streams are: their names and last numbers.
pub(super) struct StreamEnds(Vec<(&'static str, &'static str, u64)>);

/// How far the streams of which a removed site leaves nothing are.
///
/// # Errors
/// They can't be used.
pub(super) async fn ends(streams: &Context) -> Result<StreamEnds, Problem> {
    let mut ends = Vec::new();
    for (name, subjects) in OF_SITES {
        let stream = streams.get_stream(name).await;
        let stream = stream.map_err(|error| unusable(&error))?;
        ends.push((name, subjects, stream.cached_info().state.last_sequence));
    }
    Ok(StreamEnds(ends))
}

fn unusable(reason: &dyn ToString) -> Problem {
    Problem::new(codes::FLEET_STREAMS).with("reason", reason.to_string())
}

/// Deletes what a site said up to these ends, and what people said of it before this revision.
///
/// # Errors
/// Some of it is still there.
pub(super) async fn purge(
    streams: &Context,
    site: &str,
    (StreamEnds(ends), revision): (StreamEnds, u64),
) -> Result<(), Problem> {
    // What people said first: it would count again. One that fails does not keep the others.
    let mut end = purge_before(streams, "FLEET", (&document_subject(site), revision)).await;
    // A stream without messages has nothing of before, and what comes now is to stay.
    for (name, subjects, last) in ends.into_iter().filter(|(_, _, last)| *last > 0) {
        let its = format!("{subjects}.{site}.*");
        let purged = purge_before(streams, name, (&its, last.saturating_add(1))).await;
        end = end.and(purged);
    }
    end
}

async fn purge_before(
    streams: &Context,
    stream: &str,
    (subject, number): (&str, u64),
) -> Result<(), Problem> {
    let stream = streams.get_stream_no_info(stream).await;
    let stream = stream.map_err(|error| unusable(&error))?;
    let purged = stream.purge().filter(subject).sequence(number).await;
    purged.map(|_| ()).map_err(|error| unusable(&error))
}
