//! Runs the scan: sends its requests until it is complete or stopped.

use super::asked::Asked;
use super::show::Live;
use crate::commands::Context;
use crate::commands::place::Place;
use crate::commands::stop::Stop;
use railbus_app::failure::Failure;
use railbus_app::scan::{ScanEnd, drive};
use railbus_commission::scan::Scanner;
use railbus_wire::Micros;
use std::ops::ControlFlow;
use std::time::Duration;
use tokio::time::sleep_until;

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
    let stop = async {
        let time_up = async {
            match max_time {
                Some(time) => sleep_until(start + Duration::from_micros(time.0)).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            () = stop.requested() => Ok(End::Interrupted),
            () = time_up => Ok(End::TimeUp),
        }
    };
    let probe = |probe| asked.probe(context, place, probe);
    let see = |scanner: &Scanner, found: Option<usize>| {
        let Some(found) = found.and_then(|index| scanner.found().get(index)) else {
            live.progress(scanner);
            return ControlFlow::Continue(());
        };
        match live.found(found) {
            Ok(ControlFlow::Continue(())) => ControlFlow::Continue(()),
            Ok(ControlFlow::Break(())) => ControlFlow::Break(Ok(End::Unread)),
            Err(failure) => ControlFlow::Break(Err(failure)),
        }
    };
    let end = match drive(&mut scanner, probe, stop, see).await {
        ScanEnd::Complete => End::Complete,
        ScanEnd::Noise => End::Noise,
        ScanEnd::Stopped(why) => why?,
        ScanEnd::Failed(failure) => End::Lost(failure),
    };
    let took = Micros(u64::try_from(start.elapsed().as_micros()).unwrap_or(u64::MAX));
    live.clear();
    asked.close().await;
    Ok(Report {
        scanner,
        took,
        estimate,
        end,
    })
}
