//! What a raw request may do to a line.

use railbus_wire::{Exchange, ascii, lc02, r55, rtu};

/// What a request may do, least first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Risk {
    /// It only reads.
    Read,
    /// It switches outputs of one module.
    Output,
    /// It changes stored settings of a module.
    Kept,
    /// It is addressed to all modules at once.
    All,
}

impl Risk {
    /// What this request may do.
    #[must_use]
    pub fn of(asked: &Exchange<'_>) -> Risk {
        match asked {
            Exchange::Rtu(e) => of_rtu(e),
            Exchange::R55(e) => of_r55(e),
            Exchange::Lc02(e) => match e.request {
                lc02::Request::ReadConfig | lc02::Request::ReadData | lc02::Request::ReadPulse => {
                    Risk::Read
                }
                lc02::Request::WriteOutputs(_) => Risk::Output,
                lc02::Request::WriteConfig { .. } | lc02::Request::WritePulse { .. } => Risk::Kept,
            },
            Exchange::Ascii(e) => of_ascii(&e.request),
        }
    }
}

/// Whether a module answers it: broadcasts are carried out without a reply [R55 §4.2].
#[must_use]
pub fn is_answered(asked: &Exchange<'_>) -> bool {
    asked.expects_reply() && Risk::of(asked) != Risk::All
}

fn of_rtu(e: &rtu::Exchange<'_>) -> Risk {
    match e.request {
        _ if e.address == rtu::BROADCAST => Risk::All,
        rtu::Request::WriteCoil { .. } | rtu::Request::WriteCoils(_) => Risk::Output,
        request if request.is_read() => Risk::Read,
        // Registers, and diagnostics that clear counters or silence a module.
        _ => Risk::Kept,
    }
}

fn of_r55(e: &r55::Exchange) -> Risk {
    match e.request() {
        r55::Request::ReadAddress => Risk::Read,
        _ if e.address() == r55::BROADCAST => Risk::All,
        r55::Request::WriteAddress(_) => Risk::Kept,
        r55::Request::ReadState | r55::Request::ReadVariable(_) => Risk::Read,
        _ => Risk::Output,
    }
}

const fn of_ascii(request: &ascii::Request) -> Risk {
    match request {
        ascii::Request::SampleAll | ascii::Request::HostOk => Risk::All,
        ascii::Request::WriteConfig { .. }
        | ascii::Request::WritePulse { .. }
        | ascii::Request::WriteWatchdog { .. }
        | ascii::Request::WriteSafe { .. }
        | ascii::Request::Rename(_) => Risk::Kept,
        ascii::Request::WriteOutputs { .. } | ascii::Request::ClearWatchdog => Risk::Output,
        // Reading it clears it.
        ascii::Request::ReadReset => Risk::Output,
        _ => Risk::Read,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_wire::{Address, Channel};

    #[test]
    fn what_a_request_may_do_is_known() {
        let ascii = |request| Exchange::ascii(Address(1), false, request);
        let r55 = |address, request| Exchange::r55(Address(address), request);
        let coil = rtu::Request::WriteCoil {
            at: 60,
            value: rtu::CoilValue::ON,
        };
        let register = rtu::Request::WriteRegister { at: 4, value: 1 };
        let one = Channel::new(0).unwrap();
        let diagnose = |sub| rtu::Request::Diagnose { sub, data: 0 };
        for (asked, risk) in [
            (Exchange::rtu(Address(3), coil), Risk::Output),
            (Exchange::rtu(Address(0), coil), Risk::All),
            (Exchange::rtu(Address(3), register), Risk::Kept),
            (Exchange::rtu(Address(3), diagnose(0)), Risk::Read),
            (Exchange::rtu(Address(3), diagnose(4)), Risk::Kept),
            (ascii(ascii::Request::ReadData), Risk::Read),
            (ascii(ascii::Request::ReadReset), Risk::Output),
            (ascii(ascii::Request::HostOk), Risk::All),
            (r55(4, r55::Request::ReadState), Risk::Read),
            (r55(245, r55::Request::ReadAddress), Risk::Read),
            (r55(245, r55::Request::Close(one)), Risk::All),
            (r55(4, r55::Request::Toggle(one)), Risk::Output),
            (r55(4, r55::Request::WriteAddress(Address(5))), Risk::Kept),
            (
                Exchange::lc02(Address(1), lc02::Request::ReadPulse),
                Risk::Read,
            ),
        ] {
            assert_eq!(Risk::of(&asked), risk, "{asked:?}");
        }
    }
}
