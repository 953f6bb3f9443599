//! LC-02, the hexadecimal protocol of the EDA modules.
//!
//! ```text
//! request  4C 57 address command [data] sum 0D
//! reply    6C 63 address         [data] sum 0D
//! ```
//! The frame is binary: 0D may be an address, data or the sum, so frames are parsed by length and
//! never by their end byte [EDA §3.2]. Other meters of the vendor use the same [`envelope`] with
//! other commands.

use crate::{Address, Channel, Decoded, Frame, Malformed, PulseWidth, Reply};

/// A request to one module, and its reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exchange {
    /// The module, 00 to FF. There is no broadcast.
    pub address: Address,
    /// The request.
    pub request: Request,
}

/// The outputs of a write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outputs {
    /// All of them: bit n is channel n.
    All(u8),
    /// One of them, 0 to 7.
    One(Channel, bool),
}

/// A request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// 01: address, speed, model.
    ReadConfig,
    /// 02: new address and speed.
    WriteConfig {
        /// The new address, 00 to FF.
        new_address: Address,
        /// The code of the new speed, 03 to 07 on EDA modules.
        baud_code: u8,
    },
    /// 03: outputs and inputs.
    ReadData,
    /// 04: switch outputs.
    WriteOutputs(Outputs),
    /// 05: which outputs give pulses, and their width (EDA9060A).
    WritePulse {
        /// Bit n = channel n gives pulses.
        mask: u8,
        /// The width of all pulses.
        width: PulseWidth,
    },
    /// 06: read what 05 has written (EDA9060A).
    ReadPulse,
}

/// A response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response {
    /// To [`Request::ReadConfig`].
    Config {
        /// The code of the speed, 03 to 07.
        baud_code: u8,
        /// The model in two bytes as they are in the frame: 9060h in BCD, or 2364h if a module
        /// counts in binary [EDA §3.7].
        model: u16,
        /// 00.
        type_code: u8,
    },
    /// To [`Request::ReadData`].
    Data {
        /// Bit n = output n is on.
        outputs: u8,
        /// Bit n = input n is high or open.
        inputs: u8,
    },
    /// To [`Request::ReadPulse`]. The width is what the module sent.
    Pulse {
        /// Bit n = channel n gives pulses.
        mask: u8,
        /// Tenths of a second, 1 to 200.
        width: PulseWidth,
    },
    /// To every write.
    Done,
}

impl Request {
    #[inline]
    const fn command(&self) -> u8 {
        match self {
            Request::ReadConfig => 0x01,
            Request::WriteConfig { .. } => 0x02,
            Request::ReadData => 0x03,
            Request::WriteOutputs(_) => 0x04,
            Request::WritePulse { .. } => 0x05,
            Request::ReadPulse => 0x06,
        }
    }

    /// The number of data bytes in the reply.
    #[inline]
    const fn response_data(&self) -> usize {
        match self {
            Request::ReadConfig => 4,
            Request::ReadData | Request::ReadPulse => 2,
            Request::WriteConfig { .. } | Request::WriteOutputs(_) | Request::WritePulse { .. } => {
                0
            }
        }
    }

    /// The request for a command byte and its data.
    #[inline]
    fn parse(command: u8, data: &[u8]) -> Result<Request, Malformed> {
        Ok(match (command, data) {
            (0x01, []) => Request::ReadConfig,
            (0x02, &[new_address, baud_code, 0]) => Request::WriteConfig {
                new_address: Address(new_address),
                baud_code,
            },
            (0x03, []) => Request::ReadData,
            (0x04, &[0xFF, value]) => Request::WriteOutputs(Outputs::All(value)),
            (0x04, &[channel @ 0..=7, state @ 0..=1]) => {
                let channel = Channel::new(channel).ok_or(Malformed::Value)?;
                Request::WriteOutputs(Outputs::One(channel, state == 1))
            }
            (0x05, &[mask, width]) => Request::WritePulse {
                mask,
                width: PulseWidth::from_tenths(width).ok_or(Malformed::Value)?,
            },
            (0x06, []) => Request::ReadPulse,
            _ => return Err(Malformed::Value),
        })
    }
}

impl Exchange {
    /// How many bytes the reply has.
    #[must_use]
    pub const fn response_len(&self) -> usize {
        5 + self.request.response_data()
    }

    /// Writes the request frame.
    #[inline]
    pub fn encode(&self, out: &mut Frame) {
        let command = self.request.command();
        let body: &[u8] = match self.request {
            Request::ReadConfig | Request::ReadData | Request::ReadPulse => &[command],
            Request::WriteConfig {
                new_address,
                baud_code,
            } => &[command, new_address.0, baud_code, 0x00],
            Request::WriteOutputs(Outputs::All(value)) => &[command, 0xFF, value],
            Request::WriteOutputs(Outputs::One(channel, on)) => {
                &[command, channel.index(), u8::from(on)]
            }
            Request::WritePulse { mask, width } => &[command, mask, width.tenths()],
        };
        envelope::seal(envelope::REQUEST_START, self.address, body, out);
    }

