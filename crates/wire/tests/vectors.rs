//! Every frame of `vectors/*.json` against the codecs: decoded it says what its `fields` say,
//! the `fields` alone encode to its bytes, every single damaged bit is noticed where the frame
//! has a checksum, and what a datasheet misprints is refused.
//!
//! A vector is never changed to make a test pass: `vectors/README.md`.

#[path = "support/fields.rs"]
mod fields;

use railbus_wire::*;
use serde_json::Value;

/// A file of vectors, and how many it holds at least: none may vanish.
const FILES: [(Kind, &str, usize); 5] = [
    (Kind::Rtu, "rtu.json", 109),
    (Kind::Ascii, "ascii.json", 39),
    (Kind::Lc02, "lc02.json", 20),
    (Kind::R55, "r55.json", 102),
    (Kind::Lcus, "lcus.json", 2),
];

/// The protocol of a file's frames.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Rtu,
    Ascii,
    Lc02,
    R55,
    Lcus,
}

/// One vector.
struct Vector {
    kind: Kind,
    id: String,
    bytes: Vec<u8>,
    /// The right bytes of a misprint.
    corrected: Option<Vec<u8>>,
    /// The request that a reply answers.
    request: Option<Vec<u8>>,
    fields: Value,
}

impl Vector {
    fn parse(kind: Kind, vector: &Value) -> Vector {
        let bytes = |key: &str| vector[key].as_str().map(unhex);
        let text = |key: &str| vector[key].as_str().unwrap().to_owned();
        let vector = Vector {
            kind,
            id: text("id"),
            bytes: bytes("hex").unwrap(),
            corrected: bytes("corrected"),
            request: bytes("request"),
            fields: vector["fields"].clone(),
        };
        let answers = text_is(&vector.id, &text("direction"), "response", "request");
        assert_eq!(vector.request.is_some(), answers, "{}", vector.id);
        let misprint = text_is(&vector.id, &text("verdict"), "misprint", "ok");
        assert_eq!(vector.corrected.is_some(), misprint, "{}", vector.id);
        return vector;

        fn text_is(id: &str, text: &str, this: &str, other: &str) -> bool {
            assert!(text == this || text == other, "{id}: `{text}`");
            text == this
        }
    }

    /// The frame as it should be.
    fn right_bytes(&self) -> &[u8] {
        self.corrected.as_ref().unwrap_or(&self.bytes)
    }

    /// Whether frames carry a checksum: in ASCII that is a setting.
    fn has_checksum(&self) -> bool {
        self.kind != Kind::Ascii || self.fields["checksum"] == true
    }

    fn rules(&self) -> ascii::DecodeRules {
        ascii::DecodeRules {
            checksum: self.has_checksum(),
            lower_case: false,
        }
    }

    /// Reads bytes as this vector's request, or as the reply to its request.
    fn read(&self, rx: &[u8]) -> Decoded<Value> {
        let Some(request) = &self.request else {
            return match self.kind {
                Kind::Rtu => {
                    rtu::Exchange::decode_request(rx).map(|e| fields::rtu::show_request(&e))
                }
                Kind::Ascii => ascii::Exchange::decode_request(rx, self.rules())
                    .map(|e| fields::ascii::show_request(&e)),
                Kind::Lc02 => {
                    lc02::Exchange::decode_request(rx).map(|e| fields::lc02::show_request(&e))
                }
                Kind::R55 => {
                    r55::Exchange::decode_request(rx).map(|e| fields::r55::show_request(&e))
                }
                Kind::Lcus => lcus::Request::decode(rx).map(|r| fields::lcus::show(&r)),
            };
        };
        let exchange = self.exchange(request);
        exchange.decode_response(rx).map(|reply| {
            let from = reply.from;
            match (&exchange, reply.response) {
                (Exchange::Rtu(e), Response::Rtu(response)) => {
                    fields::rtu::show_response(e, Reply { from, response })
                }
                (Exchange::Ascii(e), Response::Ascii(response)) => {
                    fields::ascii::show_response(e, Reply { from, response })
                }
                (Exchange::Lc02(e), Response::Lc02(response)) => {
                    fields::lc02::show_response(e, Reply { from, response })
                }
                (Exchange::R55(e), Response::R55(response)) => {
                    fields::r55::show_response(e, Reply { from, response })
                }
                _ => panic!("{}: a reply in another protocol", self.id),
            }
        })
    }

