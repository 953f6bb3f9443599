//! What the codecs refuse, and why: one row for every check, so that removing a check fails a row
//! here. What they accept is in `vectors.rs` and `roundtrip.rs`.

use Malformed as M;
use railbus_wire::*;

/// Appends the CRC of Modbus.
fn crc(bytes: &[u8]) -> Vec<u8> {
    [bytes, &crc16(bytes).to_le_bytes()].concat()
}

/// Appends the sum of a 0x55 or LCUS frame.
fn sum(bytes: &[u8]) -> Vec<u8> {
    [bytes, &[sum8(bytes)]].concat()
}

/// Appends sum and end byte of an LC-02 frame.
fn lc(bytes: &[u8]) -> Vec<u8> {
    [bytes, &[sum8(&bytes[2..]), 0x0D]].concat()
}

/// Asserts that the bytes are refused for this reason.
#[track_caller]
fn refused<T: std::fmt::Debug>(rx: &[u8], read: Decoded<T>, why: Malformed) {
    match read {
        Decoded::Malformed(reason) if reason == why => {}
        other => panic!("{rx:02X?}: {other:?} instead of {why:?}"),
    }
}

/// Asserts that the bytes are whole.
#[track_caller]
fn taken<T: std::fmt::Debug>(rx: &[u8], read: Decoded<T>) {
    match read {
        Decoded::Whole { len, .. } if len == rx.len() => {}
        other => panic!("{rx:02X?}: {other:?}"),
    }
}

mod rtu_frames {
    use super::*;
    use railbus_wire::rtu::{
        BitSpan, CoilValue, Exception, Exchange, Function, Request, RequestError, WordSpan,
    };

    fn ask(address: u8, request: Request<'_>) -> Exchange<'_> {
        Exchange {
            address: Address(address),
            request,
        }
    }

    fn coils(count: u16) -> Request<'static> {
        Request::ReadCoils(BitSpan::new(0, count).unwrap())
    }

