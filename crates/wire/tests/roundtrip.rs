//! Properties of the codecs: what is written is read back, in any pieces and with anything after
//! it; no bytes make them panic; and the ghost rule's `confusable` never says no where one frame
//! answers two requests.
//!
//! The two that matter most, reading back and telling apart, run over [`CASES`] cases per codec,
//! the others over a quarter; `PROPTEST_CASES` overrides [`CASES`].

#[path = "support/any.rs"]
mod any;

use any::Case;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use railbus_wire::*;

/// Cases per property and codec.
const CASES: u32 = 20_000;

fn config(share: u32) -> ProptestConfig {
    let cases = std::env::var("PROPTEST_CASES").ok();
    let cases = cases.and_then(|n| n.parse().ok()).unwrap_or(CASES);
    ProptestConfig {
        cases: cases / share,
        ..ProptestConfig::default()
    }
}

/// The properties of one codec, named after it.
macro_rules! codec {
    ($module:ident, $name:ident) => {
        mod $module {
            use super::*;

            proptest! {
                #![proptest_config(config(1))]

                #[test]
                fn what_is_written_is_read_back(
                    case in any::$name(),
                    trailing in prop::collection::vec(any::<u8>(), 0..12),
                ) {
                    round_trip(&case, &trailing)?;
                }

                #[test]
                fn no_reply_serves_two_requests_unless_confusable(
                    case in any::$name(),
                    other in any::$name(),
                ) {
                    told_apart(&case, &other)?;
                }
            }

            proptest! {
                #![proptest_config(config(4))]

                #[test]
                fn any_bytes_are_survived(
                    case in any::$name(),
                    bytes in prop::collection::vec(any::<u8>(), 0..48),
                    at in any::<prop::sample::Index>(),
                ) {
                    survive(&case, &bytes)?;
                    survive(&case, &damaged(case.request_bytes(), &bytes, at))?;
                    survive(&case, &damaged(case.reply_bytes(), &bytes, at))?;
                }

                #[test]
                fn a_reply_behind_a_glitch_is_found(
                    case in any::$name(),
                    glitch in prop::collection::vec(any::<u8>(), 0..8),
                ) {
                    behind_a_glitch(&case, &glitch)?;
                }

                #[test]
                fn a_command_is_seen_wherever_it_stands(
                    case in any::$name(),
                    before in prop::collection::vec(any::<u8>(), 0..6),
                    after in prop::collection::vec(any::<u8>(), 0..6),
                ) {
                    command_seen(&case, &before, &after)?;
                }
            }

            #[test]
            fn no_reply_of_a_thousand_serves_two_requests_unless_confusable() {
                every_pair_told_apart(any::$name());
            }
        }
    };
}

codec!(rtu_codec, rtu);
codec!(ascii_codec, ascii);
codec!(lc02_codec, lc02);
codec!(r55_codec, r55);

/// Encoded and decoded, whole and as every prefix, request and reply.
fn round_trip(case: &Case, trailing: &[u8]) -> Result<(), TestCaseError> {
    let exchange = case.exchange();
    let request = case.request_bytes();
    whole_and_pieces(&request, trailing, |rx| {
        case.decode_request(rx).map(|found| found == exchange)
    })?;
    if let Exchange::Rtu(exchange) = exchange {
        prop_assert_eq!(rtu::Exchange::decode_frame(&request), Ok(exchange));
    }

    let reply = case.reply_bytes();
    whole_and_pieces(&reply, trailing, |rx| {
        exchange
            .decode_response(rx)
            .map(|reply| reply.response == case.response())
    })?;
    length_known(case)?;
    match exchange.decode_response(&reply).whole().unwrap().from {
        Some(from) => prop_assert_eq!(from, case.from()),
        None => prop_assert_eq!(exchange.protocol(), Protocol::Ascii),
    }
    Ok(())
}

