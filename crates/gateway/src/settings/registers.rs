//! `GET /api/v1/modules/{module}/registers`: what a module reports, byte for byte. Each read is
//! sent between the polls of its line, and repeated if there is no good reply.

use super::look::send;
use super::settings_request::SettingsRequest;
use railbus_api::problem::Problem;
use railbus_api::settings::{Cell, RegisterRead, Registers};
use railbus_api::types::SCHEMA;
use railbus_app::api::convert;
use railbus_app::frames::meaning;
use railbus_app::settings::outcome;
use railbus_app::settings::target::Target;
use railbus_commission::{BusAddress, ProcedureError};
use railbus_device::{Module, Op, Point, PointKind, Setup};
use railbus_host::Probed;
use railbus_site::RawTerms;
use railbus_wire::rtu::{Request, Response as RtuResponse, WordSpan};
use railbus_wire::{Exchange, Frame, Response};
use railbus_words::Lang;
use railbus_words::hex;

impl SettingsRequest {
    /// Reads the registers of the module.
    pub(super) async fn registers(&self) -> Result<Registers, Problem> {
        let target = self.target()?;
        let mut reads = Vec::new();
        for exchange in exchanges(&target.setup) {
            reads.push(self.read(&target, exchange).await?);
        }
        if reads.iter().all(|read| read.bytes.is_empty()) {
            let trouble = ProcedureError::NoReply(BusAddress::of(&target.setup));
            return Err(outcome::trouble(self.lang, &target, &trouble).to_problem());
        }
        Ok(Registers {
            schema: SCHEMA,
            module: target.name,
            protocol: target.setup.protocol.name().to_owned(),
            reads,
        })
    }

    async fn read(
        &self,
        target: &Target,
        exchange: Exchange<'static>,
    ) -> Result<RegisterRead, Problem> {
        let terms = RawTerms {
            settings: Some(target.setup.serial),
            ..RawTerms::default()
        };
        let mut met = send(&self.service, target, exchange, terms).await?;
        if met.outcome == Probed::Garbled {
            // It may have been only the late reply of another module.
            met = send(&self.service, target, exchange, terms).await?;
        }
        let mut frame = Frame::new();
        exchange.encode(&mut frame);
        let own = met.reply(&exchange);
        let reply = own.and_then(|own| exchange.decode_response(own).whole());
        let reply = reply.map(|reply| reply.response);
        let says = reply.map(|reply| meaning::response(self.lang, &exchange, &reply));
        let cells = reply.map(|reply| cells(self.lang, &target.setup, &exchange, &reply));
        Ok(RegisterRead {
            sent: hex::spaced(frame.bytes()),
            meaning: meaning::request(self.lang, &exchange),
            bytes: hex::spaced(own.unwrap_or(&met.bytes)),
            says,
            after_ms: convert::millis_tenths(met.after),
            cells: cells.unwrap_or_default(),
        })
    }
}

/// All reads of a module.
fn exchanges(setup: &Setup) -> Vec<Exchange<'static>> {
    let Ok(module) = Module::new(*setup) else {
        return Vec::new();
    };
    let whole = u16::try_from(setup.registers().len()).ok();
    let whole = whole.and_then(|count| WordSpan::new(0, count));
    let whole = whole.map(|span| Exchange::rtu(setup.address, Request::ReadHoldingRegisters(span)));
    let mut ops = vec![Op::ReadOutputs, Op::ReadInputs];
    if whole.is_none() {
        ops.extend([Op::Identify, Op::ReadConfig, Op::ReadPulse]);
    }
    let mut all = Vec::new();
    for exchange in ops.iter().filter_map(|op| module.exchange(op).ok()) {
        if !all.contains(&exchange) {
            all.push(exchange);
        }
    }
    all.extend(whole);
    all
}

/// The content of a reply, coil by coil and register by register.
fn cells(lang: Lang, setup: &Setup, asked: &Exchange<'_>, reply: &Response<'_>) -> Vec<Cell> {
    let (Exchange::Rtu(asked), Response::Rtu(reply)) = (asked, reply) else {
        return Vec::new();
    };
    match (asked.request, reply) {
        (Request::ReadCoils(span), RtuResponse::Bits(bits)) => bits_of(
            setup,
            PointKind::Output,
            "coil",
            span.start(),
            bits.to_mask(),
        ),
        (Request::ReadDiscreteInputs(span), RtuResponse::Bits(bits)) => bits_of(
            setup,
            PointKind::Input,
            "discrete",
            span.start(),
            bits.to_mask(),
        ),
        (Request::ReadHoldingRegisters(span), RtuResponse::Words(values)) => {
            let known = (0_u16..).zip(setup.registers());
            let known = known.filter_map(|(at, register)| Some((at, register, values.get(at)?)));
            known
                .map(|(at, register, value)| Cell {
                    kind: "holding".to_owned(),
                    at: span.start() + at,
                    name: lang.of(register.name).to_owned(),
                    fact: Some(register.fact.to_owned()),
                    value,
                })
                .collect()
        }
        _ => Vec::new(),
    }
}

/// One cell for each point of a kind, from the first address on.
fn bits_of(setup: &Setup, kind: PointKind, name: &str, first: u16, mask: u32) -> Vec<Cell> {
    let points = setup.points().filter(|point| point.kind == kind);
    let cell = |point: Point| {
        let (letters, number) = setup.label(point);
        Cell {
            kind: name.to_owned(),
            at: first + u16::from(point.index),
            name: format!("{letters}{number}"),
            fact: None,
            value: u16::from(mask >> point.index & 1 == 1),
        }
    };
    points.map(cell).collect()
}
