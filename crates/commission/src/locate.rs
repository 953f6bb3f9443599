//! Looks for a module at a place: is it there, is it the expected model, and which settings has it
//! stored?

use super::context::{ProcedureContext, Reply};
use super::{BusAddress, Found, Kept, Procedure, ProcedureError, Progress, PulseSetup};
use railbus_device::{Holds, Module, Observation, Op, PulseTiming, Recognition, Setup};
use railbus_wire::rtu::{self, Request, WordSpan};
use railbus_wire::{Address, Decoded, Exchange, REPLY_TIMEOUT, Response, Words};

/// What was found at a place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LocateResult {
    /// The module.
    Clear(Found),
    /// Another model: what it says it is, if it says so.
    Wrong(Option<String>),
    /// Bytes that are not a valid reply: noise, another speed, or two modules at once.
    Garbled,
    /// Nothing.
    Silent,
}

/// The purpose of a look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LocatePurpose {
    /// Before a write: is it the expected model?
    First,
    /// After a write: where is it, and which settings has it?
    Again,
}

impl LocatePurpose {
    /// Number of attempts for a module that may be there. A repeated look covers several places,
    /// and comes back to each.
    const fn times(self) -> usize {
        match self {
            LocatePurpose::First => 3,
            LocatePurpose::Again => 1,
        }
    }
}

/// A procedure that reads everything a module reports, or says why it can't be read.
#[must_use]
pub fn read(setup: Setup) -> Procedure<Result<Found, ProcedureError>> {
    Procedure::new(move |context| async move {
        let place = BusAddress::of(&setup);
        context.tell(Progress::Reading(place)).await;
        first(&context, &setup, place).await
    })
}

/// The first look: whether the module is at its place, and is the expected model.
pub(crate) async fn first(
    context: &ProcedureContext,
    setup: &Setup,
    place: BusAddress,
) -> Result<Found, ProcedureError> {
    match look(context, setup, place, LocatePurpose::First).await? {
        LocateResult::Clear(_) if context.heard_twice() => Err(ProcedureError::Garbled(place)),
        LocateResult::Clear(found) => Ok(found),
        LocateResult::Wrong(told) => Err(ProcedureError::WrongModel(place, told)),
        LocateResult::Garbled => Err(ProcedureError::Garbled(place)),
        LocateResult::Silent => Err(ProcedureError::NoReply(place)),
    }
}

/// The first look before a write: whether nothing else answers there, not even later.
pub(crate) async fn first_alone(
    context: &ProcedureContext,
    setup: &Setup,
    place: BusAddress,
) -> Result<Found, ProcedureError> {
    let found = first(context, setup, place).await?;
    let module = Module::new(place.setup(setup)).map_err(super::NotWritable::Setup)?;
    context.linger();
    match context.op(&module, &Op::ReadOutputs).await? {
        _ if context.heard_twice() => Err(ProcedureError::Garbled(place)),
        Reply::Garbled => Err(ProcedureError::Garbled(place)),
        Reply::Said(_) | Reply::Silent => Ok(found),
    }
}

/// Looks at a place.
pub(crate) async fn look(
    context: &ProcedureContext,
    setup: &Setup,
    place: BusAddress,
    look: LocatePurpose,
) -> Result<LocateResult, ProcedureError> {
    let here = place.setup(setup);
    let Ok(module) = Module::new(here) else {
        return Ok(LocateResult::Silent);
    };
    match here.family.datasheet().recognition.of(here.protocol) {
        Recognition::ByName => by_name(context, &module, place, look).await,
        Recognition::ByRegisters => by_registers(context, &here, place, look).await,
        Recognition::ByBehaviour => by_behaviour(context, &module, place, look).await,
    }
}

/// What a reply to a first read shows.
fn sighted(reply: Reply, found: impl FnOnce(Observation) -> Option<Found>) -> LocateResult {
    match reply {
        Reply::Silent => LocateResult::Silent,
        Reply::Garbled => LocateResult::Garbled,
        Reply::Said(seen) => {
            found(seen).map_or(LocateResult::Wrong(name(&seen)), LocateResult::Clear)
        }
    }
}

/// The name or number that a module reports.
fn name(seen: &Observation) -> Option<String> {
    match seen {
        Observation::Name(text) => Some(text.as_str().to_owned()),
        Observation::Model(model) => Some(format!("{model:04X}")),
        _ => None,
    }
}

/// It identifies itself.
async fn by_name(
    context: &ProcedureContext,
    module: &Module,
    place: BusAddress,
    look: LocatePurpose,
) -> Result<LocateResult, ProcedureError> {
    if look == LocatePurpose::First {
        match context.read(module, &Op::Identify).await? {
            Reply::Said(seen) if module.recognises(&seen) && seen != Observation::Unexpected => {}
            other => return Ok(sighted(other, |_| None)),
        }
    }
    let mut found = Found::at(place);
    match context
        .read_times(module, &Op::ReadConfig, look.times())
        .await?
    {
        Reply::Said(Observation::Config {
            address,
            baud,
            character,
            checksum,
        }) => {
            found.told = Kept {
                address,
                baud,
                character,
                checksum,
                ..Kept::default()
            };
        }
        other => return Ok(sighted(other, |_| None)),
    }
    let sheet = module.setup().family.datasheet();
    if sheet.pulses == PulseTiming::Stored
        && let Reply::Said(Observation::Pulse { mask, width }) =
            context.read(module, &Op::ReadPulse).await?
    {
        // An older EDA9060 has no pulses and does not answer.
        found.told.pulse = Some(PulseSetup { mask, width });
    }
    Ok(LocateResult::Clear(found))
}

