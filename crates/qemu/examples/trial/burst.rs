//! Frames back to back.

use crate::World;
use railbus_conformance::Bench;
use railbus_device::{Family, Options, Setup};
use railbus_qemu::Board;
use railbus_wire::{Address, sum8};

const FRAMES: u32 = 1000;

/// A thousand frames of 0x55 boards without a gap [R55 §1.6]: each toggles a relay, so that one
/// lost frame shows.
pub(crate) fn no_frame_of_a_burst_is_lost(world: &World) -> Result<String, String> {
    let setup = Setup {
        outputs: 32,
        ..Setup::new(Family::R55, Address(1))
    };
    burst(world, &setup).map_err(|error| error.to_string())?
}

fn burst(world: &World, setup: &Setup) -> std::io::Result<Result<String, String>> {
    // Each frame moves relays over an emulated I2C bus.
    let board = Board::new(&world.images, setup, Options::default());
    let mut board = board?;
    // Relay n is toggled every n-th time: the sum over all is the count of every frame.
    let (mut frames, mut expected) = (Vec::new(), 0u32);
    for number in 0..FRAMES {
        // Every other frame one relay, every other one several, by a fixed pattern.
        let channels = number.wrapping_mul(0x9E37_79B9) | 1 << (number % 32);
        expected ^= channels;
        frames.extend(frame(0x36, channels));
    }
    board.send(&frames)?;
    let outputs = board.outputs(expected)?;
    let told = board.ask(&frame(0x10, 0), 8)?;
    let report = board.machine()?.report()?;
    let mut state = vec![0x22, 0x01, 0x10];
    state.extend(expected.to_be_bytes());
    state.push(sum8(&state));
    let lost_none = report.contains(" lost 0,");
    Ok(if outputs == expected && told == state && lost_none {
        Ok(format!(
            "{FRAMES} frames, {} bytes, none lost",
            frames.len()
        ))
    } else {
        Err(format!(
            "outputs {outputs:08X}, not {expected:08X}; it says {told:02X?}; console:\n{report}"
        ))
    })
}

fn frame(code: u8, word: u32) -> Vec<u8> {
    let mut frame = vec![0x55, 0x01, code];
    frame.extend(word.to_be_bytes());
    frame.push(sum8(&frame));
    frame
}
