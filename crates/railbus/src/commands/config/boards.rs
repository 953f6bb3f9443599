//! The 0x55 boards of a line, for the one command that addresses all of them.

use super::config_context::ConfigContext;
use super::drive::Driver;
use crate::commands::Context;
use clap::ArgMatches;
use railbus_app::failure::Failure;
use railbus_app::settings::outcome;
use railbus_app::settings::target::Target;
use railbus_commission::{BoardState, all_boards};
use railbus_wire::{Frame, r55};
use railbus_words::Code;
use railbus_words::hex;

/// The 0x55 boards that the configuration has on one line.
pub(crate) struct Line {
    targets: Vec<Target>,
}

impl Line {
    /// The line of `-l`, or the only one that has such boards.
    pub(crate) fn of(context: &Context, matches: &ArgMatches) -> Result<Line, Failure> {
        let cfg = ConfigContext::of(context, matches)?;
        let mut targets = cfg.targets(context, &[])?;
        targets.retain(|target| target.setup.family.datasheet().broadcast.is_some());
        let Some(first) = targets.first() else {
            return Err(Failure::of(context.lang, Code::NothingToDo));
        };
        if let Some(other) = targets.iter().find(|target| target.line != first.line) {
            let failure = Failure::of(context.lang, Code::NoLine);
            let failure = failure.with_try(format!("-l {}", first.line));
            return Err(failure.with_try(format!("-l {}", other.line)));
        }
        Ok(Line { targets })
    }

    /// Its name.
    pub(crate) fn name(&self) -> &str {
        self.targets
            .first()
            .map_or("", |target| target.line.as_str())
    }

    /// The frame that is sent, in hexadecimal digits [R55 §4.12].
    pub(crate) fn frame(on: bool) -> String {
        let word = if on { u32::MAX } else { 0 };
        let mut frame = Frame::new();
        let all = r55::Exchange::new(r55::BROADCAST, r55::Request::SetAll(word)).without_reply();
        if let Some(all) = all {
            all.encode(&mut frame);
        }
        hex::spaced(frame.bytes())
    }
}

/// Switches all boards, and reads each back.
pub(crate) async fn switch(
    context: &Context,
    line: &Line,
    on: bool,
) -> Result<Vec<(String, BoardState)>, Failure> {
    let Some(first) = line.targets.first() else {
        return Ok(Vec::new());
    };
    let setups = line.targets.iter().map(|target| target.setup).collect();
    let mut driver = Driver::open(context, first, None).await?;
    let states = driver.run(all_boards(setups, on)).await;
    let states = states.map_err(|trouble| outcome::trouble(context.lang, first, &trouble))?;
    Ok(line
        .targets
        .iter()
        .map(|target| target.name.clone())
        .zip(states)
        .collect())
}
