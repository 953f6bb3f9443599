//! Checks that nothing answers at an address before a module is moved there.

use super::context::{ProcedureContext, carried};
use super::{BusAddress, Neighbour, ProcedureError, Progress};
use railbus_bus::LATE_MIN;
use railbus_device::Setup;
use railbus_wire::rtu::{BitSpan, Request};
use railbus_wire::{
    Address, Exchange, Micros, Protocol, REPLY_TIMEOUT, SerialSettings, ascii, lc02, r55,
};

/// Timeout of a reply, the same as on the line itself.
const PATIENCE: Micros = LATE_MIN;
/// Timeout of the last check, in the module's own protocol: as long as the line waits for a module
/// that never answered. A module slower than this is not noticed, nor is one that is slower than
/// [`PATIENCE`], speaks another protocol and gives up its reply when another request is sent.
const PATIENCE_LAST: Micros = Micros(3 * REPLY_TIMEOUT.0);

/// The address is in use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Taken {
    /// Where.
    pub place: BusAddress,
    /// In which protocol.
    pub protocol: Protocol,
    /// The reply was not valid: there may be two already.
    pub garbled: bool,
    /// The configured module there, if any.
    pub module: Option<String>,
}

/// Refuses an address at which something answers, in any protocol, with any of these settings. A
/// known neighbour that speaks another protocol does not matter: it is where it should be.
pub(crate) async fn check(
    context: &ProcedureContext,
    setup: &Setup,
    address: Address,
    serials: &[SerialSettings],
    neighbours: &[Neighbour],
) -> Result<(), ProcedureError> {
    // A neighbour may be switched off at the moment.
    let absent = neighbours.iter().find(|neighbour| {
        neighbour.protocol == setup.protocol && neighbour.place.address == address
    });
    if let Some(neighbour) = absent {
        return Err(ProcedureError::Taken(Taken {
            place: neighbour.place,
            protocol: neighbour.protocol,
            garbled: false,
            module: Some(neighbour.name.clone()),
        }));
    }
    for serial in serials {
        let place = BusAddress {
            address,
            serial: *serial,
            checksum: false,
        };
        context.tell(Progress::Vacancy(place)).await;
        let mut first = true;
        for exchange in probes(address, setup.protocol) {
            let known = neighbours.iter().find(|neighbour| {
                neighbour.place.address == address && neighbour.protocol == exchange.protocol()
            });
            let expected = known.is_some() && exchange.protocol() != setup.protocol;
            if expected || carried(&exchange).is_some() {
                continue;
            }
            let there = Setup {
                serial: *serial,
                ..*setup
            };
            // Its own protocol once more, in case the first was lost.
            let own = exchange.protocol() == setup.protocol;
            let waits = if own {
                &[PATIENCE, PATIENCE_LAST][..]
            } else {
                &[PATIENCE]
            };
            for patience in waits {
                let heard = context.exchange(&there, exchange, *patience).await?;
                let late = !std::mem::take(&mut first) && context.heard_late();
                if late || !heard.is_empty() {
                    return Err(ProcedureError::Taken(Taken {
                        place,
                        protocol: exchange.protocol(),
                        garbled: exchange.find_response(&heard).1.whole().is_none(),
                        module: known.map(|neighbour| neighbour.name.clone()),
                    }));
                }
            }
        }
    }
    Ok(())
}

/// One read for each protocol, which every known family answers: over Modbus, with eight coils or
/// with an exception. The module's own protocol comes last: nothing interrupts its reply.
fn probes(address: Address, own: Protocol) -> Vec<Exchange<'static>> {
    let coils = BitSpan::new(0, 8).map(Request::ReadCoils);
    let modbus = coils
        .filter(|_| address.0 != 0)
        .map(|coils| Exchange::rtu(address, coils));
    let board = (address != r55::BROADCAST && address.0 != 0)
        .then(|| Exchange::r55(address, r55::Request::ReadState));
    let eda = [
        Exchange::ascii(address, false, ascii::Request::ReadName),
        Exchange::ascii(address, true, ascii::Request::ReadName),
        Exchange::lc02(address, lc02::Request::ReadConfig),
    ];
    let mut probes: Vec<Exchange<'_>> = eda.into_iter().chain(modbus).chain(board).collect();
    probes.sort_by_key(|exchange| exchange.protocol() == own);
    probes
}

/// A procedure that checks whether an address is free in every protocol.
#[must_use]
pub fn vacant(
    setup: Setup,
    address: Address,
    neighbours: Vec<Neighbour>,
) -> super::Procedure<Result<(), ProcedureError>> {
    super::Procedure::new(move |context| async move {
        check(&context, &setup, address, &[setup.serial], &neighbours).await
    })
}
