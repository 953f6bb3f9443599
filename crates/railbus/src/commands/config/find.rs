//! Where a module is: where the configuration has it, or else where one fresh from the factory is.

use super::drive::Driver;
use crate::commands::Context;
use railbus_app::failure::Failure;
use railbus_app::settings::outcome;
use railbus_app::settings::target::Target;
use railbus_commission::{Found, Place, Search, Trouble, look_up, read};
use railbus_device::Setup;
use railbus_wire::Address;

/// What was found of a module.
pub(super) enum Located {
    /// The module.
    Here(Found),
    /// Nobody at any of these places.
    Missing,
}

/// Looks for a module at its place, then at others that are likely, then at that of the factory.
/// Places where a neighbour of the same protocol should be are not looked at.
pub(super) async fn locate(
    context: &Context,
    driver: &mut Driver<'_>,
    target: &Target,
    likely: &[Place],
) -> Result<Located, Failure> {
    let failed = |trouble: &Trouble| outcome::trouble(context.lang, target, trouble);
    match driver.run(read(target.setup)).await {
        Ok(found) => return Ok(Located::Here(found)),
        Err(Trouble::NoReply(_)) => {}
        Err(trouble) => return Err(failed(&trouble)),
    }
    let fresh = Setup {
        protocol: target.setup.protocol,
        ..Setup::new(target.setup.family, FACTORY)
    };
    let places: Vec<Place> = likely.iter().copied().chain([Place::of(&fresh)]).collect();
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
        // Once more as at the first look: is it the model that it should be?
        Some(found) => {
            let there = found.place.setup(&target.setup);
            let found = driver
                .run(read(there))
                .await
                .map_err(|trouble| failed(&trouble))?;
            Ok(Located::Here(found))
        }
        None if garbled => Err(failed(&Trouble::Garbled(Place::of(&fresh)))),
        None => Ok(Located::Missing),
    }
}

/// The address that every family leaves the factory with.
const FACTORY: Address = Address(1);