    /// The exchange that a request frame opens.
    fn exchange<'a>(&self, request: &'a [u8]) -> Exchange<'a> {
        let found = match self.kind {
            Kind::Rtu => rtu::Exchange::decode_request(request).map(Exchange::Rtu),
            Kind::Ascii => {
                ascii::Exchange::decode_request(request, self.rules()).map(Exchange::Ascii)
            }
            Kind::Lc02 => lc02::Exchange::decode_request(request).map(Exchange::Lc02),
            Kind::R55 => r55::Exchange::decode_request(request).map(Exchange::R55),
            Kind::Lcus => panic!("LCUS boards do not answer"),
        };
        found
            .whole()
            .unwrap_or_else(|| panic!("{}: its request is none", self.id))
    }

    /// The frame that the fields alone make; a reply repeats parts of its request.
    fn write(&self) -> Vec<u8> {
        let fields = &self.fields;
        let packed = fields::rtu::packed(fields);
        let mut out = Frame::new();
        let Some(request) = &self.request else {
            match self.kind {
                Kind::Rtu => fields::rtu::build_request(fields, &packed).encode(&mut out),
                Kind::Ascii => fields::ascii::build_request(fields).encode(&mut out),
                Kind::Lc02 => fields::lc02::build_request(fields).encode(&mut out),
                Kind::R55 => fields::r55::build_request(fields).encode(&mut out),
                Kind::Lcus => fields::lcus::build(fields).encode(&mut out),
            }
            return out.bytes().to_vec();
        };
        let from = fields::sender(fields);
        match self.exchange(request) {
            Exchange::Rtu(e) => {
                let response = fields::rtu::build_response(fields, &packed);
                e.encode_response(from, &response, &mut out);
            }
            Exchange::Ascii(e) => {
                e.encode_response(from, &fields::ascii::build_response(fields), &mut out);
            }
            Exchange::Lc02(e) => {
                e.encode_response(from, fields::lc02::build_response(fields), &mut out);
            }
            Exchange::R55(e) => {
                e.encode_response(from, fields::r55::build_response(fields), &mut out);
            }
        }
        out.bytes().to_vec()
    }
}

/// The bytes of hexadecimal digits with blanks between.
fn unhex(text: &str) -> Vec<u8> {
    text.split_whitespace()
        .map(|byte| u8::from_str_radix(byte, 16).unwrap_or_else(|_| panic!("`{byte}` in {text}")))
        .collect()
}

/// All vectors of all files.
fn vectors() -> Vec<Vector> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../vectors");
    let mut all = Vec::new();
    for (kind, file, least) in FILES {
        let text = std::fs::read_to_string(format!("{folder}/{file}")).unwrap();
        let vectors: Vec<Value> = serde_json::from_str(&text).unwrap();
        assert!(
            vectors.len() >= least,
            "{file} has lost vectors: {}",
            vectors.len()
        );
        all.extend(vectors.iter().map(|vector| Vector::parse(kind, vector)));
    }
    all
}

#[test]
fn every_frame_is_read_as_its_fields_say() {
    for vector in vectors() {
        let bytes = vector.right_bytes();
        let whole = Decoded::Whole {
            len: bytes.len(),
            value: vector.fields.clone(),
        };
        assert_eq!(vector.read(bytes), whole, "{}", vector.id);
    }
}

#[test]
fn the_fields_alone_make_every_frame() {
    for vector in vectors() {
        assert_eq!(vector.write(), vector.right_bytes(), "{}", vector.id);
    }
}

#[test]
fn every_damaged_bit_is_noticed() {
    for vector in vectors().iter().filter(|vector| vector.has_checksum()) {
        let bytes = vector.right_bytes();
        for bit in 0..8 * bytes.len() {
            let mut damaged = bytes.to_vec();
            damaged[bit / 8] ^= 1 << (bit % 8);
            let read = vector.read(&damaged);
            assert!(
                !matches!(read, Decoded::Whole { .. }),
                "{}: {damaged:02X?}",
                vector.id
            );
        }
    }
}

/// What a datasheet misprints is refused, and for the reason that its vector gives. (Its
/// correction is read and written by the tests above.)
#[test]
fn every_misprint_is_refused() {
    let expected = [
        // The CRC is missing.
        ("9050-mb-fc10-r", Decoded::Partial { more: 2 }),
        // The delimiter is missing.
        ("9050-asc-082", Decoded::Malformed(Malformed::Start)),
        // Input byte and sum are those of another example.
        ("9060a-lc-read-r", Decoded::Malformed(Malformed::Checksum)),
    ];
    let vectors = vectors();
    let misprints = vectors.iter().filter(|vector| vector.corrected.is_some());
    let refused: Vec<(&str, Decoded<()>)> = misprints
        .map(|vector| (vector.id.as_str(), vector.read(&vector.bytes).map(drop)))
        .collect();
    assert_eq!(refused, expected);
}
