//! What a scan asks, and in which order. Everything here only reads, and no other protocol could
//! take any of it for a command.

use crate::commands::context;
use railbus_wire::{Address, Exchange, Frame, Protocol, ascii, carries_command, lc02, r55, rtu};

/// One question of a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ask {
    /// The state of a 0x55 board [R55 §2.2].
    R55State,
    /// Address, speed and model in LC-02.
    Lc02Config,
    /// `$AAM`, with or without checksum.
    AsciiName(bool),
    /// Four registers from 0: model and address of an EDA9060A.
    Registers4,
    /// Eight registers from 0: an EMD-2A2Q.
    Registers8,
    /// Eight coils from 60: an ERC-8.
    Coils60,
    /// Eight coils from 0: an EDA9050, which knows no registers to read.
    Coils0,
}

impl Ask {
    pub(super) const fn protocol(self) -> Protocol {
        match self {
            Ask::R55State => Protocol::R55,
            Ask::Lc02Config => Protocol::Lc02,
            Ask::AsciiName(_) => Protocol::Ascii,
            Ask::Registers4 | Ask::Registers8 | Ask::Coils60 | Ask::Coils0 => Protocol::Rtu,
        }
    }

    /// The question to one module; none where no module has that address, or where it would be
    /// for all of them.
    pub(super) fn exchange(self, address: Address) -> Option<Exchange<'static>> {
        let coils = |start| Some(rtu::Request::ReadCoils(rtu::BitSpan::new(start, 8)?));
        let registers = |count| {
            Some(rtu::Request::ReadHoldingRegisters(rtu::WordSpan::new(
                0, count,
            )?))
        };
        let request = match self {
            Ask::R55State if address == r55::BROADCAST => return None,
            Ask::R55State => return Some(Exchange::r55(address, r55::Request::ReadState)),
            Ask::Lc02Config => return Some(Exchange::lc02(address, lc02::Request::ReadConfig)),
            Ask::AsciiName(checksum) => {
                return Some(Exchange::ascii(address, checksum, ascii::Request::ReadName));
            }
            _ if address == rtu::BROADCAST => return None,
            Ask::Registers4 => registers(4)?,
            Ask::Registers8 => registers(8)?,
            Ask::Coils60 => coils(60)?,
            Ask::Coils0 => coils(0)?,
        };
        Some(Exchange::rtu(address, request))
    }

    /// The same, unless a module of another protocol could take the frame for a command.
    pub(super) fn safe_exchange(self, address: Address) -> Option<Exchange<'static>> {
        let exchange = self.exchange(address)?;
        let mut frame = Frame::new();
        exchange.encode(&mut frame);
        let others = Protocol::ALL
            .into_iter()
            .filter(|other| *other != self.protocol());
        let mut others = others;
        (!others.any(|other| carries_command(frame.bytes(), other))).then_some(exchange)
    }
}

/// What is asked of a module that has answered, to find out what it is.
pub(super) fn follow_ups(first: Ask) -> &'static [Ask] {
    match first {
        Ask::Registers4 => &[Ask::Registers8, Ask::Coils60],
        Ask::Coils0 => &[Ask::Registers4],
        _ => &[],
    }
}

/// What is to be scanned.
#[derive(Clone, Debug)]
pub(super) struct Scope {
    pub(super) addresses: Vec<u8>,
    pub(super) protocols: Vec<Protocol>,
    pub(super) checksums: Vec<bool>,
}

impl Scope {
    /// The first questions, each for all addresses before the next: so that a late reply to one
    /// is not in the way of the same module's next.
    pub(super) fn asks(&self) -> Vec<Ask> {
        let names = self.checksums.iter().copied().map(Ask::AsciiName);
        let all = [Ask::R55State, Ask::Lc02Config].into_iter();
        let all = all.chain(names).chain([Ask::Registers4, Ask::Coils0]);
        all.filter(|ask| self.protocols.contains(&ask.protocol()))
            .collect()
    }
}

/// Addresses as flags name them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Addresses(pub(super) Vec<u8>);

/// Reads `1-32,0x40`.
pub(super) fn addresses(text: &str) -> Result<Addresses, String> {
    let mut all = Vec::new();
    for part in text.split(',') {
        let (low, high) = part.split_once('-').unwrap_or((part, part));
        let (low, high) = (context::address(low)?, context::address(high)?);
        if low > high {
            return Err(part.to_owned());
        }
        all.extend(low..=high);
    }
    all.sort_unstable();
    all.dedup();
    Ok(Addresses(all))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Ask; 8] = [
        Ask::R55State,
        Ask::Lc02Config,
        Ask::AsciiName(false),
        Ask::AsciiName(true),
        Ask::Registers4,
        Ask::Registers8,
        Ask::Coils60,
        Ask::Coils0,
    ];

    #[test]
    fn every_frame_only_reads_and_is_a_command_of_no_other_protocol() {
        let mut sent = 0;
        for ask in ALL {
            for address in 0..=255 {
                let Some(exchange) = ask.safe_exchange(Address(address)) else {
                    continue;
                };
                sent += 1;
                assert!(exchange.expects_reply(), "{ask:?} {address}");
                let reads = match exchange {
                    Exchange::Rtu(e) => e.request.is_read() && e.address != rtu::BROADCAST,
                    Exchange::R55(e) => {
                        e.request() == r55::Request::ReadState && e.address() != r55::BROADCAST
                    }
                    Exchange::Lc02(e) => e.request == lc02::Request::ReadConfig,
                    Exchange::Ascii(e) => e.request == ascii::Request::ReadName,
                };
                assert!(reads, "{ask:?} {address}");
                let mut frame = Frame::new();
                exchange.encode(&mut frame);
                for other in Protocol::ALL {
                    let own = other == ask.protocol();
                    assert!(
                        own || !carries_command(frame.bytes(), other),
                        "{ask:?} {address}"
                    );
                }
            }
        }
        // Hardly any frame had to be left out.
        assert!(sent > 2_000, "{sent}");
    }

    #[test]
    fn addresses_are_read_as_ranges() {
        assert_eq!(addresses("1-3,0x40,2"), Ok(Addresses(vec![1, 2, 3, 64])));
        for wrong in ["", "3-1", "1-", "256", "x"] {
            assert!(addresses(wrong).is_err(), "{wrong}");
        }
    }
}
