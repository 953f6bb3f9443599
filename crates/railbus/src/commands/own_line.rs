//! A line opened here for raw frames. The line's master sends them, just as the daemon's does: a
//! late reply to an earlier request is never taken for the reply, nor is an echo, and the port is
//! held until no late reply can arrive any more.

use super::Context;
use super::place::{Place, port_failure};
use railbus_app::failure::Failure;
use railbus_commission::Risk;
use railbus_host::{EchoMode, Fault, Line, LineOptions, Probe, ProbeResult, SerialSettings};
use railbus_wire::{Decoded, Exchange, Frame, Micros, Protocol, ascii, lc02, r55, rtu};
use railbus_words::Code;

/// The gap that the slowest of the families needs before a request.
const GAP: Micros = Micros::from_millis(20);

/// A line that this process has to itself.
pub(super) struct OwnLine<'c> {
    context: &'c Context,
    line: Line,
    settings: SerialSettings,
    /// Whether the adapter echoes is known, or was tried once without result.
    knows_echo: bool,
}

impl<'c> OwnLine<'c> {
    /// Opens the port.
    pub(super) async fn open(context: &'c Context, place: &Place) -> Result<Self, Failure> {
        let mut config = LineOptions::new(place.port.clone());
        config.serial.settings = place.settings;
        config.bus.echo = place.echo;
        let failed = |error| port_failure(context, place, &error);
        let line = Line::open(config).map_err(failed)?;
        if let Err(error) = line.opened().await {
            line.close().await;
            return Err(failed(error));
        }
        Ok(OwnLine {
            context,
            line,
            settings: place.settings,
            knows_echo: place.echo != EchoMode::Auto,
        })
    }

    /// Sends a request and returns its outcome.
    pub(super) async fn ask(
        &mut self,
        asked: Exchange<'static>,
        timeout: Micros,
    ) -> Result<ProbeResult, Failure> {
        if !self.knows_echo && is_own_reply(&asked) {
            // The echo of such a request looks like its reply, so a read goes first: its reply
            // differs from its echo, which shows whether there is one. Whether and how the read is
            // answered does not matter.
            if let Some(look) = look(&asked) {
                self.probe(look, timeout).await?;
            }
        }
        self.probe(asked, timeout).await
    }

    async fn probe(
        &mut self,
        exchange: Exchange<'static>,
        timeout: Micros,
    ) -> Result<ProbeResult, Failure> {
        let probe = Probe {
            exchange,
            settings: self.settings,
            gap: GAP.max(self.settings.t3_5()),
            timeout,
            clear: false,
            changes: Risk::of(&exchange) > Risk::Read,
            as_module: false,
        };
        let acts = probe.changes;
        let met = self.line.probe(probe).await;
        self.knows_echo |= exchange.expects_reply();
        met.map_err(|fault| {
            let code = match fault {
                Fault::Unknown => Code::Unknown,
                _ => Code::LineClosed,
            };
            let failure = Failure::of(self.context.lang, code);
            failure.perhaps_acted(acts && fault.may_have_acted())
        })
    }

    /// Closes the port, once no late reply can reach the next program that opens it.
    pub(super) async fn close(self) {
        self.line.close().await;
    }
}

/// Whether a module may acknowledge this request by repeating it.
fn is_own_reply(asked: &Exchange<'_>) -> bool {
    let mut sent = Frame::new();
    asked.encode(&mut sent);
    asked.expects_reply() && matches!(asked.decode_response(sent.bytes()), Decoded::Whole { .. })
}

/// A read of the same module whose reply differs from the request.
fn look(asked: &Exchange<'_>) -> Option<Exchange<'static>> {
    let address = asked.address();
    Some(match asked.protocol() {
        Protocol::Rtu => {
            let first = rtu::BitSpan::new(0, 1)?;
            Exchange::rtu(address, rtu::Request::ReadCoils(first))
        }
        Protocol::R55 => Exchange::r55(address, r55::Request::ReadState),
        Protocol::Lc02 => Exchange::lc02(address, lc02::Request::ReadConfig),
        Protocol::Ascii => Exchange::ascii(address, false, ascii::Request::ReadName),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_wire::{Address, Channel};

    #[test]
    fn what_is_asked_first_never_looks_like_its_own_reply() {
        let coil = rtu::Request::WriteCoil {
            at: 60,
            value: rtu::CoilValue::ON,
        };
        assert!(is_own_reply(&Exchange::rtu(Address(3), coil)));
        let one = Channel::new(0).unwrap();
        for asked in [
            Exchange::rtu(Address(3), coil),
            Exchange::r55(Address(4), r55::Request::Close(one)),
            Exchange::lc02(Address(1), lc02::Request::ReadData),
            Exchange::ascii(Address(1), false, ascii::Request::ReadData),
        ] {
            let look = look(&asked).unwrap();
            assert!(look.expects_reply() && !is_own_reply(&look), "{look:?}");
            assert_eq!(look.address(), asked.address());
        }
    }
}