    #[test]
    fn replies() {
        let read = ask(1, coils(9));
        let write = ask(
            1,
            Request::WriteCoil {
                at: 3,
                value: CoilValue::ON,
            },
        );
        taken(
            &crc(&[1, 1, 2, 0xFF, 1]),
            read.decode_response(&crc(&[1, 1, 2, 0xFF, 1])),
        );
        let rows: [(&Exchange<'_>, Vec<u8>, Malformed); 15] = [
            // [MODBUS §1.12]: address and function of the request.
            (&read, vec![2], M::Address),
            (&read, crc(&[2, 1, 2, 0, 0]), M::Address),
            (&read, crc(&[0, 1, 2, 0, 0]), M::Address),
            (&read, crc(&[1, 2, 2, 0, 0]), M::Function),
            (&read, crc(&[1, 0x82, 2]), M::Function),
            // [MODBUS §2.1]: as many bytes as asked for.
            (&read, vec![1, 1, 1], M::Length),
            (&read, crc(&[1, 1, 1, 0]), M::Length),
            (&read, crc(&[1, 1, 3, 0, 0, 0]), M::Length),
            // [MODBUS §1.7]: the CRC, here on a good, a refused and a written value.
            (&read, vec![1, 1, 2, 0xFF, 1, 0, 0], M::Checksum),
            (&read, vec![1, 0x81, 2, 0, 0], M::Checksum),
            (&write, vec![1, 5, 0, 3, 0xFF, 0, 0, 0], M::Checksum),
            // [MODBUS §2.3]: a write is answered by its echo.
            (&write, crc(&[1, 5, 1, 3, 0xFF, 0]), M::Echo),
            (&write, crc(&[1, 5, 0, 4, 0xFF, 0]), M::Echo),
            (&write, crc(&[1, 5, 0, 3, 0, 0]), M::Echo),
            (&write, crc(&[1, 5, 0, 3, 0xFF, 1]), M::Echo),
        ];
        for (exchange, rx, why) in rows {
            refused(&rx, exchange.decode_response(&rx), why);
        }
    }

    /// [MODBUS §2.6, §2.7]: exceptions are no values, whatever their code.
    #[test]
    fn exceptions_are_never_successes() {
        let read = ask(1, coils(9));
        for code in 0..=255 {
            let rx = crc(&[1, 0x81, code]);
            let found = read.decode_response(&rx).whole().unwrap();
            assert_eq!(found.response, rtu::Response::Exception(Exception(code)));
            assert_eq!(read.decode_bare_exception(&rx[..3]), Some(Exception(code)));
        }
        for rx in [
            &[2, 0x81, 2][..],
            &[1, 0x82, 2],
            &[1, 1, 2],
            &[1, 0x81],
            &[1, 0x81, 2, 0],
        ] {
            assert_eq!(read.decode_bare_exception(rx), None);
        }
    }

    /// [MODBUS §2.5]
    #[test]
    fn coil_values() {
        for on in [false, true] {
            assert_eq!(CoilValue::from(on).state(), Some(on));
        }
        assert_eq!(CoilValue::from(true), CoilValue(0xFF00));
        assert_eq!(CoilValue(0x5500).state(), None);
    }

    /// A read sent to address 0 is answered under the module's own address.
    #[test]
    fn anyone_answers_a_read_to_address_0() {
        let rx = crc(&[7, 1, 2, 0xFF, 1]);
        let found = ask(0, coils(9)).decode_response(&rx).whole().unwrap();
        assert_eq!(found.from, Some(Address(7)));
        assert!(ask(0, coils(9)).expects_reply());
        let write = Request::WriteRegister { at: 0, value: 0 };
        assert!(!ask(0, write).expects_reply() && ask(1, write).expects_reply());
    }

    /// [MODBUS §1.7, §3.5]: what a module answers to a frame that it cannot carry out.
    #[test]
    fn requests() {
        let address = Address(1);
        let unknown = |code| RequestError::Function { address, code };
        let quantity = |function| RequestError::Quantity { address, function };
        let range = |function| RequestError::Range { address, function };
        let zeros = |start: &[u8], data: usize| crc(&[start, &vec![0; data]].concat());
        let rows = [
            (vec![], RequestError::Garbled),
            (crc(&[1]), RequestError::Garbled),
            (vec![1, 1, 0, 0, 0, 1, 0, 0], RequestError::Garbled),
            (zeros(&[1, 0x0F], 253), RequestError::Garbled),
            (crc(&[1, 7]), unknown(7)),
            (crc(&[1, 0x81, 0, 0, 0, 1]), unknown(0x81)),
            (crc(&[1, 1]), quantity(Function::ReadCoils)),
            (crc(&[1, 1, 0, 0, 0]), quantity(Function::ReadCoils)),
            (crc(&[1, 1, 0, 0, 0, 1, 0]), quantity(Function::ReadCoils)),
            (crc(&[1, 1, 0, 0, 0, 0]), quantity(Function::ReadCoils)),
            (
                crc(&[1, 1, 0, 0, 0x07, 0xD1]),
                quantity(Function::ReadCoils),
            ),
            (
                crc(&[1, 2, 0, 0, 0x07, 0xD1]),
                quantity(Function::ReadDiscreteInputs),
            ),
            (
                crc(&[1, 3, 0, 0, 0, 126]),
                quantity(Function::ReadHoldingRegisters),
            ),
            (
                crc(&[1, 4, 0, 0, 0, 126]),
                quantity(Function::ReadInputRegisters),
            ),
            (crc(&[1, 1, 0xFF, 0xFF, 0, 2]), range(Function::ReadCoils)),
            (
                crc(&[1, 2, 0xFF, 0xFF, 0, 2]),
                range(Function::ReadDiscreteInputs),
            ),
            (
                crc(&[1, 3, 0xFF, 0xFF, 0, 2]),
                range(Function::ReadHoldingRegisters),
            ),
            (
                crc(&[1, 4, 0xFF, 0xFF, 0, 2]),
                range(Function::ReadInputRegisters),
            ),
            // Both wrong: the quantity comes first.
            (
                crc(&[1, 1, 0xFF, 0xFF, 0xFF, 0xFF]),
                quantity(Function::ReadCoils),
            ),
            // Byte counts that disagree with the count, and with the length.
            (
                crc(&[1, 0x0F, 0, 0, 0, 9, 1, 0]),
                quantity(Function::WriteCoils),
            ),
            (
                crc(&[1, 0x0F, 0, 0, 0, 8, 2, 0, 0]),
                quantity(Function::WriteCoils),
            ),
            (
                crc(&[1, 0x0F, 0, 0, 0, 8, 2, 0]),
                quantity(Function::WriteCoils),
            ),
            (
                crc(&[1, 0x0F, 0, 0, 0, 0, 0]),
                quantity(Function::WriteCoils),
            ),
            (
                crc(&[1, 0x10, 0, 0, 0, 1, 4, 0, 0, 0, 0]),
                quantity(Function::WriteRegisters),
            ),
            (
                crc(&[1, 0x10, 0, 0, 0, 1, 1, 0]),
                quantity(Function::WriteRegisters),
            ),
            (
                crc(&[1, 0x10, 0, 0, 0, 1, 3, 0, 0, 0]),
                quantity(Function::WriteRegisters),
            ),
            // 1969 coils and 124 registers.
            (
                zeros(&[1, 0x0F, 0, 0, 0x07, 0xB1, 247], 247),
                quantity(Function::WriteCoils),
            ),
            (
                crc(&[1, 0x0F, 0xFF, 0xFF, 0, 2, 1, 0]),
                range(Function::WriteCoils),
            ),
            (
                crc(&[1, 0x10, 0xFF, 0xFF, 0, 2, 4, 0, 0, 0, 0]),
                range(Function::WriteRegisters),
            ),
        ];
        for (frame, why) in rows {
            assert_eq!(Exchange::decode_frame(&frame), Err(why), "{frame:02X?}");
        }
    }

    /// The largest requests that fit [MODBUS §3.1, §3.2, §3.3, §3.4].
    #[test]
    fn the_last_that_fits() {
        let zeros = |start: &[u8], data: usize| crc(&[start, &vec![0; data]].concat());
        let rows = [
            crc(&[1, 1, 0, 0, 0x07, 0xD0]),
            crc(&[1, 1, 0xFF, 0xFF, 0, 1]),
            crc(&[1, 3, 0, 0, 0, 125]),
            crc(&[1, 3, 0xFF, 0x83, 0, 125]),
            zeros(&[1, 0x0F, 0, 0, 0x07, 0xB0, 246], 246),
            zeros(&[1, 0x10, 0, 0, 0, 123, 246], 246),
        ];
        for frame in rows {
            assert!(Exchange::decode_frame(&frame).is_ok(), "{frame:02X?}");
            taken(&frame, Exchange::decode_request(&frame));
        }
        assert!(BitSpan::new(0, 0).is_none() && WordSpan::new(0, 126).is_none());
    }

    /// The same without silences to delimit the frame.
    #[test]
    fn requests_in_a_stream() {
        let rows = [
            (crc(&[1, 7, 0, 0]), M::Function),
            (vec![1, 1, 0, 0, 0, 1, 0, 0], M::Checksum),
            (crc(&[1, 1, 0, 0, 0, 0]), M::Length),
            (crc(&[1, 1, 0xFF, 0xFF, 0, 2]), M::Value),
            // No frame is so long.
            (vec![1, 0x10, 0, 0, 0, 124, 248], M::Length),
        ];
        for (rx, why) in rows {
            refused(&rx, Exchange::decode_request(&rx), why);
        }
    }

    #[test]
    fn exceptions_of_errors() {
        let (address, function) = (Address(1), Function::WriteCoils);
        let answer = |code, why| Some((address, code, why));
        let rows = [
            (RequestError::Garbled, None),
            (
                RequestError::Function { address, code: 7 },
                answer(7, Exception::FUNCTION),
            ),
            (
                RequestError::Quantity { address, function },
                answer(0x0F, Exception::VALUE),
            ),
            (
                RequestError::Range { address, function },
                answer(0x0F, Exception::ADDRESS),
            ),
        ];
        for (error, expected) in rows {
            assert_eq!(error.exception(), expected);
        }
    }
}

mod ascii_frames {
    use super::*;
    use railbus_wire::ascii::{DecodeRules, Exchange, Request, Response, Text};