    /// Decodes the beginning of `rx` as a request. The command determines the length.
    #[inline]
    pub fn decode_request(rx: &[u8]) -> Decoded<Exchange> {
        let len = match rx.get(3) {
            None => 4,
            Some(0x01 | 0x03 | 0x06) => 6,
            Some(0x02) => 9,
            Some(0x04 | 0x05) => 8,
            Some(_) => return Decoded::Malformed(Malformed::Function),
        };
        envelope::open(envelope::REQUEST_START, rx, len).and_then(|(address, body)| {
            let [command, data @ ..] = body else {
                return Err(Malformed::Length);
            };
            Ok(Exchange {
                address,
                request: Request::parse(*command, data)?,
            })
        })
    }

    /// Decodes the beginning of `rx` as the reply to this request: start, address, the length that
    /// the request implies, sum and end byte are checked.
    ///
    /// The reply to a configuration write may carry the old address or the new one [EDA §3.8].
    #[inline]
    pub fn decode_response(&self, rx: &[u8]) -> Decoded<Reply<Response>> {
        match rx.get(2) {
            Some(&from) if !self.answerers().contains(&Address(from)) => {
                return Decoded::Malformed(Malformed::Address);
            }
            _ => {}
        }
        let len = 5 + self.request.response_data();
        envelope::open(envelope::RESPONSE_START, rx, len).and_then(|(from, data)| {
            let response = match (self.request, data) {
                (Request::ReadConfig, &[baud_code, high, low, type_code]) => Response::Config {
                    baud_code,
                    model: u16::from_be_bytes([high, low]),
                    type_code,
                },
                (Request::ReadData, &[outputs, inputs]) => Response::Data { outputs, inputs },
                (Request::ReadPulse, &[mask, width]) => Response::Pulse {
                    mask,
                    width: PulseWidth::from_tenths(width).ok_or(Malformed::Value)?,
                },
                _ => Response::Done,
            };
            Ok(Reply {
                from: Some(from),
                response,
            })
        })
    }

    /// Writes the reply of the module at `from`.
    #[inline]
    pub fn encode_response(&self, from: Address, response: Response, out: &mut Frame) {
        let data: &[u8] = match response {
            Response::Done => &[],
            Response::Data { outputs, inputs } => &[outputs, inputs],
            Response::Pulse { mask, width } => &[mask, width.tenths()],
            Response::Config {
                baud_code,
                model,
                type_code,
            } => {
                let [high, low] = model.to_be_bytes();
                &[baud_code, high, low, type_code]
            }
        };
        envelope::seal(envelope::RESPONSE_START, from, data, out);
    }

    /// Whether one frame could be a reply to both. A reply carries neither command nor length, and
    /// its beginning may look like a shorter one (data that repeat the sum, then 0D), so the same
    /// module is enough.
    #[must_use]
    pub fn confusable(&self, other: &Exchange) -> bool {
        self.answerers()
            .iter()
            .any(|address| other.answerers().contains(address))
    }

    /// Whether a good reply to this request can't be one to the other, nor the reverse. That holds
    /// for replies of other modules, and for the configuration, which is longer than any other
    /// reply and does not begin like one: where a shorter reply ends, it has the model's high byte
    /// or the type, and neither is 0D [EDA §3.4].
    #[must_use]
    pub fn stands_apart(&self, other: &Exchange) -> bool {
        let asks_config = |exchange: &Exchange| matches!(exchange.request, Request::ReadConfig);
        !self.confusable(other) || asks_config(self) != asks_config(other)
    }

    /// The addresses that the reply may carry.
    #[inline]
    const fn answerers(&self) -> [Address; 2] {
        match self.request {
            Request::WriteConfig { new_address, .. } => [self.address, new_address],
            _ => [self.address; 2],
        }
    }
}

/// The frame around address and data, which other meters of the vendor use, too.
pub mod envelope {
    use crate::{Address, Decoded, Frame, Malformed, sum8};

    /// The two bytes that open a request, `LW`.
    pub const REQUEST_START: [u8; 2] = [0x4C, 0x57];
    /// The two bytes that open a reply, `lc`.
    pub const RESPONSE_START: [u8; 2] = [0x6C, 0x63];
    /// The byte that ends every frame; it may also occur inside.
    pub const END: u8 = 0x0D;

    /// Writes `body` (the command and its data, or a reply's data) into an envelope. The sum covers
    /// everything from the address to the last byte of the body [EDA §3.3].
    #[inline]
    pub fn seal(start: [u8; 2], address: Address, body: &[u8], out: &mut Frame) {
        out.set([start[0], start[1], address.0]);
        out.extend(body);
        let sum = sum8(out.bytes().get(2..).unwrap_or_default());
        out.extend(&[sum, END]);
    }

    /// Address and body of an envelope of `len` bytes, 5 or more, at the beginning of `rx`.
    #[inline]
    pub fn open(start: [u8; 2], rx: &[u8], len: usize) -> Decoded<(Address, &[u8])> {
        if !rx.iter().zip(start).all(|(&is, wanted)| is == wanted) {
            return Decoded::Malformed(Malformed::Start);
        }
        match rx.get(..len) {
            None => Decoded::Partial {
                more: len - rx.len(),
            },
            Some(&[_, _, address, ref body @ .., sum, END]) => {
                if sum8(body).wrapping_add(address) == sum {
                    Decoded::Whole {
                        len,
                        value: (Address(address), body),
                    }
                } else {
                    Decoded::Malformed(Malformed::Checksum)
                }
            }
            Some(_) => Decoded::Malformed(Malformed::End),
        }
    }
}
