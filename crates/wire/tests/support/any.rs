//! Arbitrary valid exchanges with a reply that belongs to them.
//!
//! Addresses and data are drawn mostly from a few values that are known to be ambiguous: two
//! independent cases then often concern the same module, and data often look like checksums and end
//! marks.

use proptest::prelude::*;
use proptest::sample::select;
use railbus_wire::*;

/// An exchange in any of the protocols, and a reply to it.
#[derive(Clone, Debug)]
pub(crate) enum Case {
    Rtu(RtuCase),
    Ascii(ascii::Exchange, Address, ascii::Response),
    Lc02(lc02::Exchange, Address, lc02::Response),
    R55(r55::Exchange, Address, r55::Response),
}

/// The parts of a Modbus exchange, which borrows its values.
#[derive(Clone, Debug)]
pub(crate) struct RtuCase {
    address: Address,
    from: Address,
    function: rtu::Function,
    start: u16,
    count: u16,
    sent: Vec<u8>,
    answered: Vec<u8>,
    exception: Option<rtu::Exception>,
}

impl RtuCase {
    fn exchange(&self) -> rtu::Exchange<'_> {
        use rtu::{BitBlock, BitSpan, CoilValue, Function, Request, WordBlock, WordSpan};
        let bits = || BitSpan::new(self.start, self.count).unwrap();
        let words = || WordSpan::new(self.start, self.count).unwrap();
        let request = match self.function {
            Function::ReadCoils => Request::ReadCoils(bits()),
            Function::ReadDiscreteInputs => Request::ReadDiscreteInputs(bits()),
            Function::ReadHoldingRegisters => Request::ReadHoldingRegisters(words()),
            Function::ReadInputRegisters => Request::ReadInputRegisters(words()),
            Function::WriteCoil => Request::WriteCoil {
                at: self.start,
                value: CoilValue(self.count),
            },
            Function::WriteRegister => Request::WriteRegister {
                at: self.start,
                value: self.count,
            },
            Function::WriteCoils => {
                let values = Bits::from_packed(&self.sent, self.count).unwrap();
                Request::WriteCoils(BitBlock::new(self.start, values).unwrap())
            }
            Function::WriteRegisters => {
                let values = Words::from_packed(&self.sent).unwrap();
                Request::WriteRegisters(WordBlock::new(self.start, values).unwrap())
            }
            Function::Diagnose => Request::Diagnose {
                sub: self.start,
                data: self.count,
            },
            Function::Identify => Request::Identify {
                code: self.start as u8,
                object: self.count as u8,
            },
        };
        rtu::Exchange {
            address: self.address,
            request,
        }
    }

    fn response(&self) -> rtu::Response<'_> {
        use rtu::{Function, Response};
        if let Some(why) = self.exception {
            return Response::Exception(why);
        }
        match self.function {
            Function::ReadCoils | Function::ReadDiscreteInputs => {
                Response::Bits(Bits::from_packed(&self.answered, self.count).unwrap())
            }
            Function::ReadHoldingRegisters | Function::ReadInputRegisters => {
                Response::Words(Words::from_packed(&self.answered).unwrap())
            }
            Function::Diagnose => Response::Diagnosis(self.count),
            Function::Identify => {
                Response::Identification(rtu::Identification::from_packed(&self.answered).unwrap())
            }
            _ => Response::Done,
        }
    }
}

