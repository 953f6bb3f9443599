//! The state of the modules of a simulated line, and its changes.

use super::{Gone, Out};
use railbus_api::sim::{SimFaultInfo, SimLineInfo, SimModuleInfo};
use railbus_plant::remote::Remote;
use std::time::Duration;
use tokio::time::{MissedTickBehavior, interval};

pub(super) use crate::sim::line;

/// How often a client's view is compared with the modules.
const LOOK: Duration = Duration::from_millis(100);

/// Sends the state of the line, then its changes.
pub(super) async fn follow(line: &Remote, mut out: Out) -> Result<(), Gone> {
    let Some(mut told) = line.look().await else {
        return Ok(());
    };
    out.snapshot(&told).await?;
    let mut look = interval(LOOK);
    look.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        look.tick().await;
        let Some(now) = line.look().await else {
            return Ok(());
        };
        if let Some(changes) = changes(&told, &now) {
            out.delta("sim", &changes).await?;
        }
        told = now;
    }
}

/// The line with only those modules that changed, if any did.
fn changes(before: &SimLineInfo, now: &SimLineInfo) -> Option<SimLineInfo> {
    let mut now = now.clone();
    let known = |module: &SimModuleInfo| {
        let mut before = before.modules.iter();
        before.any(|before| lasting(before) == lasting(module))
    };
    now.modules.retain(|module| !known(module));
    let alone = |line: &SimLineInfo| SimLineInfo {
        faults: without_time(&line.faults),
        modules: Vec::new(),
        ..line.clone()
    };
    let is_same = now.modules.is_empty() && alone(before) == alone(&now);
    (!is_same).then_some(now)
}

/// Without fields that the client can compute.
fn lasting(module: &SimModuleInfo) -> SimModuleInfo {
    SimModuleInfo {
        faults: without_time(&module.faults),
        ..module.clone()
    }
}

fn without_time(faults: &[SimFaultInfo]) -> Vec<SimFaultInfo> {
    let timeless = |fault: &SimFaultInfo| SimFaultInfo {
        left_ms: None,
        ..fault.clone()
    };
    faults.iter().map(timeless).collect()
}
