//! Sends a scan's requests: on a line opened here, or through the daemon that has the line. The
//! daemon sends them between its own polls.

use crate::backend::Backend;
use crate::commands::Context;
use crate::commands::place::{Place, port_failure};
use railbus_api::sending::{LateAnswer, SendRequest};
use railbus_api::types::Outcome;
use railbus_app::failure::Failure;
use railbus_app::scan::met;
use railbus_commission::read_request;
use railbus_commission::scan::ProbeOutcome;
use railbus_host::{LateReply, Line, LineOptions, Probe, Probed};
use railbus_wire::{Frame, Micros, Protocol};
use railbus_words::Code;
use railbus_words::hex;

/// What sends the requests.
pub(super) enum Asked {
    /// A line opened here.
    Line(Line),
    /// The daemon has it.
    Daemon(Backend),
}

impl Asked {
    /// Opens the line.
    pub(super) async fn open(context: &Context, place: &Place) -> Result<Asked, Failure> {
        let mut config = LineOptions::new(place.port.clone());
        config.serial.settings = place.settings;
        let failed = |error| port_failure(context, place, &error);
        let line = Line::open(config).map_err(failed)?;
        line.opened().await.map_err(failed)?;
        Ok(Asked::Line(line))
    }

    /// Sends one request and returns its outcome.
    pub(super) async fn probe(
        &self,
        context: &Context,
        place: &Place,
        probe: Probe,
    ) -> Result<ProbeOutcome, Failure> {
        match self {
            Asked::Line(line) => {
                let result = line.probe(probe).await.map(met);
                result.map_err(|_| Failure::of(context.lang, Code::LineClosed))
            }
            Asked::Daemon(backend) => ask_daemon(backend, context, place, &probe).await,
        }
    }

    pub(super) async fn close(self) {
        match self {
            Asked::Line(line) => line.close().await,
            Asked::Daemon(backend) => backend.finish(false).await,
        }
    }
}

async fn ask_daemon(
    backend: &Backend,
    context: &Context,
    place: &Place,
    probe: &Probe,
) -> Result<ProbeOutcome, Failure> {
    let mut frame = Frame::new();
    probe.exchange.encode(&mut frame);
    let request = SendRequest {
        protocol: probe.exchange.protocol().name().to_owned(),
        bytes: hex::spaced(frame.bytes()),
        timeout_ms: Some(probe.timeout.0.div_ceil(1000)),
        baud: Some(probe.settings.baud.rate()),
        format: Some(probe.settings.character.to_string()),
        gap_us: Some(probe.gap.0),
        clear: probe.clear,
        ..SendRequest::default()
    };
    let met = backend.send(&place.line, request).await;
    let met = met.map_err(|problem| context.failure(&problem))?;
    Ok(ProbeOutcome {
        outcome: match met.outcome {
            Outcome::Answered => Probed::Answered,
            Outcome::Garbled => Probed::Garbled,
            Outcome::Silent => Probed::Silent,
            Outcome::Unsafe => Probed::Unsafe,
        },
        bytes: hex::parse(&met.bytes).unwrap_or_default(),
        after: Micros((met.after_ms * 1000.0) as u64),
        late: met.late.iter().filter_map(late).collect(),
    })
}

/// A late reply as the daemon reports it.
fn late(told: &LateAnswer) -> Option<LateReply> {
    let mut protocols = Protocol::ALL.into_iter();
    let protocol = protocols.find(|protocol| protocol.name() == told.protocol)?;
    Some(LateReply {
        exchange: read_request(protocol, &hex::parse(&told.sent)?)?,
        after: Micros((told.after_ms * 1000.0) as u64),
        again: told.again,
    })
}