/// Whether the module at that place behaves as its datasheet says in all reads, and refuses what it
/// must refuse: this tells it from a board that merely supports more. A missing reply is requested
/// once more, and then proves nothing.
async fn behaves(
    context: &ProcedureContext,
    setup: &Setup,
    place: BusAddress,
) -> Result<bool, ProcedureError> {
    for sign in setup.family.signs() {
        let exchange = Exchange::rtu(place.address, sign.request);
        let mut shown = None;
        // Silence, too, counts only when it is confirmed.
        for _ in 0..2 {
            let heard = context.exchange(setup, exchange, REPLY_TIMEOUT).await?;
            let reply = exchange.find_response(&heard).1.whole();
            let reply = reply.as_ref().map(|reply| &reply.response);
            let spoilt = reply.is_none() && !heard.is_empty();
            shown = match spoilt {
                true => None,
                false => sign.shown_by(place.address, reply),
            };
            if reply.is_some() && shown.is_some() {
                break;
            }
        }
        if shown != Some(true) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// It reports its outputs. Its settings may or may not be readable [ERC-8 §2.5, EDA9050 §5.7].
async fn by_behaviour(
    context: &ProcedureContext,
    module: &Module,
    place: BusAddress,
    look: LocatePurpose,
) -> Result<LocateResult, ProcedureError> {
    match context
        .read_times(module, &Op::ReadOutputs, look.times())
        .await?
    {
        Reply::Said(Observation::Channels { .. }) => {}
        other => return Ok(sighted(other, |_| None)),
    }
    if look == LocatePurpose::First && !behaves(context, module.setup(), place).await? {
        return Ok(LocateResult::Wrong(None));
    }
    let mut found = Found::at(place);
    if module.exchange(&Op::ReadConfig).is_ok()
        && let Reply::Said(Observation::Config {
            address,
            baud,
            character,
            ..
        }) = context.read(module, &Op::ReadConfig).await?
    {
        found.told = Kept {
            address,
            baud,
            character,
            ..Kept::default()
        };
    }
    Ok(LocateResult::Clear(found))
}

/// All its registers at once.
async fn by_registers(
    context: &ProcedureContext,
    setup: &Setup,
    place: BusAddress,
    look: LocatePurpose,
) -> Result<LocateResult, ProcedureError> {
    let count = u16::try_from(setup.registers().len()).ok();
    let Some(span) = count.and_then(|count| WordSpan::new(0, count)) else {
        return Ok(LocateResult::Silent);
    };
    let exchange = Exchange::rtu(place.address, Request::ReadHoldingRegisters(span));
    let mut last = LocateResult::Silent;
    for _ in 0..look.times() {
        let heard = context.exchange(setup, exchange, REPLY_TIMEOUT).await?;
        last = match exchange.find_response(&heard).1 {
            Decoded::Whole { value, .. } => {
                let found = match value.response {
                    Response::Rtu(rtu::Response::Words(words)) => told_by(setup, place, &words),
                    _ => None,
                };
                let Some(found) = found else {
                    return Ok(LocateResult::Wrong(None));
                };
                if look == LocatePurpose::First && !behaves(context, setup, place).await? {
                    return Ok(LocateResult::Wrong(None));
                }
                return Ok(LocateResult::Clear(found));
            }
            _ if heard.is_empty() => last,
            _ => LocateResult::Garbled,
        };
    }
    Ok(last)
}

fn told_by(setup: &Setup, place: BusAddress, words: &Words<'_>) -> Option<Found> {
    let (profile, sheet) = (setup.family.profile(), setup.family.datasheet());
    let word = |holds| words.get(sheet.register(holds)?);
    let code = |holds| u8::try_from(word(holds)?).ok();
    Some(Found {
        told: Kept {
            address: code(Holds::Address).map(Address),
            baud: code(Holds::Baud).and_then(|code| profile.baud_of(code)),
            character: code(Holds::Parity).and_then(|code| profile.character_of(code)),
            voltage: word(Holds::Voltage),
            ..Kept::default()
        },
        version: word(Holds::Version),
        // Bits 3 to 15 have no meaning [EMD-2A2Q §5.2].
        busy: word(Holds::Calibration)? & 0b111 != 0,
        analogs: Some([word(Holds::Analog(0))?, word(Holds::Analog(1))?]),
        ..Found::at(place)
    })
}

/// Looks at several places, one after the other, until the module is found: three rounds, since a
/// reply may be lost.
pub(crate) async fn find(
    context: &ProcedureContext,
    setup: &Setup,
    places: &[BusAddress],
    rounds: usize,
) -> Result<(Option<Found>, bool), ProcedureError> {
    let mut garbled = false;
    for _ in 0..rounds {
        for place in places {
            context.tell(Progress::Looking(*place)).await;
            match look(context, setup, *place, LocatePurpose::Again).await? {
                LocateResult::Clear(found) => return Ok((Some(found), garbled)),
                LocateResult::Garbled => garbled = true,
                LocateResult::Wrong(_) | LocateResult::Silent => {}
            }
        }
    }
    Ok((None, garbled))
}
