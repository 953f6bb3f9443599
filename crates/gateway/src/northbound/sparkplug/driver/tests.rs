//! The outlet as a broker has it, packet by packet.

use crate::northbound::sparkplug::payload::{MetricValue, Payload};
use crate::northbound::stage::{OutletStage, folder};
use std::sync::Arc;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};

/// A packet: its first byte, and what follows its length.
struct Packet {
    first: u8,
    body: Vec<u8>,
}

/// What is left of a packet.
struct Rest<'p>(&'p [u8]);

impl Rest<'_> {
    fn byte(&mut self) -> u8 {
        let (first, rest) = self.0.split_first().unwrap();
        self.0 = rest;
        *first
    }

    fn take(&mut self, len: usize) -> Vec<u8> {
        let (first, rest) = self.0.split_at(len);
        self.0 = rest;
        first.to_vec()
    }

    /// A text or data, with its length before it.
    fn bytes(&mut self) -> Vec<u8> {
        let len = [self.byte(), self.byte()];
        self.take(usize::from(u16::from_be_bytes(len)))
    }

    fn text(&mut self) -> String {
        String::from_utf8(self.bytes()).unwrap()
    }

    /// The properties of version 5; all that occur here are numbers (MQTT 5, section 2.2.2.2).
    fn properties(&mut self, is_five: bool) -> Vec<(u8, Vec<u8>)> {
        let len = if is_five { self.byte() } else { 0 };
        let its = self.take(usize::from(len));
        let mut its = Rest(&its);
        let mut found = Vec::new();
        while !its.0.is_empty() {
            let id = its.byte();
            let len = match id {
                0x01 | 0x17 | 0x19 => 1,
                0x21 | 0x22 => 2,
                0x02 | 0x11 | 0x18 | 0x27 => 4,
                other => panic!("property {other:#x}"),
            };
            found.push((id, its.take(len)));
        }
        found
    }
}

/// The next packet, other than what only keeps the connection alive.
async fn packet(stream: &mut TcpStream) -> Packet {
    loop {
        let first = stream.read_u8().await.unwrap();
        let (mut len, mut shift) = (0, 0);
        loop {
            let byte = stream.read_u8().await.unwrap();
            len |= usize::from(byte & 0x7f) << shift;
            shift += 7;
            if byte & 0x80 == 0 {
                break;
            }
        }
        let mut body = vec![0; len];
        stream.read_exact(&mut body).await.unwrap();
        match first {
            0xc0 => stream.write_all(&[0xd0, 0]).await.unwrap(),
            _ => return Packet { first, body },
        }
    }
}

/// Topic, number and payload of what is published.
fn publish(packet: &Packet, is_five: bool) -> (String, Vec<u8>, Vec<u8>) {
    let mut rest = Rest(&packet.body);
    let topic = rest.text();
    let number = rest.take(if packet.first & 6 == 0 { 0 } else { 2 });
    rest.properties(is_five);
    (topic, number, rest.0.to_vec())
}

