//! The scan itself.

use super::asked::Asked;
use super::identify::{self, Answer, Identity};
use super::plan::{Ask, Scope, follow_ups};
use super::show;
use crate::commands::Context;
use crate::commands::place::Place;
use crate::commands::stop::Stop;
use crate::failure::Failure;
use crate::render::Format;
use crate::render::out;
use railbus_host::{Probe, ProbeResult, Probed};
use railbus_wire::{Address, Micros, Protocol};
use std::io::IsTerminal;
use std::ops::ControlFlow;

/// How long a reply may take to begin. A module that is there answers within 30 ms.
const TIMEOUT: Micros = Micros::from_millis(60);
/// The silence before a question: in Modbus the longest that any of the families wants, that of
/// the ERC-8.
const fn gap(protocol: Protocol) -> Micros {
    match protocol {
        Protocol::Rtu => Micros::from_millis(20),
        Protocol::Ascii | Protocol::Lc02 | Protocol::R55 => Micros::from_millis(5),
    }
}

/// How often a module whose reply is garbled is asked.
const TRIES: usize = 3;

/// What a module's answers amount to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Ok,
    /// It answers no, which is a sign of life, too.
    Refused,
    /// It answers, but what it is can't be told.
    Odd,
    /// Something is there, but no reply of it is good.
    Garbled,
}

impl Verdict {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Verdict::Ok => "ok",
            Verdict::Refused => "refused",
            Verdict::Odd => "odd",
            Verdict::Garbled => "garbled",
        }
    }
}

/// A module that was found.
#[derive(Clone, Debug)]
pub(super) struct Found {
    pub(super) address: Address,
    pub(super) protocol: Protocol,
    pub(super) checksum: bool,
    pub(super) identity: Identity,
    pub(super) rtt: Micros,
    pub(super) verdict: Verdict,
    pub(super) evidence: Vec<Answer>,
}

/// What a scan met.
#[derive(Clone, Debug, Default)]
pub(super) struct Report {
    pub(super) found: Vec<Found>,
    pub(super) probes: usize,
    /// Probes that nothing came back to.
    pub(super) silent: usize,
    pub(super) skipped: usize,
    pub(super) complete: bool,
}

/// Asks everyone, until all were asked or it is stopped.
pub(super) async fn scan(
    context: &Context,
    place: &Place,
    asked: Asked,
    scope: &Scope,
    stop: &mut Stop,
) -> Result<Report, Failure> {
    let mut scanner = Scanner {
        context,
        place,
        asked: &asked,
        report: Report::default(),
        total: scope.asks().len() * scope.addresses.len(),
    };
    let end = stop.or(scanner.all(scope)).await;
    let mut report = scanner.report;
    asked.close().await;
    report.complete = end.transpose()?.is_some();
    report
        .found
        .sort_by_key(|found| (found.address, found.protocol));
    Ok(report)
}

struct Scanner<'s> {
    context: &'s Context,
    place: &'s Place,
    asked: &'s Asked,
    report: Report,
    total: usize,
}

impl Scanner<'_> {
    async fn all(&mut self, scope: &Scope) -> Result<(), Failure> {
        for ask in scope.asks() {
            for address in &scope.addresses {
                self.progress();
                let address = Address(*address);
                if self.knows(ask, address) {
                    self.total -= 1;
                    continue;
                }
                if let Some(found) = self.one(ask, address).await? {
                    let shown = show::event(self.place, &found);
                    self.report.found.push(found);
                    if self.context.format == Format::Ndjson
                        && let ControlFlow::Break(()) = out::put(self.context.lang, &shown)?
                    {
                        return Ok(());
                    }
                }
            }
        }
        Ok(())
    }

    /// Whether a module was found there in this protocol already.
    fn knows(&self, ask: Ask, address: Address) -> bool {
        let known = |found: &Found| found.address == address && found.protocol == ask.protocol();
        self.report.found.iter().any(known)
    }

    /// Asks one address; once more, and more, where something answers.
    async fn one(&mut self, ask: Ask, address: Address) -> Result<Option<Found>, Failure> {
        let Some(first) = self.probe(ask, address).await? else {
            return Ok(None);
        };
        let mut met = first;
        let mut tries = 1;
        while met.outcome == Probed::Garbled && tries < TRIES {
            tries += 1;
            if let Some(again) = self.probe(ask, address).await? {
                met = again;
            }
        }
        let rtt = met.after;
        let checksum = ask == Ask::AsciiName(true);
        let garbled = met.outcome == Probed::Garbled;
        if matches!(met.outcome, Probed::Silent | Probed::Unsafe) {
            return Ok(None);
        }
        let mut evidence = vec![(ask, met.bytes)];
        if !garbled {
            for next in follow_ups(ask) {
                evidence.push((*next, self.ask_again(*next, address).await?));
            }
        }
        let identity = match garbled {
            true => Identity::default(),
            false => identify::identify(address, &evidence),
        };
        let verdict = match &identity {
            _ if garbled => Verdict::Garbled,
            Identity { model: Some(_), .. } => Verdict::Ok,
            Identity { refused: true, .. } => Verdict::Refused,
            Identity { .. } => Verdict::Odd,
        };
        Ok(Some(Found {
            address,
            protocol: ask.protocol(),
            checksum,
            identity,
            rtt,
            verdict,
            evidence,
        }))
    }

    /// A question to a module that is there: its silence counts only when it is silent again.
    async fn ask_again(&mut self, ask: Ask, address: Address) -> Result<Vec<u8>, Failure> {
        for _ in 1..TRIES {
            let met = self.probe(ask, address).await?;
            if let Some(met) = met.filter(|met| met.outcome == Probed::Answered) {
                return Ok(met.bytes);
            }
        }
        Ok(Vec::new())
    }

    /// One question; nothing where it must not be asked.
    async fn probe(&mut self, ask: Ask, address: Address) -> Result<Option<ProbeResult>, Failure> {
        let Some(exchange) = ask.safe_exchange(address) else {
            self.report.skipped += 1;
            return Ok(None);
        };
        self.report.probes += 1;
        let probe = Probe {
            exchange,
            settings: self.place.settings,
            gap: gap(ask.protocol()),
            timeout: self.context.timeout.unwrap_or(TIMEOUT),
            clear: false,
        };
        let met = self.asked.probe(self.context, self.place, probe).await?;
        if met.outcome == Probed::Silent {
            self.report.silent += 1;
        }
        Ok(Some(met))
    }

    /// How far it is, where somebody watches.
    fn progress(&self) {
        if self.context.quiet || !std::io::stderr().is_terminal() {
            return;
        }
        let done = self.report.probes + self.report.skipped;
        show::progress(self.context.lang, done, self.total, self.report.found.len());
    }
}
