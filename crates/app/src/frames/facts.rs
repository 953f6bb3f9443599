//! What can be said of something heard without reading its bytes: what filters ask for.

use railbus_api::types::ModuleInfo;
use railbus_commission::Risk;
use railbus_sniff::{Asked, Heard, Role, Verdict};
use railbus_wire::{Address, Exchange, Micros, Protocol};

/// A module by what tells it apart on a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// The protocol that it speaks.
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

/// What can be said of something heard.
#[derive(Debug)]
pub struct Facts<'a> {
    /// The protocols that it may be of, the likeliest first.
    pub protocols: Vec<Protocol>,
    /// Whom it is for, or of.
    pub address: Option<u8>,
    /// The module of that protocol and address, where one is known.
    pub module: Option<&'a str>,
    /// Whether it is a request or a reply, where that can be told.
    pub role: Option<Role>,
    /// None for a request that nobody answered.
    pub verdict: Option<Verdict>,
    /// It is a write, or belongs to one; nothing where that can't be told.
    pub write: Option<bool>,
    /// It is a reply to an earlier request.
    pub late: bool,
    /// From the request to its reply, or to the end of the waiting.
    pub after: Option<Micros>,
    /// The silence before it.
    pub gap: Option<Micros>,
}

impl<'a> Facts<'a> {
    /// What can be said of this, where these are the modules of the line.
    pub fn of(heard: &Heard, modules: &'a [Named]) -> Facts<'a> {
        let mut facts = match heard {
            Heard::Missing(missing) => Facts {
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
            Heard::Frame(frame) => {
                let best = frame.readings.first();
                let asked = match best {
                    Some(reading) if reading.role == Some(Role::Request) => {
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

/// Whom a request is for.
pub fn addressee(asked: &Asked) -> Option<u8> {
    let exchange = asked.exchange()?;
    let all = matches!(exchange, Exchange::Ascii(e) if e.request.is_broadcast());
    (!all).then_some(exchange.address().0)
}

/// Whether a request changes something.
fn is_write(asked: &Exchange<'_>) -> bool {
    Risk::of(asked) > Risk::Read
}
