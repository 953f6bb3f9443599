//! Payloads of Sparkplug B: the parts of its protobuf that an edge node of this kind has, by hand.
//! What else is in a message is skipped, as protobuf has it.
//!
//! The numbers are those of the Sparkplug specification 3.0, chapter 6.4.1.

use prost::Message as _;

/// A payload.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Payload {
    /// When it was sent, in milliseconds since 1970.
    #[prost(uint64, optional, tag = "1")]
    pub(super) timestamp: Option<u64>,
    #[prost(message, repeated, tag = "2")]
    pub(super) metrics: Vec<Metric>,
    /// 0 to 255, one more than that of the node's message before.
    #[prost(uint64, optional, tag = "3")]
    pub(super) seq: Option<u64>,
}

/// A metric: its name, and what it is now.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Metric {
    #[prost(string, optional, tag = "1")]
    pub(super) name: Option<String>,
    /// Since when it is so, in milliseconds since 1970.
    #[prost(uint64, optional, tag = "3")]
    pub(super) timestamp: Option<u64>,
    /// A [`DataType`]; only births have it.
    #[prost(uint32, optional, tag = "4")]
    pub(super) datatype: Option<u32>,
    /// It was so, and is not said to be so now.
    #[prost(bool, optional, tag = "5")]
    pub(super) is_historical: Option<bool>,
    #[prost(bool, optional, tag = "7")]
    pub(super) is_null: Option<bool>,
    #[prost(message, optional, tag = "9")]
    pub(super) properties: Option<PropertySet>,
    #[prost(oneof = "MetricValue", tags = "10, 11, 12, 13, 14, 15")]
    pub(super) value: Option<MetricValue>,
}

/// The value of a metric.
#[derive(Clone, PartialEq, prost::Oneof)]
pub(super) enum MetricValue {
    #[prost(uint32, tag = "10")]
    Int(u32),
    /// Signed numbers in two's complement.
    #[prost(uint64, tag = "11")]
    Long(u64),
    #[prost(float, tag = "12")]
    Float(f32),
    #[prost(double, tag = "13")]
    Double(f64),
    #[prost(bool, tag = "14")]
    Boolean(bool),
    #[prost(string, tag = "15")]
    Text(String),
}

/// What else is said of a metric: as many values as keys.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct PropertySet {
    #[prost(string, repeated, tag = "1")]
    pub(super) keys: Vec<String>,
    #[prost(message, repeated, tag = "2")]
    pub(super) values: Vec<PropertyValue>,
}

/// The value of a property.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct PropertyValue {
    #[prost(uint32, optional, tag = "1")]
    pub(super) datatype: Option<u32>,
    #[prost(oneof = "PropertyKind", tags = "3, 7, 8")]
    pub(super) value: Option<PropertyKind>,
}

/// What a property can be here.
#[derive(Clone, PartialEq, prost::Oneof)]
pub(super) enum PropertyKind {
    #[prost(uint32, tag = "3")]
    Int(u32),
    #[prost(bool, tag = "7")]
    Boolean(bool),
    #[prost(string, tag = "8")]
    Text(String),
}

/// The types of metrics and properties that are used here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DataType {
    Int32 = 3,
    Int64 = 4,
    Double = 10,
    Boolean = 11,
    Text = 12,
    DateTime = 13,
}

impl Metric {
    /// A metric of this name, which is so since this time; null without a value.
    pub(super) fn new(name: &str, timestamp: u64, value: Option<MetricValue>) -> Metric {
        Metric {
            name: Some(name.to_owned()),
            timestamp: Some(timestamp),
            is_null: value.is_none().then_some(true),
            value,
            ..Metric::default()
        }
    }

    /// The same in a birth, where its type is told.
    pub(super) fn of_type(self, datatype: DataType) -> Metric {
        Metric {
            datatype: Some(datatype as u32),
            ..self
        }
    }

    /// The same with another property.
    pub(super) fn with(mut self, key: &str, datatype: DataType, value: PropertyKind) -> Metric {
        let set = self.properties.get_or_insert_default();
        set.keys.push(key.to_owned());
        set.values.push(PropertyValue {
            datatype: Some(datatype as u32),
            value: Some(value),
        });
        self
    }
}

impl Payload {
    /// One with these metrics, in the order of their times, as receivers are promised
    /// (`tck-id-operational-behavior-data-publish-dbirth-order`).
    pub(super) fn new(mut metrics: Vec<Metric>) -> Payload {
        metrics.sort_by_key(|metric| metric.timestamp);
        Payload {
            metrics,
            ..Payload::default()
        }
    }

    /// As bytes.
    pub(super) fn bytes(&self) -> Vec<u8> {
        self.encode_to_vec()
    }

    /// Of bytes.
    ///
    /// # Errors
    /// They are no payload.
    pub(super) fn parse(bytes: &[u8]) -> Result<Payload, String> {
        Payload::decode(bytes).map_err(|error| error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Field by field, as the specification numbers them: key bytes are `number << 3 | wire type`.
    #[test]
    fn a_payload_is_laid_out_as_specified() {
        let metric = Metric::new("k1", 2, Some(MetricValue::Boolean(true)));
        let metric = metric.of_type(DataType::Boolean).with(
            "Quality",
            DataType::Int32,
            PropertyKind::Int(500),
        );
        let payload = Payload {
            timestamp: Some(1),
            seq: Some(0),
            ..Payload::new(vec![metric])
        };
        let properties = b"\x0a\x07Quality\x12\x05\x08\x03\x18\xf4\x03";
        let mut metric = b"\x0a\x02k1\x18\x02\x20\x0b\x4a\x10".to_vec();
        metric.extend(properties);
        metric.extend(b"\x70\x01");
        let mut expected = vec![0x08, 1, 0x12, u8::try_from(metric.len()).unwrap()];
        expected.extend(metric);
        // A sequence number of zero is written, too.
        expected.extend(b"\x18\x00");
        assert_eq!(payload.bytes(), expected);
        assert_eq!(Payload::parse(&expected), Ok(payload));
    }

    #[test]
    fn false_is_a_value_and_null_is_none() {
        let of = |value| Payload::new(vec![Metric::new("a", 0, value)]).bytes();
        assert!(of(Some(MetricValue::Boolean(false))).ends_with(b"\x70\x00"));
        assert!(of(None).ends_with(b"\x38\x01"));
    }

    #[test]
    fn metrics_stand_in_the_order_of_their_times() {
        let metrics = [("b", 7), ("a", 9), ("c", 7)].map(|(name, at)| Metric::new(name, at, None));
        let payload = Payload::new(metrics.to_vec());
        let names = payload.metrics.iter().map(|metric| metric.name.as_deref());
        assert!(names.eq([Some("b"), Some("c"), Some("a")]));
    }

    #[test]
    fn what_else_is_in_a_message_is_skipped() {
        // A `uuid`, and a metric with an alias and metadata.
        let bytes = b"\x22\x01x\x12\x09\x0a\x01a\x10\x05\x42\x02\x08\x01";
        let payload = Payload::parse(bytes).unwrap();
        assert_eq!(payload.metrics.len(), 1);
        assert_eq!(payload.metrics[0].name.as_deref(), Some("a"));
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_payload_or_an_error(
            bytes in prop::collection::vec(any::<u8>(), 0..256),
        ) {
            if let Ok(payload) = Payload::parse(&bytes) {
                prop_assert_eq!(Payload::parse(&payload.bytes()).unwrap().seq, payload.seq);
            }
        }
    }
}
