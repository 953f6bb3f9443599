//! Reads a module between the polls of its line, without delaying those of others.

use railbus_api::problem::{Problem, codes};
use railbus_app::api::failures;
use railbus_app::settings::outcome;
use railbus_app::settings::target::Target;
use railbus_commission::{
    BusAddress, DriverAction, Event, Found, ProcedureError, ProcedureStep, RxBytes, TimedExchange,
    read,
};
use railbus_host::ProbeResult;
use railbus_site::{RawTerms, Service};
use railbus_wire::{Exchange, Instant};
use railbus_words::Lang;
use std::time::Duration;
use tokio::time::Instant as Moment;

/// A request that takes this long waits for a silence that never comes.
const UNSENT_MAX: Duration = Duration::from_secs(10);

/// Reads everything that a module reports.
pub(super) async fn look(service: &Service, lang: Lang, target: &Target) -> Result<Found, Problem> {
    let start = Moment::now();
    let now = || Instant(u64::try_from(start.elapsed().as_micros()).unwrap_or(u64::MAX));
    let failed = |trouble: &ProcedureError| outcome::trouble(lang, target, trouble).to_problem();
    let mut procedure = read(target.setup);
    let mut event = Event::Begin;
    loop {
        event = match procedure.next(now(), event) {
            ProcedureStep::Done(end) => return end.map_err(|trouble| failed(&trouble)),
            ProcedureStep::Do(DriverAction::Ask(ask)) => match put(service, target, &ask).await? {
                Some(heard) => Event::Heard(heard),
                None => {
                    return Err(failed(&ProcedureError::Garbled(BusAddress::of(
                        &target.setup,
                    ))));
                }
            },
            ProcedureStep::Do(DriverAction::Wait(time)) => {
                tokio::time::sleep_until(Moment::now() + Duration::from_micros(time.0)).await;
                Event::Over
            }
            ProcedureStep::Do(DriverAction::Tell(_)) => Event::Over,
            // Reading writes nothing, and has no questions.
            ProcedureStep::Do(DriverAction::Journal(_)) => Event::Kept(false),
            ProcedureStep::Do(DriverAction::Confirm(_)) => Event::Answer(false),
        };
    }
}

/// A module's answer to one request; none if two modules answer.
async fn put(
    service: &Service,
    target: &Target,
    ask: &TimedExchange,
) -> Result<Option<RxBytes>, Problem> {
    let terms = RawTerms {
        settings: Some(ask.settings),
        gap: Some(ask.quiet),
        timeout: Some(ask.timeout),
        clear: false,
    };
    let met = send(service, target, ask.exchange, terms).await?;
    if met.late.iter().any(|late| late.again) {
        return Ok(None);
    }
    let bytes = match met.reply(&ask.exchange) {
        Some(own) => own.to_vec(),
        // What looks like a reply here is a part of another module's.
        None if ask.exchange.find_response(&met.bytes).1.whole().is_some() => return Ok(None),
        None => met.bytes,
    };
    Ok(Some(RxBytes {
        bytes,
        ..RxBytes::default()
    }))
}

/// Sends a read between the polls, and returns the reply.
pub(super) async fn send(
    service: &Service,
    target: &Target,
    exchange: Exchange<'static>,
    terms: RawTerms,
) -> Result<ProbeResult, Problem> {
    let line = target.line.as_str();
    let met = tokio::time::timeout(UNSENT_MAX, service.raw(line, exchange, terms)).await;
    let met = met.map_err(|_| {
        Problem::new(codes::SCAN_NOISE)
            .with("line", line)
            .with("module", target.name.as_str())
    })?;
    met.map_err(|failure| failures::of_line(service, line, &failure))
}