/// `response_len_max` is the length of a good reply, except for names, and 0 where no reply is
/// expected.
fn length_known(case: &Case) -> Result<(), TestCaseError> {
    use ascii::Response as Ascii;
    let (len, most) = (case.reply_bytes().len(), case.exchange().response_len_max());
    match case.response() {
        _ if !case.exchange().expects_reply() => prop_assert_eq!(most, 0),
        Response::Rtu(rtu::Response::Exception(_)) => prop_assert_ne!(most, 0),
        Response::Ascii(Ascii::Invalid | Ascii::Ignored) => prop_assert_ne!(most, 0),
        Response::Ascii(Ascii::Text(_)) | Response::Rtu(rtu::Response::Identification(_)) => {
            prop_assert!(len <= most);
        }
        _ => prop_assert_eq!(len, most),
    }
    Ok(())
}

/// `frame` is whole and right whatever follows it, and each prefix of it is partial and lacks no
/// more than what is still to come.
fn whole_and_pieces(
    frame: &[u8],
    trailing: &[u8],
    is_right: impl Fn(&[u8]) -> Decoded<bool>,
) -> Result<(), TestCaseError> {
    let len = frame.len();
    let right = Decoded::Whole { len, value: true };
    prop_assert_eq!(is_right(frame), right);
    prop_assert_eq!(is_right(&[frame, trailing].concat()), right);
    for end in 0..len {
        match is_right(&frame[..end]) {
            Decoded::Partial { more } => prop_assert!((1..=len - end).contains(&more)),
            other => prop_assert!(false, "{:02X?} is {:?}", &frame[..end], other),
        }
    }
    Ok(())
}

/// A frame with some bytes overwritten, from anywhere.
fn damaged(mut frame: Vec<u8>, damage: &[u8], at: prop::sample::Index) -> Vec<u8> {
    if !frame.is_empty() {
        let at = at.index(frame.len());
        let damage = damage.iter().take(3);
        for (byte, new) in frame[at..].iter_mut().zip(damage) {
            *byte = *new;
        }
    }
    frame
}

/// Nothing panics, and lengths stay within what was given.
fn survive(case: &Case, bytes: &[u8]) -> Result<(), TestCaseError> {
    let outcomes = [
        case.decode_request(bytes).map(drop),
        case.exchange().decode_response(bytes).map(drop),
    ];
    for outcome in outcomes {
        match outcome {
            Decoded::Whole { len, .. } => prop_assert!(0 < len && len <= bytes.len()),
            Decoded::Partial { more } => prop_assert!(more > 0),
            Decoded::Malformed(_) => {}
        }
    }
    let (skipped, _) = case.exchange().find_response(bytes);
    prop_assert!(skipped <= bytes.len());
    Ok(())
}

/// The reply is found behind a glitch exactly when no earlier place is, or could become, a
/// reply; dropping each place that only could leads to it.
fn behind_a_glitch(case: &Case, glitch: &[u8]) -> Result<(), TestCaseError> {
    let exchange = case.exchange();
    let rx = [glitch, &case.reply_bytes()].concat();
    let first = (0..rx.len())
        .find(|&skip| !matches!(exchange.decode_response(&rx[skip..]), Decoded::Malformed(_)));
    let (mut skipped, mut found) = exchange.find_response(&rx);
    prop_assert_eq!(Some(skipped), first);

    while let Decoded::Partial { .. } = found {
        prop_assert!(skipped < glitch.len(), "the reply itself is whole");
        let dropped = skipped + 1;
        let (more, next) = exchange.find_response(&rx[dropped..]);
        (skipped, found) = (dropped + more, next);
    }
    prop_assert_eq!(found, exchange.decode_response(&rx[skipped..]));
    prop_assert!(skipped <= glitch.len(), "the reply was passed over");
    Ok(())
}

/// The ghost rule rests on this: where any bytes answer both, `confusable` says so.
fn told_apart(one: &Case, other: &Case) -> Result<(), TestCaseError> {
    let (a, b) = (one.exchange(), other.exchange());
    prop_assert_eq!(a.confusable(&b), b.confusable(&a));
    prop_assert!(a.confusable(&a) || !a.expects_reply());
    for (reply, reader) in [(one.reply_bytes(), b), (other.reply_bytes(), a)] {
        if let Decoded::Whole { .. } = reader.decode_response(&reply) {
            prop_assert!(a.confusable(&b), "{:02X?} answers both", reply);
        }
    }
    Ok(())
}