    const WRITE: Request = Request::WriteOutputs { order: 0, data: 5 };

    fn ask(checksum: bool, request: Request) -> Exchange {
        Exchange {
            address: Address(0x1A),
            checksum,
            request,
        }
    }

    #[test]
    fn replies() {
        let moved = Request::WriteConfig {
            new_address: Address(0x1B),
            type_code: 0x40,
            baud_code: 6,
            format: 0,
        };
        let rows: [(bool, Request, &str, Malformed); 33] = [
            // First characters.
            (false, Request::ReadData, ">112200\r", M::Start),
            (false, Request::ReadData, "$", M::Start),
            (false, Request::ReadData, "\r", M::Length),
            (false, WRITE, "!1A\r", M::Start),
            (false, Request::SampleAll, ">\r", M::Start),
            // Addresses, as soon as they are there.
            (false, Request::ReadConfig, "!1B", M::Address),
            (false, Request::ReadConfig, "!1B400600\r", M::Address),
            (false, Request::ReadConfig, "!1G", M::Syntax),
            (false, Request::ReadConfig, "?1B\r", M::Address),
            (false, moved, "!1C\r", M::Address),
            // Lengths.
            (false, Request::ReadConfig, "!1A40060\r", M::Length),
            (false, Request::ReadConfig, "!1A4006000\r", M::Length),
            (false, Request::ReadConfig, "!1A40060000", M::End),
            (false, Request::ReadConfig, "!1\r", M::Length),
            (false, Request::ReadConfig, "?1A0\r", M::Length),
            (false, Request::ReadConfig, "?\r", M::Length),
            (false, WRITE, ">0\r", M::Length),
            (false, WRITE, ">00", M::End),
            (
                false,
                Request::ReadName,
                "!1A01234567890123456\r",
                M::Syntax,
            ),
            (false, Request::ReadName, "!1A\r", M::Syntax),
            (false, Request::ReadName, "!1A90\x0760\r", M::Syntax),
            // Digits, constants and ranges.
            (false, Request::ReadData, "!1122G0\r", M::Syntax),
            (false, Request::ReadData, "!G12200\r", M::Syntax),
            (false, Request::ReadData, "!112201\r", M::Syntax),
            (false, Request::ReadData, "!112210\r", M::Syntax),
            (false, Request::ReadLatched, "!2112200\r", M::Value),
            (false, Request::ReadPulse, "!1A0000\r", M::Value),
            (false, Request::ReadPulse, "!1A00C9\r", M::Value),
            (false, Request::ReadReset, "!1A2\r", M::Value),
            // Checksums [EDA §2.5]: missing, wrong, in lower case.
            (true, Request::ReadData, "!112200\r", M::Checksum),
            (true, Request::ReadData, "!11220048\r", M::Checksum),
            (true, WRITE, ">3e\r", M::Checksum),
            (true, WRITE, "\r", M::Checksum),
        ];
        for (checksum, request, rx, why) in rows {
            let rx = rx.as_bytes();
            refused(rx, ask(checksum, request).decode_response(rx), why);
        }
        for rx in ["!1A\r", "!1B\r", "?1B\r"] {
            taken(
                rx.as_bytes(),
                ask(false, moved).decode_response(rx.as_bytes()),
            );
        }
    }