impl Case {
    pub(crate) fn exchange(&self) -> Exchange<'_> {
        match self {
            Case::Rtu(case) => Exchange::Rtu(case.exchange()),
            Case::Ascii(exchange, ..) => Exchange::Ascii(*exchange),
            Case::Lc02(exchange, ..) => Exchange::Lc02(*exchange),
            Case::R55(exchange, ..) => Exchange::R55(*exchange),
        }
    }

    pub(crate) fn response(&self) -> Response<'_> {
        match self {
            Case::Rtu(case) => Response::Rtu(case.response()),
            Case::Ascii(_, _, response) => Response::Ascii(*response),
            Case::Lc02(_, _, response) => Response::Lc02(*response),
            Case::R55(_, _, response) => Response::R55(*response),
        }
    }

    /// The module that answers.
    pub(crate) fn from(&self) -> Address {
        match self {
            Case::Rtu(case) => case.from,
            Case::Ascii(_, from, _) | Case::Lc02(_, from, _) | Case::R55(_, from, _) => *from,
        }
    }

    pub(crate) fn request_bytes(&self) -> Vec<u8> {
        let mut frame = Frame::new();
        self.exchange().encode(&mut frame);
        frame.bytes().to_vec()
    }

    pub(crate) fn reply_bytes(&self) -> Vec<u8> {
        let mut frame = Frame::new();
        match self {
            Case::Rtu(case) => {
                case.exchange()
                    .encode_response(case.from, &case.response(), &mut frame);
            }
            Case::Ascii(exchange, from, response) => {
                exchange.encode_response(*from, response, &mut frame);
            }
            Case::Lc02(exchange, from, response) => {
                exchange.encode_response(*from, *response, &mut frame);
            }
            Case::R55(exchange, from, response) => {
                exchange.encode_response(*from, *response, &mut frame);
            }
        }
        frame.bytes().to_vec()
    }

    /// Reads a request as a module of this protocol would.
    pub(crate) fn decode_request<'a>(&self, rx: &'a [u8]) -> Decoded<Exchange<'a>> {
        match self {
            Case::Rtu(_) => rtu::Exchange::decode_request(rx).map(Exchange::Rtu),
            Case::Ascii(exchange, ..) => {
                let rules = ascii::DecodeRules {
                    checksum: exchange.checksum,
                    lower_case: false,
                };
                ascii::Exchange::decode_request(rx, rules).map(Exchange::Ascii)
            }
            Case::Lc02(..) => lc02::Exchange::decode_request(rx).map(Exchange::Lc02),
            Case::R55(..) => r55::Exchange::decode_request(rx).map(Exchange::R55),
        }
    }
}

/// Addresses: few, so that two cases often meet, and those that look like something else. 21h
/// and 3Fh are the checksums of a bare `!` and `?`.
fn address() -> impl Strategy<Value = Address> {
    prop_oneof![
        6 => select(&[0, 1, 2, 0x0D, 0x21, 0x3F, 0xF5][..]),
        1 => any::<u8>(),
    ]
    .prop_map(Address)
}

/// Data bytes, often an end mark or a small number.
fn byte() -> impl Strategy<Value = u8> {
    prop_oneof![select(&[0, 1, 2, 0x0D, 0x21, 0x22, 0x55][..]), any::<u8>()]
}

fn width() -> impl Strategy<Value = PulseWidth> {
    (1u8..=200).prop_map(|tenths| PulseWidth::from_tenths(tenths).unwrap())
}

fn text() -> impl Strategy<Value = ascii::Text> {
    prop::collection::vec(0x20u8..0x7F, 1..=ascii::Text::MAX)
        .prop_map(|characters| ascii::Text::new(&characters).unwrap())
}

/// Mostly short runs, now and then up to the most.
fn count(most: u16) -> impl Strategy<Value = u16> {
    prop_oneof![8 => 1..=most.min(20), 1 => 1..=most, 1 => Just(most)]
}

pub(crate) fn rtu() -> impl Strategy<Value = Case> {
    use rtu::{BitBlock, Function, WordBlock};
    let numbers = select(&[0x01u8, 0x02, 0x03, 0x04, 0x05, 0x06, 0x08, 0x0F, 0x10, 0x2B][..])
        .prop_map(|code| Function::from_code(code).unwrap())
        .prop_flat_map(|function| {
            let counts = match function {
                Function::ReadCoils | Function::ReadDiscreteInputs => count(Bits::MAX).boxed(),
                Function::ReadHoldingRegisters | Function::ReadInputRegisters => {
                    count(Words::MAX).boxed()
                }
                Function::WriteCoil | Function::WriteRegister | Function::Diagnose => {
                    any::<u16>().boxed()
                }
                // How long the object is.
                Function::Identify => (0u16..=240).boxed(),
                Function::WriteCoils => count(BitBlock::MAX).boxed(),
                Function::WriteRegisters => count(WordBlock::MAX).boxed(),
            };
            (Just(function), counts)
        })
        .prop_flat_map(|(function, count)| {
            let bits = usize::from(count.div_ceil(8));
            let words = 2 * usize::from(count);
            let (sent, answered) = match function {
                Function::ReadCoils | Function::ReadDiscreteInputs => (0, bits),
                Function::ReadHoldingRegisters | Function::ReadInputRegisters => (0, words),
                Function::WriteCoils => (bits, 0),
                Function::WriteRegisters => (words, 0),
                Function::WriteCoil | Function::WriteRegister | Function::Diagnose => (0, 0),
                Function::Identify => (0, 7 + usize::from(count)),
            };
            let last_start = match function {
                Function::WriteCoil | Function::WriteRegister => u16::MAX,
                Function::Diagnose => 0x14,
                Function::Identify => 4,
                _ => u16::MAX - (count - 1),
            };
            (
                Just((function, count)),
                prop_oneof![0..=last_start.min(100), 0..=last_start],
                prop::collection::vec(any::<u8>(), sent),
                prop::collection::vec(any::<u8>(), answered),
            )
        });
    let exception = prop::option::weighted(0.2, any::<u8>().prop_map(rtu::Exception));
    (address(), address(), numbers, exception).prop_map(
        |(address, other, ((function, count), start, sent, mut answered), exception)| {
            if function == Function::Identify {
                let head = [start as u8, 0x82, 0, 0, 1, 0, count as u8];
                answered[..7].copy_from_slice(&head);
            }
            let from = if address == rtu::BROADCAST {
                other
            } else {
                address
            };
            Case::Rtu(RtuCase {
                address,
                // A write to address 0 is not answered; its reply, were there one, would echo 0.
                from,
                function,
                start,
                count,
                sent,
                answered,
                exception,
            })
        },
    )
}

