//! Runs the scan: sends its requests until it is complete or stopped.

use super::asked::Asked;
use super::show::Live;
use crate::commands::Context;
use crate::commands::place::Place;
use crate::commands::stop::Stop;
use railbus_app::failure::Failure;
use railbus_commission::scan::{Scanner, Step};
use railbus_wire::{Instant, Micros};
use std::ops::ControlFlow;
use std::time::Duration;
use tokio::time::sleep_until;

/// A request that takes this long waits for a silence that never comes.
const UNSENT_MAX: Duration = Duration::from_secs(10);

/// How a scan ended.
#[derive(Debug)]
pub(super) enum End {
    /// Everything was asked.
    Complete,
    /// Ctrl-C.
    Interrupted,
    /// Its time was up.
    TimeUp,
    /// The line is never silent.
    Noise,
    /// The output was closed.
    Unread,
    /// The line or the daemon failed.
    Lost(Failure),
}

/// A scan that has ended.
#[derive(Debug)]
pub(super) struct Report {
    pub(super) scanner: Scanner,
    pub(super) took: Micros,
    /// The estimated duration at its start.
    pub(super) estimate: Micros,
    pub(super) end: End,
}

/// Runs a scan to its end.
pub(super) async fn scan(
    context: &Context,
    place: &Place,
    asked: Asked,
    mut scanner: Scanner,
    (stop, max_time): (&mut Stop, Option<Micros>),
    live: &mut Live<'_>,
) -> Result<Report, Failure> {
    let estimate = scanner.progress().left;
    let start = tokio::time::Instant::now();
    let now = || Instant(u64::try_from(start.elapsed().as_micros()).unwrap_or(u64::MAX));
    let time_up = async {
        match max_time {
            Some(time) => sleep_until(start + Duration::from_micros(time.0)).await,
            None => std::future::pending().await,
        }
    };
    let mut time_up = std::pin::pin!(time_up);
    let end = loop {
        match scanner.next(now()) {
            Step::Done if scanner.is_noisy() => break End::Noise,
            Step::Done => break End::Complete,
            Step::Found(index) => {
                let found = scanner.found().get(index);
                if let Some(found) = found
                    && let ControlFlow::Break(()) = live.found(found)?
                {
                    break End::Unread;
                }
            }
            Step::Ask(probe) => {
                live.progress(&scanner);
                let met = tokio::select! {
                    met = asked.probe(context, place, probe) => met,
                    () = stop.requested() => break End::Interrupted,
                    () = &mut time_up => break End::TimeUp,
                    // Nothing is sent before the line is silent.
                    () = sleep_until(tokio::time::Instant::now() + UNSENT_MAX) => break End::Noise,
                };
                match met {
                    Ok(met) => scanner.met(now(), met),
                    Err(failure) => break End::Lost(failure),
                }
            }
        }
    };
    let took = Micros(now().0);
    live.clear();
    asked.close().await;
    Ok(Report {
        scanner,
        took,
        estimate,
        end,
    })
}