    /// A bare `?` or `!` is an answer to a write of outputs only.
    #[test]
    fn bare_replies() {
        for (rx, response) in [("?\r", Response::Invalid), ("!\r", Response::Ignored)] {
            let read = ask(false, WRITE).decode_response(rx.as_bytes());
            let reply = Reply {
                from: None,
                response,
            };
            assert_eq!(
                read,
                Decoded::Whole {
                    len: 2,
                    value: reply
                }
            );
            let other = ask(false, Request::ReadPulse).decode_response(rx.as_bytes());
            refused(rx.as_bytes(), other, M::Length);
        }
    }

    /// Replies are read in either case [EDA §2.3].
    #[test]
    fn digits_of_replies_may_be_of_either_case() {
        for (rx, outputs) in [
            ("!ab2200\r", 0xAB),
            ("!Ab2200\r", 0xAB),
            ("!aB2200\r", 0xAB),
        ] {
            let read = ask(false, Request::ReadData).decode_response(rx.as_bytes());
            let response = Response::Data {
                outputs,
                inputs: 0x22,
            };
            assert_eq!(
                read.whole(),
                Some(Reply {
                    from: None,
                    response
                })
            );
        }
    }

    #[test]
    fn requests() {
        let rows = [
            (false, "!016\r", M::Start),
            (false, "\r", M::Start),
            (false, "$0\r", M::Length),
            (false, "$G16\r", M::Syntax),
            (false, "$GG6\r", M::Syntax),
            (false, "$016 \r", M::Function),
            (false, "$017\r", M::Function),
            (false, "$01m\r", M::Function),
            (false, "$**\r", M::Function),
            (false, "#**1\r", M::Function),
            // [EDA §2.8]: lower case.
            (false, "$1a6\r", M::Syntax),
            (false, "$ab6\r", M::Syntax),
            (false, "%0102400a00\r", M::Syntax),
            (false, "~1aOname\r", M::Syntax),
            (false, "%01024006\r", M::Function),
            (false, "#0100G5\r", M::Syntax),
            (false, "#01400C9\r", M::Value),
            (false, "#0140000\r", M::Value),
            (false, "~013205\r", M::Value),
            (false, "~01O\r", M::Syntax),
            // [EDA §2.7, §2.30]: checksums that are missing, wrong, or unasked for.
            (true, "$016\r", M::Checksum),
            (true, "$016BC\r", M::Checksum),
            (true, "$016bb\r", M::Checksum),
            (true, "\r", M::Start),
            (true, "$\r", M::Checksum),
            (false, "$016BB\r", M::Function),
        ];
        for (checksum, rx, why) in rows {
            let rules = DecodeRules {
                checksum,
                lower_case: false,
            };
            refused(
                rx.as_bytes(),
                Exchange::decode_request(rx.as_bytes(), rules),
                why,
            );
        }
    }

