//! How well modules hear that can say so: the counters of Modbus, function 08 [BEYOND §4].

use super::finding::{Finding, Section};
use super::texts::FindingText;
use railbus_host::{Line, Module, Probe};
use railbus_wire::rtu::{Identification, Request, Response, diagnosis};
use railbus_wire::{Address, Exchange, Micros, Protocol, REPLY_TIMEOUT};
use railbus_words::Lang;

/// How long a module is waited for that has just answered.
const PATIENCE: Micros = REPLY_TIMEOUT;
/// The bit of the diagnostic register that a tripped host watchdog sets [BEYOND §1.8].
const TRIPPED: u16 = 0x04;
/// Fewer than one frame in so many may fail to arrive whole.
const FEW: u32 = 100;

/// What a module reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Hearing {
    /// Its host watchdog has tripped. Of another maker's module nothing is said of that: its
    /// diagnostic register means something else.
    tripped: bool,
    messages: u16,
    errors: u16,
    overruns: u16,
}

/// Asks a module that has answered; nothing where it has no counters, as modules of the makers'.
pub(super) async fn ask(line: &Line, module: &Module) -> Option<Hearing> {
    if module.setup().protocol != Protocol::Rtu {
        return None;
    }
    let counter = |nth| diagnosis::FIRST_COUNTER + nth;
    let register = one(line, module, diagnosis::REGISTER).await?;
    let hearing = Hearing {
        tripped: register & TRIPPED != 0 && is_ours(line, module).await,
        messages: one(line, module, counter(0)).await?,
        errors: one(line, module, counter(1)).await?,
        overruns: one(line, module, counter(7)).await?,
    };
    // It has heard the question at least: an adapter that sends back what it is sent says 0.
    (hearing.messages > 0).then_some(hearing)
}

async fn one(line: &Line, module: &Module, sub: u16) -> Option<u16> {
    let reply = reply_to(line, module, Request::Diagnose { sub, data: 0 }).await?;
    match reply.0.find_response(&reply.1).1.whole()?.response {
        railbus_wire::Response::Rtu(Response::Diagnosis(value)) => Some(value),
        _ => None,
    }
}

/// Whether it says that it runs our firmware [BEYOND §5.1].
async fn is_ours(line: &Line, module: &Module) -> bool {
    let request = Request::Identify { code: 1, object: 0 };
    let Some((exchange, bytes)) = reply_to(line, module, request).await else {
        return false;
    };
    match exchange.find_response(&bytes).1.whole().map(|r| r.response) {
        Some(railbus_wire::Response::Rtu(Response::Identification(says))) => {
            says.object(Identification::VENDOR) == Some(b"railbus")
        }
        _ => false,
    }
}

/// What came back, and to what.
async fn reply_to(
    line: &Line,
    module: &Module,
    request: Request<'static>,
) -> Option<(Exchange<'static>, Vec<u8>)> {
    let setup = module.setup();
    let exchange = Exchange::rtu(setup.address, request);
    let probe = Probe {
        exchange,
        settings: setup.serial,
        gap: setup.request_gap(),
        timeout: PATIENCE,
        clear: false,
        changes: false,
        as_module: false,
    };
    let result = line.probe(probe).await.ok()?;
    Some((exchange, result.bytes))
}

/// What a module's counters mean. Frames of other protocols count as broken: where there are
/// such on its line, their number says nothing.
pub(super) fn judge(
    lang: Lang,
    (name, at): (&str, Address),
    only_modbus: bool,
    hearing: Hearing,
) -> Vec<Finding> {
    let Hearing {
        tripped,
        messages,
        errors,
        overruns,
    } = hearing;
    let values: &[(&str, &dyn std::fmt::Display)] = &[
        ("module", &name),
        ("address", &at),
        ("messages", &messages),
        ("errors", &errors),
        ("overruns", &overruns),
    ];
    let text = lang.fill(FindingText::Hears, values);
    let all = u32::from(messages) + u32::from(errors);
    let poorly = only_modbus && u32::from(errors) * FEW > all || overruns > 0;
    let heard = match poorly {
        true => Finding::warning(Section::Modules, "D305", text),
        false => Finding::good(Section::Modules, text),
    };
    let locked = Finding::error(Section::Modules, "D306", name.to_owned());
    [Some(heard), tripped.then_some(locked)]
        .into_iter()
        .flatten()
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_errors_are_none_and_a_lost_character_is_one() {
        let told = |only_modbus, tripped, messages, errors, overruns| {
            let hearing = Hearing {
                tripped,
                messages,
                errors,
                overruns,
            };
            let found = judge(Lang::En, ("oven", Address(3)), only_modbus, hearing);
            assert!(found[0].detail.contains(&format!("{messages} frames")));
            let codes = found.iter().map(|finding| finding.code.unwrap_or("ok"));
            codes.collect::<Vec<_>>().join(" ")
        };
        assert_eq!(told(true, false, 1_000, 0, 0), "ok");
        assert_eq!(told(true, false, 9_900, 100, 0), "ok");
        assert_eq!(told(true, false, 9_899, 101, 0), "D305");
        assert_eq!(told(false, false, 9_899, 101, 0), "ok");
        assert_eq!(told(false, false, 1_000, 0, 1), "D305");
        assert_eq!(told(true, true, 1, 0xFFFF, 0), "D305 D306");
    }
}
