//! Properties of a frame other than its bytes, for use in filters.

use railbus_api::types::ModuleInfo;
use railbus_commission::Risk;
use railbus_sniff::{Asked, FrameRole, FrameVerdict, SniffEvent};
use railbus_wire::{Address, Exchange, Micros, Protocol};

/// A module, by what identifies it on a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// Its protocol.
    pub protocol: Protocol,
    /// Its address.
    pub address: u8,
}

impl Named {
    /// A module of the daemon.
    pub fn of(module: ModuleInfo) -> Option<Named> {
        let known = Protocol::ALL.into_iter();
        let protocol = known
            .into_iter()
            .find(|known| known.name() == module.protocol);
        protocol.map(|protocol| Named {
            name: module.module,
            protocol,
            address: module.address,
        })
    }
}

/// The properties of a frame.
#[derive(Debug)]
pub struct Facts<'a> {
    /// The possible protocols, likeliest first.
    pub protocols: Vec<Protocol>,
    /// The address it is sent to, or comes from.
    pub address: Option<u8>,
    /// The module with that protocol and address, if there is one.
    pub module: Option<&'a str>,
    /// Whether it is a request or a reply, if that can be decided.
    pub role: Option<FrameRole>,
    /// `None` for a request without a reply.
    pub verdict: Option<FrameVerdict>,
    /// It is a write, or belongs to one; `None` if that can't be decided.
    pub write: Option<bool>,
    /// It is a reply to an earlier request.
    pub late: bool,
    /// From the request to its reply, or to its timeout.
    pub after: Option<Micros>,
    /// The idle time before it.
    pub gap: Option<Micros>,
}

impl<'a> Facts<'a> {
    /// The properties, if these are the modules of the line.
    pub fn of(heard: &SniffEvent, modules: &'a [Named]) -> Facts<'a> {
        let mut facts = match heard {
            SniffEvent::Missing(missing) => Facts {
                protocols: vec![missing.asked.protocol()],
                address: addressee(&missing.asked),
                module: None,
                role: None,
                verdict: None,
                write: missing.asked.exchange().map(|asked| is_write(&asked)),
                late: false,
                after: Some(missing.after),
                gap: None,
            },
            SniffEvent::Frame(frame) => {
                let best = frame.readings.first();
                let asked = match best {
                    Some(reading) if reading.role == Some(FrameRole::Request) => {
                        reading.request(&frame.bytes)
                    }
                    _ => frame.asked.as_ref().and_then(Asked::exchange),
                };
                Facts {
                    protocols: frame.readings.iter().map(|r| r.protocol).collect(),
                    address: best.and_then(|r| r.address).map(|Address(number)| number),
                    module: None,
                    role: best.and_then(|reading| reading.role),
                    verdict: Some(frame.verdict),
                    write: asked.map(|asked| is_write(&asked)),
                    late: frame.late,
                    after: frame.after,
                    gap: frame.gap,
                }
            }
        };
        facts.module = modules
            .iter()
            .find(|module| {
                facts.protocols.first() == Some(&module.protocol)
                    && facts.address == Some(module.address)
            })
            .map(|module| module.name.as_str());
        facts
    }
}

/// The address of a request.
pub fn addressee(asked: &Asked) -> Option<u8> {
    let exchange = asked.exchange()?;
    let all = matches!(exchange, Exchange::Ascii(e) if e.request.is_broadcast());
    (!all).then_some(exchange.address().0)
}

/// Whether a request changes something.
fn is_write(asked: &Exchange<'_>) -> bool {
    Risk::of(asked) > Risk::Read
}