    /// The switch of [EDA §2.8] takes lower case, in the checksum too.
    #[test]
    fn lower_case_requests() {
        let rules = |checksum| DecodeRules {
            checksum,
            lower_case: true,
        };
        for (checksum, rx) in [(false, "$1a6\r"), (true, "$016bb\r"), (true, "$016BB\r")] {
            taken(
                rx.as_bytes(),
                Exchange::decode_request(rx.as_bytes(), rules(checksum)),
            );
        }
    }

    /// [EDA §2.9]: 32 characters and the CR are the most.
    #[test]
    fn endless_frames() {
        let rules = DecodeRules {
            checksum: false,
            lower_case: false,
        };
        let endless = [b'$'; 40];
        assert_eq!(
            Exchange::decode_request(&endless[..32], rules),
            Decoded::Partial { more: 1 }
        );
        refused(
            &endless,
            Exchange::decode_request(&endless[..33], rules),
            M::End,
        );
        let mut name = b"!1A".to_vec();
        name.resize(20, b'x');
        refused(
            &name,
            ask(false, Request::ReadName).decode_response(&name),
            M::End,
        );
    }

    #[test]
    fn names() {
        assert!(Text::new(b"").is_none() && Text::new(&[b'x'; 17]).is_none());
        assert!(Text::new(b"a\x7F").is_none() && Text::new(b"\x1Fa").is_none());
        assert_eq!(Text::new(b" ~").unwrap().as_str(), " ~");
    }
}

mod lc02_frames {
    use super::*;
    use railbus_wire::lc02::{Exchange, Request};

    #[test]
    fn replies() {
        let ask = |request| Exchange {
            address: Address(1),
            request,
        };
        let (read, pulse) = (ask(Request::ReadData), ask(Request::ReadPulse));
        let moved = ask(Request::WriteConfig {
            new_address: Address(2),
            baud_code: 6,
        });
        // [EDA §3.2, §3.3, §3.17]
        let rows: [(&Exchange, Vec<u8>, Malformed); 12] = [
            (&read, vec![0x4C], M::Start),
            (&read, vec![0x6C, 0x64], M::Start),
            (&read, lc(&[0x4C, 0x57, 1, 0, 0]), M::Start),
            (&read, vec![0x6C, 0x63, 2], M::Address),
            (&read, lc(&[0x6C, 0x63, 2, 0, 0]), M::Address),
            (&read, vec![0x6C, 0x63, 1, 3, 2, 7, 0x0D], M::Checksum),
            (&read, vec![0x6C, 0x63, 1, 3, 2, 6, 0x0A], M::End),
            // A longer and a shorter reply have their end elsewhere.
            (&read, lc(&[0x6C, 0x63, 1, 6, 0x90, 0x60, 0]), M::End),
            (&moved, lc(&[0x6C, 0x63, 1, 3, 2]), M::End),
            (&moved, lc(&[0x6C, 0x63, 3]), M::Address),
            (&pulse, lc(&[0x6C, 0x63, 1, 0, 0]), M::Value),
            (&pulse, lc(&[0x6C, 0x63, 1, 0, 201]), M::Value),
        ];
        for (exchange, rx, why) in rows {
            refused(&rx, exchange.decode_response(&rx), why);
        }
        for rx in [lc(&[0x6C, 0x63, 1]), lc(&[0x6C, 0x63, 2])] {
            taken(&rx, moved.decode_response(&rx));
        }
    }

