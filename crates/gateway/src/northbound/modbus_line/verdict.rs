//! What a request of a master may do, and so what becomes of it.

use railbus_commission::{Risk, request};
use railbus_device::{Module, Op, Point, PointKind, Setup};
use railbus_site::{CommandError, Config};
use railbus_wire::rtu::{self, Exception, Request};
use railbus_wire::{Address, Exchange, Protocol};
use std::sync::Arc;

use crate::northbound::modbus::ends;

/// The gateway itself.
pub(super) const GATEWAY: u8 = 255;
/// The highest address of a module [MODBUS §1.8].
const UNIT_MAX: u8 = 247;

/// What becomes of a request.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Verdict {
    /// It is sent to the line.
    Read(Exchange<'static>),
    /// It is a command of the site.
    Write(OutputWrite),
    /// It asks the gateway what it is: code and first object.
    Identify(u8, u8),
    /// It is refused.
    Refuse(Exception),
}

/// Outputs of a module to be switched.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct OutputWrite {
    /// The module, by name.
    pub(super) module: Arc<str>,
    /// Its outputs, and their new states.
    pub(super) set: Vec<(Point, bool)>,
    /// The configuration by which the address is this module.
    pub(super) asked_by: Arc<Config>,
}

/// What becomes of a request to this unit of a line.
///
/// Reads pass for any address. Writes pass only as commands of the site: if everything that they
/// write is an output of a configured module. A raw frame would be bound by no
/// rule of the configuration, and its effect would be known only later.
pub(super) fn verdict(config: &Arc<Config>, line: &str, unit: u8, pdu: &[u8]) -> Verdict {
    if unit == GATEWAY {
        return match rtu::Exchange::decode_pdu(Address(unit), pdu).map(|asked| asked.request) {
            Ok(Request::Identify { code, object }) => Verdict::Identify(code, object),
            _ => Verdict::Refuse(Exception::FUNCTION),
        };
    }
    if unit > UNIT_MAX {
        return Verdict::Refuse(Exception::PATH);
    }
    let exchange = match rtu::Exchange::decode_pdu(Address(unit), pdu) {
        Ok(exchange) => exchange,
        Err(error) => {
            let exception = error.exception();
            return Verdict::Refuse(exception.map_or(Exception::FUNCTION, |(_, _, why)| why));
        }
    };
    let refused = Verdict::Refuse(Exception::FUNCTION);
    match Risk::of(&Exchange::Rtu(exchange)) {
        Risk::Read => {
            let mut frame = vec![unit];
            frame.extend_from_slice(pdu);
            frame.extend(railbus_wire::crc16(&frame).to_le_bytes());
            request(Protocol::Rtu, &frame).map_or(refused, Verdict::Read)
        }
        Risk::Output => write(config, line, unit, &exchange.request)
            .map_or_else(Verdict::Refuse, Verdict::Write),
        Risk::Kept | Risk::All => refused,
    }
}

/// The module of this address that speaks Modbus RTU, and its setup.
pub(super) fn module_at<'c>(
    config: &'c Config,
    line: &str,
    unit: u8,
) -> Option<(&'c str, &'c Setup)> {
    let mut modules = config.modules_of(line);
    let is_it = |setup: &Setup| setup.protocol == Protocol::Rtu && setup.address == Address(unit);
    let found = modules.find(|(_, module)| is_it(&module.setup));
    found.map(|(name, module)| (name.as_str(), &module.setup))
}

/// The outputs that a write of coils switches.
fn write(
    config: &Arc<Config>,
    line: &str,
    unit: u8,
    request: &Request<'_>,
) -> Result<OutputWrite, Exception> {
    let (at, values) = match request {
        Request::WriteCoil { at, value } => (*at, vec![value.state().ok_or(Exception::VALUE)?]),
        Request::WriteCoils(block) => (block.start(), block.values().iter().collect()),
        _ => return Err(Exception::FUNCTION),
    };
    // A coil that is no output may do anything.
    let (module, setup) = module_at(config, line, unit).ok_or(Exception::FUNCTION)?;
    let first = first_output(setup).ok_or(Exception::FUNCTION)?;
    let count = usize::from(setup.count(PointKind::Output));
    let skip = usize::from(at.checked_sub(first).ok_or(Exception::FUNCTION)?);
    if skip + values.len() > count {
        return Err(Exception::FUNCTION);
    }
    let outputs = (0..count).skip(skip).zip(values);
    let set = outputs.map(|(index, is_on)| {
        let point = Point {
            kind: PointKind::Output,
            index: index as u8,
        };
        (point, is_on)
    });
    Ok(OutputWrite {
        module: module.into(),
        set: set.collect(),
        asked_by: Arc::clone(config),
    })
}

/// The coil of a module's first output.
fn first_output(setup: &Setup) -> Option<u16> {
    let module = Module::new(*setup).ok()?;
    match module.exchange(&Op::ReadOutputs).ok()? {
        Exchange::Rtu(rtu::Exchange {
            request: Request::ReadCoils(span),
            ..
        }) => Some(span.start()),
        _ => None,
    }
}

/// The exception for a command that was not done. What the master may not do at all, it is told
/// like any other request that does not pass.
pub(super) fn of_failure(failure: &CommandError) -> Exception {
    match failure {
        CommandError::Locked(_)
        | CommandError::NotAnOutput(_)
        | CommandError::RoleTooLow { .. }
        | CommandError::NotPermitted { .. }
        | CommandError::Limited(_) => Exception::FUNCTION,
        failure => ends::of_failure(failure).0,
    }
}
