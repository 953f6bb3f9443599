//! What is said of the node itself.

use super::super::backlog::MissingSpan;
use super::super::payload::{DataType, Metric, MetricValue, Payload};
use super::super::topics::Topics;
use super::{Now, Setup, commands};
use crate::northbound::broker::message::Message;

/// What is said of the node itself at its birth.
pub(super) fn node_metrics(
    setup: &Setup,
    bd_seq: u8,
    online: usize,
    missing: Option<MissingSpan>,
    now: Now,
) -> Vec<Metric> {
    let metric = |name: &str, value, of| Metric::new(name, now.wall, Some(value)).of_type(of);
    let text = |text: &str| MetricValue::Text(text.to_owned());
    let mut metrics = vec![
        death_metric(bd_seq, Some(now.wall)),
        metric(
            commands::REBIRTH,
            MetricValue::Boolean(false),
            DataType::Boolean,
        ),
        metric(
            "Properties/Version",
            text(env!("CARGO_PKG_VERSION")),
            DataType::Text,
        ),
        metric("Properties/Site", text(&setup.site), DataType::Text),
    ];
    let (answering, of) = answering(online, now);
    metrics.push(answering.of_type(of));
    if setup.has_outbox {
        let missing = missing_metrics(missing, now);
        metrics.extend(missing.map(|(metric, of)| metric.of_type(of)));
    }
    metrics
}

/// How many modules answer.
pub(super) fn answering(online: usize, now: Now) -> (Metric, DataType) {
    let value = MetricValue::Long(online as u64);
    let metric = Metric::new("Modules/Answering", now.wall, Some(value));
    (metric, DataType::Int64)
}

/// Between which times changes may be missing.
pub(super) fn missing_metrics(missing: Option<MissingSpan>, now: Now) -> [(Metric, DataType); 2] {
    let from = missing.and_then(|missing| missing.from);
    let until = missing.map(|missing| missing.until);
    [("Missing/From", from), ("Missing/Until", until)].map(|(name, time)| {
        let metric = Metric::new(name, now.wall, time.map(MetricValue::Long));
        (metric, DataType::DateTime)
    })
}

pub(super) fn death_metric(bd_seq: u8, time: Option<u64>) -> Metric {
    let value = MetricValue::Long(u64::from(bd_seq));
    let metric = Metric::new("bdSeq", 0, Some(value)).of_type(DataType::Int64);
    Metric {
        timestamp: time,
        ..metric
    }
}

/// The death of the node on the connection of this number, also as its will.
pub(in crate::northbound::sparkplug) fn death(topics: &Topics, bd_seq: u8) -> Message {
    Message {
        topic: topics.node("NDEATH"),
        payload: Payload::new(vec![death_metric(bd_seq, None)]).bytes(),
        is_retained: false,
        is_sure: true,
        correlation: None,
    }
}
