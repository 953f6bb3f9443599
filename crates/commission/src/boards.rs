//! Switches all 0x55 boards of a line on or off at once, and reads back each known board (choice
//! 34).

use super::context::{ProcedureContext, Reply};
use super::{Procedure, ProcedureError};
use railbus_device::{Bank, Module, Observation, Op, Setup};
use railbus_wire::{Exchange, Micros, r55};

/// The result for one board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardState {
    /// Its outputs as read back; `None` if it did not answer.
    pub outputs: Option<Bank>,
    /// Whether all of them are as commanded.
    pub as_commanded: bool,
}

/// A procedure that sends all-on or all-off to every board of the line [R55 §4.12], and reads back
/// the known ones. The broadcast itself is not acknowledged.
#[must_use]
pub fn all_boards(
    boards: Vec<Setup>,
    on: bool,
) -> Procedure<Result<Vec<BoardState>, ProcedureError>> {
    Procedure::new(move |context| async move {
        let Some(first) = boards.first() else {
            return Ok(Vec::new());
        };
        let word = if on { u32::MAX } else { 0 };
        let all = r55::Exchange::new(r55::BROADCAST, r55::Request::SetAll(word)).without_reply();
        if let Some(all) = all {
            context
                .exchange(first, Exchange::R55(all), Micros::ZERO)
                .await?;
        }
        let mut states = Vec::new();
        for board in &boards {
            states.push(read_back(&context, board, on).await?);
        }
        Ok(states)
    })
}

async fn read_back(
    context: &ProcedureContext,
    board: &Setup,
    on: bool,
) -> Result<BoardState, ProcedureError> {
    let module = Module::new(*board).map_err(super::NotWritable::Setup)?;
    let outputs = match context.read(&module, &Op::ReadOutputs).await? {
        Reply::Said(Observation::Channels { outputs, .. }) => Some(outputs),
        _ => None,
    };
    // A board whose frames for on and off are swapped has switched the other way round [R55 §3.9].
    let wanted = if on != board.invert_on_off {
        board.output_mask()
    } else {
        0
    };
    let as_commanded = outputs.is_some_and(|outputs| outputs.on == wanted);
    Ok(BoardState {
        outputs,
        as_commanded,
    })
}