fn ascii_request() -> impl Strategy<Value = ascii::Request> {
    use ascii::Request;
    prop_oneof![
        6 => select(vec![
            Request::ReadName,
            Request::ReadFirmware,
            Request::ReadConfig,
            Request::ReadData,
            Request::ReadPulse,
            Request::ReadLatched,
            Request::ReadReset,
            Request::ReadInit,
            Request::ReadAll,
            Request::ReadWatchdogStatus,
            Request::ClearWatchdog,
            Request::ReadWatchdog,
            Request::ReadSafe,
        ]),
        1 => (address(), byte(), byte(), byte()).prop_map(|(new_address, a, b, c)| {
            Request::WriteConfig { new_address, type_code: a, baud_code: b, format: c }
        }),
        2 => (byte(), byte()).prop_map(|(order, data)| Request::WriteOutputs { order, data }),
        1 => (byte(), width()).prop_map(|(mask, width)| Request::WritePulse { mask, width }),
        1 => (any::<bool>(), byte())
            .prop_map(|(enabled, tenths)| Request::WriteWatchdog { enabled, tenths }),
        1 => (byte(), byte()).prop_map(|(power_on, safe)| Request::WriteSafe { power_on, safe }),
        1 => text().prop_map(Request::Rename),
    ]
}

fn ascii_response(request: ascii::Request) -> BoxedStrategy<ascii::Response> {
    use ascii::{Request, Response};
    let good = match request {
        Request::ReadName | Request::ReadFirmware => text().prop_map(Response::Text).boxed(),
        Request::ReadConfig => (byte(), byte(), byte())
            .prop_map(|(type_code, baud_code, format)| Response::Config {
                type_code,
                baud_code,
                format,
            })
            .boxed(),
        Request::ReadData => (byte(), byte())
            .prop_map(|(outputs, inputs)| Response::Data { outputs, inputs })
            .boxed(),
        Request::ReadLatched => (any::<bool>(), byte(), byte())
            .prop_map(|(first, outputs, inputs)| Response::Latched {
                first,
                outputs,
                inputs,
            })
            .boxed(),
        Request::ReadPulse => (byte(), width())
            .prop_map(|(mask, width)| Response::Pulse { mask, width })
            .boxed(),
        Request::ReadSafe => (byte(), byte())
            .prop_map(|(power_on, safe)| Response::Safe { power_on, safe })
            .boxed(),
        Request::ReadReset | Request::ReadInit => any::<bool>().prop_map(Response::Flag).boxed(),
        Request::ReadWatchdogStatus => byte().prop_map(Response::Status).boxed(),
        Request::ReadWatchdog => (any::<bool>(), byte())
            .prop_map(|(enabled, tenths)| Response::Watchdog { enabled, tenths })
            .boxed(),
        Request::ReadAll => any::<u16>().prop_map(Response::All).boxed(),
        Request::WriteOutputs { .. } => {
            prop_oneof![3 => Just(Response::Done), 1 => Just(Response::Ignored)].boxed()
        }
        _ => Just(Response::Done).boxed(),
    };
    prop_oneof![4 => good, 1 => Just(Response::Invalid)].boxed()
}

