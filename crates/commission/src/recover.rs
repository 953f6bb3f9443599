//! Finds a module whose change was interrupted, or that is not where it should be. It only reads.

use super::change::{candidates, evidence};
use super::context::ProcedureContext;
use super::locate::{LocatePurpose, find, look};
use super::place::{BusAddress, Found, Kept};
use super::stages::WriteStep;
use super::{
    ChangeOrigin, JournalRecord, LocateResult, Procedure, ProcedureError, Progress, RecordState,
};
use crate::settings::Wanted;
use railbus_device::{SettingWrite, Setup};
use railbus_wire::{Address, Protocol, SerialSettings};

/// Where a module is looked for.
#[derive(Clone, Debug)]
pub struct Search {
    /// What it is.
    pub setup: Setup,
    /// The likeliest places, most likely first.
    pub first: Vec<BusAddress>,
    /// Then every speed, parity and checksum state of the family at those addresses, then the
    /// factory settings, then all its addresses at those speeds.
    pub outwards: bool,
    /// Places of other modules, which must not be mistaken for it.
    pub others: Vec<BusAddress>,
}

/// The result of a recovery.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Recovered {
    /// It has the new values.
    New(Found),
    /// It has the old values.
    Old(Found),
    /// It acknowledged the new values and applies them at its next power-up.
    Pending(Found),
    /// It has other values.
    Else(Found),
    /// It is there, and does not report whether this was done: a calibration can't be read.
    Untold(Found),
    /// It was not found; whether two modules seemed to answer at once.
    Nowhere(bool),
}

/// A procedure that finds out the result of an open change, and journals it: with the change's last
/// record, and the places that its earlier ones name.
#[must_use]
pub fn recover(
    intent: JournalRecord,
    earlier: Vec<BusAddress>,
    setup: Setup,
    outwards: bool,
    others: Vec<BusAddress>,
) -> Procedure<Result<Recovered, ProcedureError>> {
    Procedure::new(move |context| async move {
        let (Some(from), Some(to)) = (intent.from.place(), intent.to.place()) else {
            return Err(ProcedureError::Journal(false));
        };
        let stage = stage_of(&intent, &setup, from, to);
        let search = Search {
            setup,
            first: candidates(stage.to, stage.from, &earlier),
            outwards,
            others,
        };
        let (found, garbled) = seek(&context, &search).await?;
        let untold =
            matches!(intent.by, ChangeOrigin::Calibrate | ChangeOrigin::Factory) && from == to;
        let recovered = match found {
            None => Recovered::Nowhere(garbled),
            Some(found) if untold => Recovered::Untold(found),
            Some(found) => judge(&stage, found),
        };
        let (state, found) = match &recovered {
            Recovered::New(found) => (RecordState::Done, Some(found)),
            Recovered::Old(found) => (RecordState::Unchanged, Some(found)),
            Recovered::Pending(found) => (RecordState::Pending, Some(found)),
            Recovered::Else(found) => (RecordState::Elsewhere, Some(found)),
            Recovered::Untold(found) => (RecordState::Untold, Some(found)),
            Recovered::Nowhere(_) => (RecordState::Lost, None),
        };
        let ended = JournalRecord {
            by: ChangeOrigin::Recover,
            ..intent.ended(state, found)
        };
        context.journal(ended).await?;
        Ok(recovered)
    })
}

/// A procedure that looks for a module.
#[must_use]
pub fn look_up(search: Search) -> Procedure<Result<(Option<Found>, bool), ProcedureError>> {
    Procedure::new(move |context| async move { seek(&context, &search).await })
}

/// The step as recorded in the journal: which values are the old ones, and which the new.
fn stage_of(intent: &JournalRecord, setup: &Setup, from: BusAddress, to: BusAddress) -> WriteStep {
    let mut stage = WriteStep {
        // Which write it was does not matter for finding the module.
        change: SettingWrite::Address(to.address),
        before: Kept::at(from),
        from,
        after: Kept::at(to),
        to,
    };
    let side = |at: usize| {
        let mut wanted = Wanted::default();
        for (name, values) in &intent.set {
            let value = values.get(at).map(String::as_str).unwrap_or_default();
            // An unknown value, `?`, is left out.
            let _ = wanted.set(setup, name, value);
        }
        wanted
    };
    let filled = |wanted: Wanted, place: BusAddress| {
        let unknown = super::PulseSetup {
            mask: 0,
            width: railbus_wire::PulseWidth::DEFAULT,
        };
        let known = Kept {
            pulse: Some(unknown),
            ..Kept::default()
        };
        let mut kept = wanted.over(&known).unwrap_or_default().or(Kept::at(place));
        // In the other protocols the place does not show whether ASCII frames would carry a
        // checksum.
        kept.checksum = kept.checksum.filter(|_| setup.protocol == Protocol::Ascii);
        kept
    };
    stage.before = filled(side(0), from);
    stage.after = filled(side(1), to);
    stage
}

