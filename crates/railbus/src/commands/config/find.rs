//! Finds a module: where the configuration has it, or with factory settings.

use super::drive::Driver;
use crate::commands::Context;
use railbus_app::failure::Failure;
use railbus_app::settings::outcome;
use railbus_app::settings::target::Target;
use railbus_commission::{BusAddress, Found, ProcedureError, Search, look_up, read};
use railbus_device::Setup;

/// The result of a search.
pub(super) enum Located {
    /// The module was found.
    Here(Found),
    /// Nothing answered at any of the places.
    Missing,
}

/// Looks for a module at its place, then at other likely places, then at the factory's. Places of
/// other modules with the same protocol are left out.
pub(super) async fn locate(
    context: &Context,
    driver: &mut Driver<'_>,
    target: &Target,
    likely: &[BusAddress],
) -> Result<Located, Failure> {
    let failed = |trouble: &ProcedureError| outcome::trouble(context.lang, target, trouble);
    match driver.run(read(target.setup)).await {
        Ok(found) => return Ok(Located::Here(found)),
        Err(ProcedureError::NoReply(_)) => {}
        Err(trouble) => return Err(failed(&trouble)),
    }
    let fresh = Setup {
        protocol: target.setup.protocol,
        ..Setup::factory(target.setup.family)
    };
    let places: Vec<BusAddress> = likely
        .iter()
        .copied()
        .chain([BusAddress::of(&fresh)])
        .collect();
    let others = target
        .neighbours
        .iter()
        .filter(|other| other.protocol == target.setup.protocol);
    let search = Search {
        setup: target.setup,
        first: places,
        outwards: false,
        others: others.map(|other| other.place).collect(),
    };
    let (found, garbled) = driver
        .run(look_up(search))
        .await
        .map_err(|trouble| failed(&trouble))?;
    match found {
        // Read it again as at its own place: this checks that it is the right model.
        Some(found) => {
            let there = found.place.setup(&target.setup);
            let found = driver
                .run(read(there))
                .await
                .map_err(|trouble| failed(&trouble))?;
            Ok(Located::Here(found))
        }
        None if garbled => Err(failed(&ProcedureError::Garbled(BusAddress::of(&fresh)))),
        None => Ok(Located::Missing),
    }
}