    #[test]
    fn requests() {
        // [EDA §3.5, §3.10, §3.12, §3.13, §3.15]
        let rows = [
            (vec![0x4D], M::Start),
            (lc(&[0x6C, 0x63, 1, 3]), M::Start),
            (vec![0x4C, 0x57, 1, 7], M::Function),
            (vec![0x4C, 0x57, 1, 0], M::Function),
            (vec![0x4C, 0x57, 1, 3, 5, 0x0D], M::Checksum),
            (vec![0x4C, 0x57, 1, 3, 4, 0x0A], M::End),
            (lc(&[0x4C, 0x57, 1, 2, 2, 6, 1]), M::Value),
            (lc(&[0x4C, 0x57, 1, 4, 8, 1]), M::Value),
            (lc(&[0x4C, 0x57, 1, 4, 0xFE, 1]), M::Value),
            (lc(&[0x4C, 0x57, 1, 4, 0, 2]), M::Value),
            (lc(&[0x4C, 0x57, 1, 5, 0, 0]), M::Value),
            (lc(&[0x4C, 0x57, 1, 5, 0, 201]), M::Value),
        ];
        for (rx, why) in rows {
            refused(&rx, Exchange::decode_request(&rx), why);
        }
        for rx in [
            lc(&[0x4C, 0x57, 1, 4, 7, 1]),
            lc(&[0x4C, 0x57, 1, 5, 0, 200]),
        ] {
            taken(&rx, Exchange::decode_request(&rx));
        }
    }
}

mod r55_frames {
    use super::*;
    use railbus_wire::r55::{BROADCAST, Exchange, Request, U24};

    #[test]
    fn replies() {
        let read = Exchange::new(Address(1), Request::ReadState);
        // [R55 §1.2, §1.3]
        let rows = [
            (vec![0x55], M::Start),
            (sum(&[0x55, 1, 0x10, 0, 0, 0, 0]), M::Start),
            (vec![0x22, 2], M::Address),
            (sum(&[0x22, 2, 0x10, 0, 0, 0, 0]), M::Address),
            (vec![0x22, 1, 0x11], M::Function),
            (sum(&[0x22, 1, 0x11, 0, 0, 0, 0]), M::Function),
            (vec![0x22, 1, 0x10, 0, 0, 0, 0, 0], M::Checksum),
        ];
        for (rx, why) in rows {
            refused(&rx, read.decode_response(&rx), why);
        }
        // Only the address read is answered by any board that receives it [R55 §4.3].
        let everyone = Exchange::new(BROADCAST, Request::ReadAddress);
        let rx = sum(&[0x22, 7, 0x40, 0, 0, 0, 7]);
        taken(&rx, everyone.decode_response(&rx));
        let one = Exchange::new(Address(1), Request::ReadAddress);
        refused(&rx, one.decode_response(&rx), M::Address);
        let rx = sum(&[0x22, 7, 0x10, 0, 0, 0, 7]);
        let state = Exchange::new(BROADCAST, Request::ReadState);
        refused(&rx, state.decode_response(&rx), M::Address);
    }

    #[test]
    fn requests() {
        // [R55 §1.1, §1.7, §2.1]
        let rows = [
            (vec![0x22], M::Start),
            (sum(&[0x22, 1, 0x10, 0, 0, 0, 0]), M::Start),
            (vec![0x55, 1, 0x10, 0, 0, 0, 0, 0], M::Checksum),
            (sum(&[0x55, 1, 0x17, 0, 0, 0, 0]), M::Function),
            (sum(&[0x55, 1, 0x11, 0, 0, 0, 0]), M::Value),
            (sum(&[0x55, 1, 0x11, 0, 0, 0, 33]), M::Value),
            (sum(&[0x55, 1, 0x38, 0, 0, 0, 33]), M::Value),
        ];
        for (rx, why) in rows {
            refused(&rx, Exchange::decode_request(&rx), why);
        }
        assert!(U24::new(1 << 24).is_none() && U24::new((1 << 24) - 1).is_some());
        assert!(
            Exchange::new(Address(1), Request::ReadState)
                .without_reply()
                .is_none()
        );
    }

    #[test]
    fn lcus_frames() {
        let rows = [
            (sum(&[0xA1, 1, 1]), M::Start),
            (vec![0xA0, 1, 1, 0], M::Checksum),
            (sum(&[0xA0, 1, 2]), M::Value),
        ];
        for (rx, why) in rows {
            refused(&rx, lcus::Request::decode(&rx), why);
        }
    }
}

/// If nothing is found, the reason is that of the first byte.
#[test]
fn a_search_that_fails_says_why() {
    let ask = Exchange::r55(Address(1), r55::Request::ReadState);
    let rx = [0x22, 1, 0x10, 0, 0, 0, 0, 0];
    assert_eq!(ask.find_response(&rx), (8, Decoded::Malformed(M::Checksum)));
    assert_eq!(
        ask.find_response(&rx[1..]),
        (7, Decoded::Malformed(M::Start))
    );
}