/// What a module that was found shows about the change. Of the pulses only what changed is
/// compared: the journal has no more.
fn judge(stage: &WriteStep, found: Found) -> Recovered {
    let at = |place: BusAddress, kept: &Kept| found.place == place && settles(stage, kept, &found);
    if at(stage.to, &stage.after) {
        Recovered::New(found)
    } else if found.place == stage.from
        && stage.from != stage.to
        && evidence(stage, &found.told) == (false, false)
    {
        // It reports nothing of what may have been written: it may be applied at the next power-up.
        Recovered::Untold(found)
    } else if at(stage.from, &stage.before) {
        Recovered::Old(found)
    } else if stage.from != stage.to && evidence(stage, &found.told) == (true, false) {
        Recovered::Pending(found)
    } else {
        Recovered::Else(found)
    }
}

/// Whether what the module reports matches these settings, as far as the change is about them.
fn settles(stage: &WriteStep, kept: &Kept, found: &Found) -> bool {
    let pulse = match (stage.before.pulse, stage.after.pulse) {
        (Some(before), Some(after)) => {
            let changed = before.mask ^ after.mask;
            found.told.pulse.is_some_and(|told| {
                let wanted = kept.pulse.unwrap_or(told);
                let width = before.width == after.width || told.width == wanted.width;
                (told.mask ^ wanted.mask) & changed == 0 && width
            })
        }
        _ => true,
    };
    let voltage = stage.before.voltage == stage.after.voltage || found.told.voltage == kept.voltage;
    let rest = Kept {
        pulse: None,
        voltage: None,
        ..*kept
    };
    pulse && voltage && found.told.agrees(&rest)
}

/// The likeliest places, then outwards.
async fn seek(
    context: &ProcedureContext,
    search: &Search,
) -> Result<(Option<Found>, bool), ProcedureError> {
    let near: Vec<BusAddress> = of_this(search, search.first.clone());
    let (found, mut garbled) = find(context, &search.setup, &near, 3).await?;
    // Two modules are where it should be: there is no need to search further.
    if found.is_some() || garbled || !search.outwards {
        return Ok((found, garbled));
    }
    for place in of_this(search, outwards(search)) {
        if near.contains(&place) {
            continue;
        }
        if context.stopped() {
            return Err(ProcedureError::Stopped);
        }
        context.tell(Progress::Looking(place)).await;
        match look(context, &search.setup, place, LocatePurpose::Again).await? {
            LocateResult::Clear(found) => return Ok((Some(found), garbled)),
            LocateResult::Garbled => garbled = true,
            LocateResult::Wrong(_) | LocateResult::Silent => {}
        }
    }
    Ok((None, garbled))
}

/// Leaves out the places of other modules.
fn of_this(search: &Search, mut places: Vec<BusAddress>) -> Vec<BusAddress> {
    places.retain(|place| !search.others.contains(place));
    places
}

/// Every place worth trying, nearer ones first.
fn outwards(search: &Search) -> Vec<BusAddress> {
    let profile = search.setup.family.profile();
    let mut places = Vec::new();
    let mut add = |place: BusAddress| {
        let possible = place.setup(&search.setup).check().is_ok();
        if possible && !places.contains(&place) {
            places.push(place);
        }
    };
    let factory = Setup::factory(search.setup.family);
    add(BusAddress::of(&factory));
    for near in &search.first {
        for (_, baud) in profile.bauds {
            for (_, character) in profile.characters {
                for checksum in [near.checksum, !near.checksum] {
                    let serial = SerialSettings {
                        baud: *baud,
                        character: *character,
                    };
                    add(BusAddress {
                        address: near.address,
                        serial,
                        checksum,
                    });
                }
            }
        }
    }
    let (low, high) = profile.addresses;
    let nearest: Vec<BusAddress> = search
        .first
        .iter()
        .copied()
        .chain([BusAddress::of(&factory)])
        .collect();
    for near in nearest {
        for address in low..=high {
            add(BusAddress {
                address: Address(address),
                ..near
            });
        }
    }
    places
}