/// The same for every pair of a thousand cases: a million readings, the same in every run.
fn every_pair_told_apart(cases: impl Strategy<Value = Case>) {
    let mut runner = TestRunner::deterministic();
    let mut draw = || cases.new_tree(&mut runner).unwrap().current();
    let drawn: Vec<(Case, Vec<u8>)> = (0..1_000)
        .map(|_| {
            let case = draw();
            let reply = case.reply_bytes();
            (case, reply)
        })
        .collect();
    let exchanges: Vec<Exchange<'_>> = drawn.iter().map(|(case, _)| case.exchange()).collect();
    for (asked, (_, reply)) in exchanges.iter().zip(&drawn) {
        for other in &exchanges {
            if let Decoded::Whole { .. } = other.decode_response(reply) {
                assert!(
                    asked.confusable(other),
                    "{reply:02X?}: {asked:?}, {other:?}"
                );
            }
        }
    }
}

/// Modules that parse at every byte see a command anywhere; a Modbus module only the whole frame.
fn command_seen(case: &Case, before: &[u8], after: &[u8]) -> Result<(), TestCaseError> {
    let protocol = case.exchange().protocol();
    let request = case.request_bytes();
    prop_assert!(carries_command(&request, protocol));
    let embedded = [before, &request, after].concat();
    let alone = embedded.len() == request.len();
    let seen = carries_command(&embedded, protocol);
    prop_assert!(seen || protocol == Protocol::Rtu && !alone);
    prop_assert!(!carries_command(&request[..request.len() - 1], protocol));
    Ok(())
}

#[test]
fn different_protocols_are_never_confusable() {
    let config = Exchange::lc02(Address(1), lc02::Request::ReadConfig);
    let name = Exchange::ascii(Address(1), false, ascii::Request::ReadName);
    let state = Exchange::r55(Address(1), r55::Request::ReadState);
    for (a, b) in [(config, name), (name, state), (state, config)] {
        assert!(!a.confusable(&b) && !b.confusable(&a));
    }
}

/// `confusable` must not always say yes either: requests to other modules must remain possible.
#[test]
fn requests_to_other_modules_mostly_remain_possible() {
    let reads = |address| {
        [
            Exchange::rtu(
                address,
                rtu::Request::ReadCoils(rtu::BitSpan::new(0, 8).unwrap()),
            ),
            Exchange::ascii(address, false, ascii::Request::ReadName),
            Exchange::ascii(address, true, ascii::Request::ReadConfig),
            Exchange::lc02(address, lc02::Request::ReadData),
            Exchange::r55(address, r55::Request::ReadState),
        ]
    };
    for (ghost, next) in reads(Address(1)).iter().zip(reads(Address(2))) {
        assert!(
            ghost.confusable(ghost) && !ghost.confusable(&next),
            "{ghost:?}"
        );
    }
    // A write of outputs is answered by a bare `>`: only another such write is in doubt.
    let write = |address| {
        let request = ascii::Request::WriteOutputs { order: 0, data: 0 };
        Exchange::ascii(address, false, request)
    };
    let ghost = write(Address(1));
    assert!(ghost.confusable(&write(Address(2))));
    let config = |address| Exchange::ascii(address, false, ascii::Request::ReadConfig);
    assert!(!ghost.confusable(&config(Address(2))));
    assert!(ghost.confusable(&config(Address(1))), "?01 refuses either");
}

proptest! {
    #![proptest_config(config(1))]

    #[test]
    fn lcus_is_read_back(channel in any::<u8>(), on in any::<bool>(), rest in any::<[u8; 3]>()) {
        let request = lcus::Request { channel, on };
        let mut frame = Frame::new();
        request.encode(&mut frame);
        whole_and_pieces(frame.bytes(), &rest, |rx| {
            lcus::Request::decode(rx).map(|found| found == request)
        })?;
    }

    #[test]
    fn lcus_survives_any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..8)) {
        if let Decoded::Whole { len, .. } = lcus::Request::decode(&bytes) {
            prop_assert!(len == 4 && bytes[0] == 0xA0);
        }
    }
}
