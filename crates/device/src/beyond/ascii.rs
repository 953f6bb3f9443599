//! The commands of DCON modules that the EDA modules do not have [BEYOND §2].

use super::Beyond;
use crate::engine::Body;
use railbus_wire::ascii::{Exchange, Request, Response, Text};
use railbus_wire::{Frame, Instant};

/// Carries out a request that is beyond the datasheet, and writes the reply. Whether it is one.
pub(crate) fn answer(
    body: &mut Body,
    now: Instant,
    exchange: &Exchange,
    reply: &mut Frame,
) -> bool {
    let broadcast = exchange.request.is_broadcast();
    if !body.options.beyond || broadcast || !body.hears(exchange.address) {
        return false;
    }
    let from = body.address();
    let response = match carry_out(body, now, exchange.request) {
        Some(response) => response,
        None => return false,
    };
    exchange.encode_response(from, &response, reply);
    true
}

/// Nothing where the request is in the datasheet.
fn carry_out(body: &mut Body, now: Instant, request: Request) -> Option<Response> {
    let beyond = body.eeprom.beyond;
    let kept = match request {
        Request::WriteOutputs { .. } if body.is_locked() => return Some(Response::Ignored),
        Request::ReadFirmware => return firmware().map(Response::Text),
        Request::ReadWatchdogStatus => return Some(Response::Status(beyond.status())),
        Request::ReadWatchdog => {
            return Some(Response::Watchdog {
                enabled: beyond.watchdog > 0,
                tenths: beyond.watchdog,
            });
        }
        Request::ReadSafe => {
            return Some(Response::Safe {
                power_on: beyond.power_on as u8,
                safe: beyond.safe as u8,
            });
        }
        Request::ClearWatchdog => Beyond {
            tripped: false,
            ..beyond
        },
        // To watch for no time at all is not to be had [BEYOND §2.4].
        Request::WriteWatchdog {
            enabled: true,
            tenths: 0,
        } => return Some(Response::Invalid),
        Request::WriteWatchdog { enabled, tenths } => Beyond {
            watchdog: if enabled { tenths } else { 0 },
            ..beyond
        },
        Request::WriteSafe { power_on, safe } => Beyond {
            power_on: power_on.into(),
            safe: safe.into(),
            ..beyond
        },
        _ => return None,
    };
    Some(match body.keep_beyond(now, kept) {
        true => Response::Done,
        false => Response::Invalid,
    })
}

/// Whose firmware it is, and its version [BEYOND §2.1].
fn firmware() -> Option<Text> {
    const FIRMWARE: &[u8] = concat!("railbus ", env!("CARGO_PKG_VERSION")).as_bytes();
    Text::new(FIRMWARE.get(..Text::MAX).unwrap_or(FIRMWARE))
}