pub(crate) fn ascii() -> impl Strategy<Value = Case> {
    (address(), any::<bool>(), ascii_request(), any::<bool>()).prop_flat_map(
        |(address, checksum, request, moved)| {
            let from = match request {
                ascii::Request::WriteConfig { new_address, .. } if moved => new_address,
                _ => address,
            };
            let exchange = ascii::Exchange {
                address,
                checksum,
                request,
            };
            ascii_response(request).prop_map(move |response| Case::Ascii(exchange, from, response))
        },
    )
}

fn lc02_request() -> impl Strategy<Value = lc02::Request> {
    use lc02::{Outputs, Request};
    prop_oneof![
        Just(Request::ReadConfig),
        Just(Request::ReadData),
        Just(Request::ReadPulse),
        (address(), byte()).prop_map(|(new_address, baud_code)| Request::WriteConfig {
            new_address,
            baud_code,
        }),
        byte().prop_map(|value| Request::WriteOutputs(Outputs::All(value))),
        (0u8..8, any::<bool>()).prop_map(|(channel, on)| {
            Request::WriteOutputs(Outputs::One(Channel::new(channel).unwrap(), on))
        }),
        (byte(), width()).prop_map(|(mask, width)| Request::WritePulse { mask, width }),
    ]
}

/// Replies; now and then one whose beginning is a shorter reply from the same module.
fn lc02_response(request: lc02::Request, from: Address) -> BoxedStrategy<lc02::Response> {
    use lc02::{Request, Response};
    let first = prop_oneof![1 => Just(from.0), 2 => byte()];
    let second = prop_oneof![1 => Just(0x0D), 2 => byte()];
    match request {
        Request::ReadConfig => (first, second, byte(), prop_oneof![Just(0x0D), byte()])
            .prop_map(|(baud_code, high, low, type_code)| Response::Config {
                baud_code,
                model: u16::from_be_bytes([high, low]),
                type_code,
            })
            .boxed(),
        Request::ReadData => (first, second)
            .prop_map(|(outputs, inputs)| Response::Data { outputs, inputs })
            .boxed(),
        Request::ReadPulse => (
            first,
            prop_oneof![1 => Just(PulseWidth::from_tenths(0x0D).unwrap()), 2 => width()],
        )
            .prop_map(|(mask, width)| Response::Pulse { mask, width })
            .boxed(),
        _ => Just(Response::Done).boxed(),
    }
}

pub(crate) fn lc02() -> impl Strategy<Value = Case> {
    (address(), lc02_request(), any::<bool>()).prop_flat_map(|(address, request, moved)| {
        let from = match request {
            lc02::Request::WriteConfig { new_address, .. } if moved => new_address,
            _ => address,
        };
        let exchange = lc02::Exchange { address, request };
        lc02_response(request, from).prop_map(move |response| Case::Lc02(exchange, from, response))
    })
}

fn r55_request() -> impl Strategy<Value = r55::Request> {
    use r55::{Request, U24};
    let channel = || (0u8..32).prop_map(|index| Channel::new(index).unwrap());
    let u24 = || (0u32..1 << 24).prop_map(|value| U24::new(value).unwrap());
    prop_oneof![
        Just(Request::ReadState),
        Just(Request::ReadAddress),
        channel().prop_map(Request::Open),
        channel().prop_map(Request::Close),
        channel().prop_map(Request::Toggle),
        any::<u32>().prop_map(Request::SetAll),
        any::<u32>().prop_map(Request::GroupOff),
        any::<u32>().prop_map(Request::GroupOn),
        any::<u32>().prop_map(Request::GroupToggle),
        (channel(), u24()).prop_map(|(channel, time)| Request::JogClose(channel, time)),
        (channel(), u24()).prop_map(|(channel, time)| Request::JogOpen(channel, time)),
        address().prop_map(Request::WriteAddress),
        byte().prop_map(Request::ReadVariable),
        (byte(), u24()).prop_map(|(index, value)| Request::WriteVariable(index, value)),
    ]
}

pub(crate) fn r55() -> impl Strategy<Value = Case> {
    (
        address(),
        address(),
        r55_request(),
        any::<bool>(),
        any::<[u8; 4]>(),
    )
        .prop_map(|(address, other, request, silent, data)| {
            let answered = r55::Exchange::new(address, request);
            let exchange = match answered.without_reply() {
                Some(twin) if silent => twin,
                _ => answered,
            };
            let anyone = request == r55::Request::ReadAddress && address == r55::BROADCAST;
            let from = if anyone { other } else { address };
            Case::R55(exchange, from, r55::Response { data })
        })
}
