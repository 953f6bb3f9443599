//! The DCON commands that EDA modules lack [BEYOND §2].

use super::Extensions;
use crate::engine::DeviceState;
use railbus_wire::ascii::{Exchange, Request, Response, Text};
use railbus_wire::{Frame, Instant};

/// Executes a request that is an extension and writes the reply; returns whether it is one.
pub(crate) fn answer(
    state: &mut DeviceState,
    now: Instant,
    exchange: &Exchange,
    reply: &mut Frame,
) -> bool {
    let broadcast = exchange.request.is_broadcast();
    if !state.options.extensions || broadcast || !state.hears(exchange.address) {
        return false;
    }
    let from = state.address();
    let response = match carry_out(state, now, exchange.request) {
        Some(response) => response,
        None => return false,
    };
    exchange.encode_response(from, &response, reply);
    true
}

/// None if the request is in the datasheet.
fn carry_out(state: &mut DeviceState, now: Instant, request: Request) -> Option<Response> {
    let extensions = state.eeprom.extensions;
    let kept = match request {
        Request::WriteOutputs { .. } if state.is_locked() => return Some(Response::Ignored),
        Request::ReadFirmware => return firmware().map(Response::Text),
        Request::ReadWatchdogStatus => return Some(Response::Status(extensions.status())),
        Request::ReadWatchdog => {
            return Some(Response::Watchdog {
                enabled: extensions.watchdog > 0,
                tenths: extensions.watchdog,
            });
        }
        Request::ReadSafe => {
            return Some(Response::Safe {
                power_on: extensions.power_on as u8,
                safe: extensions.safe as u8,
            });
        }
        Request::ClearWatchdog => Extensions {
            tripped: false,
            ..extensions
        },
        // A watchdog time of zero is not possible [BEYOND §2.4].
        Request::WriteWatchdog {
            enabled: true,
            tenths: 0,
        } => return Some(Response::Invalid),
        Request::WriteWatchdog { enabled, tenths } => Extensions {
            watchdog: if enabled { tenths } else { 0 },
            ..extensions
        },
        Request::WriteSafe { power_on, safe } => Extensions {
            power_on: power_on.into(),
            safe: safe.into(),
            ..extensions
        },
        _ => return None,
    };
    Some(match state.store_extensions(now, kept) {
        true => Response::Done,
        false => Response::Invalid,
    })
}

/// The maker of the firmware, and its version [BEYOND §2.1].
fn firmware() -> Option<Text> {
    const FIRMWARE: &[u8] = concat!("railbus ", env!("CARGO_PKG_VERSION")).as_bytes();
    Text::new(FIRMWARE.get(..Text::MAX).unwrap_or(FIRMWARE))
}