#[tokio::test]
async fn a_connection_is_as_hosts_expect_it() {
    for version in ["5", "3.1.1"] {
        let is_five = version == "5";
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let text = format!(
            "[line.main]\nport = \"/dev/ttyS99\"\n[outlet.plant]\ntype = \"sparkplug\"\n\
             host = \"127.0.0.1\"\nport = {port}\ngroup = \"g\"\nnode = \"n\"\n\
             version = \"{version}\"\nprimary_host = \"scada\"\n"
        );
        let stage = OutletStage::running(folder(&format!("edge-{version}")), &text);
        let mut stream = listener.accept().await.unwrap().0;

        // Nothing of an earlier session, and a will with QoS 1 that is not retained.
        let connect = packet(&mut stream).await;
        assert_eq!(connect.first, 0x10);
        let mut rest = Rest(&connect.body);
        assert_eq!(rest.text(), "MQTT");
        assert_eq!(rest.take(2), [if is_five { 5 } else { 4 }, 0b0000_1110]);
        rest.take(2);
        let said = rest.properties(is_five);
        let is_kept = |(id, value): &(u8, Vec<u8>)| *id == 0x11 && *value != [0; 4];
        assert!(!said.iter().any(is_kept), "the session ends with it");
        rest.text();
        let said = rest.properties(is_five);
        let is_late = |(id, value): &(u8, Vec<u8>)| *id == 0x18 && *value != [0; 4];
        assert!(!said.iter().any(is_late), "the will comes at once");
        assert_eq!(rest.text(), "spBv1.0/g/NDEATH/n");
        let will = rest.bytes();
        let death = Payload::parse(&will).unwrap();
        assert_eq!((death.metrics.len(), death.seq), (1, None));
        assert_eq!(death.metrics[0].name.as_deref(), Some("bdSeq"));
        assert_eq!(death.metrics[0].value, Some(MetricValue::Long(0)));
        let accept: &[u8] = if is_five {
            &[0x20, 3, 0, 0, 0]
        } else {
            &[0x20, 2, 0, 0]
        };
        stream.write_all(accept).await.unwrap();

        // All of it with QoS 1, before the births.
        let subscribe = packet(&mut stream).await;
        assert_eq!(subscribe.first, 0x82);
        let mut rest = Rest(&subscribe.body);
        let number = rest.take(2);
        rest.properties(is_five);
        let mut topics = Vec::new();
        while !rest.0.is_empty() {
            topics.push(rest.text());
            assert_eq!(rest.byte() & 3, 1, "{topics:?}");
        }
        let expected = ["g/NCMD/n", "g/DCMD/n/+", "STATE/scada"];
        assert_eq!(topics, expected.map(|topic| format!("spBv1.0/{topic}")));
        let mut granted = number;
        granted.extend(if is_five { &[0][..] } else { &[] });
        granted.extend([1; 3]);
        let mut answer = vec![0x90, u8::try_from(granted.len()).unwrap()];
        answer.extend(granted);
        let mut state = b"\x00\x13spBv1.0/STATE/scada".to_vec();
        state.extend(if is_five { &[0][..] } else { &[] });
        state.extend(b"{\"online\":true,\"timestamp\":5}");
        answer.extend([0x31, u8::try_from(state.len()).unwrap()]);
        answer.extend(state);
        stream.write_all(&answer).await.unwrap();

        // QoS 0, not retained, and the number of the will.
        let birth = packet(&mut stream).await;
        assert_eq!(birth.first, 0x30);
        let (topic, _, payload) = publish(&birth, is_five);
        assert_eq!(topic, "spBv1.0/g/NBIRTH/n");
        let payload = Payload::parse(&payload).unwrap();
        let its = payload.metrics.iter();
        let mut its = its.filter(|metric| metric.name == death.metrics[0].name);
        let number = its.next().map(|metric| metric.value.clone());
        assert_eq!(number, Some(death.metrics[0].value.clone()));

        // Its own death before it goes, and the will as well where that can be said.
        let northbound = Arc::clone(&stage.northbound);
        let end = tokio::spawn(async move { northbound.close().await });
        let last = loop {
            let last = packet(&mut stream).await;
            if last.first != 0xa2 {
                break last;
            }
        };
        assert_eq!(last.first, 0x32);
        let (topic, number, payload) = publish(&last, is_five);
        assert_eq!((&*topic, payload), ("spBv1.0/g/NDEATH/n", will));
        stream
            .write_all(&[0x40, 2, number[0], number[1]])
            .await
            .unwrap();
        let disconnect = packet(&mut stream).await;
        assert_eq!(disconnect.first, 0xe0);
        let reason = disconnect.body.first().copied();
        assert_eq!(reason, is_five.then_some(0x04));
        end.await.unwrap();
    }
}
