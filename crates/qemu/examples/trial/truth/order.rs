//! Commands for a module's outputs, and their reported ends.

use crate::dice::Dice;
use crate::http::Ask;
use crate::oracle::{OnceOnly, ToldEnd};
use railbus_device::{Family, Point, PointKind, Setup};
use serde_json::{Map, Value, json};

/// A command of one module.
pub(super) struct Order {
    pub(super) ask: Ask,
    /// The outputs that are to go into these states; none where one is switched over.
    pub(super) wish: (u32, u32),
    /// The outputs that it names.
    named: u32,
}

/// The reported end of a command.
pub(super) struct Told {
    /// `readback`, `reply`, or the code of what went wrong.
    pub(super) how: String,
    pub(super) end: ToldEnd,
    /// The reported states of these outputs.
    pub(super) now: (u32, u32),
}

/// As in the soak, the last output of a 0x55 board is only ever switched over, by a command that
/// must not be doubled.
pub(super) fn once_only(setup: &Setup) -> OnceOnly {
    let toggled = match setup.family {
        Family::R55 => 1 << (setup.outputs - 1),
        _ => 0,
    };
    OnceOnly { pulsed: 0, toggled }
}

impl Order {
    /// Mostly one output of a module, now and then several at once.
    pub(super) fn roll(module: &str, setup: &Setup, dice: &mut Dice) -> Order {
        let toggled = once_only(setup).toggled;
        if toggled != 0 && dice.one_in(4) {
            return Order::toggle(module, setup, toggled);
        }
        let on = dice.next() as u32;
        let free = setup.output_mask() & !toggled;
        let several = dice.next() as u32 & free;
        let one = nth(free, dice.between(0, u64::from(free.count_ones()) - 1));
        let mask = if dice.one_in(4) { one | several } else { one };
        Order {
            ask: Ask {
                method: "PUT",
                path: format!("/api/v1/modules/{module}/outputs"),
                body: json!({ "set": states(setup, mask, on) }).to_string(),
            },
            wish: (mask, on & mask),
            named: mask,
        }
    }

    fn toggle(module: &str, setup: &Setup, output: u32) -> Order {
        let label = label(setup, output.trailing_zeros());
        Order {
            ask: Ask {
                method: "POST",
                path: format!("/api/v1/points/{module}/{label}/toggle"),
                body: json!({ "raw": true }).to_string(),
            },
            wish: (0, 0),
            named: output,
        }
    }

    /// Reads an answer.
    pub(super) fn told(&self, setup: &Setup, answer: &str) -> Result<Told, String> {
        let answer: Value =
            serde_json::from_str(answer).map_err(|error| format!("{answer}: {error}"))?;
        let how = answer["confirmed"].as_str().or(answer["code"].as_str());
        let how = how.ok_or_else(|| format!("{answer} is no end of a command"))?;
        let mut now = (0, 0);
        for output in (0..32).filter(|output| self.named >> output & 1 == 1) {
            let one = match answer.get("set") {
                Some(set) => &set[label(setup, output)],
                None => &answer,
            };
            if let Some(on) = one["value"].as_bool() {
                now = (now.0 | 1 << output, now.1 | u32::from(on) << output);
            }
        }
        let end = match answer["confirmed"].as_str() {
            Some("readback" | "reply") => ToldEnd::Done,
            None if answer["may_have_acted"] != true => ToldEnd::NotDone,
            _ => ToldEnd::Unknown,
        };
        Ok(Told {
            how: how.to_owned(),
            end,
            now,
        })
    }
}

fn states(setup: &Setup, mask: u32, on: u32) -> Map<String, Value> {
    let outputs = (0..32).filter(|output| mask >> output & 1 == 1);
    outputs
        .map(|output| (label(setup, output), Value::Bool(on >> output & 1 == 1)))
        .collect()
}

fn label(setup: &Setup, output: u32) -> String {
    let (letters, number) = setup.label(Point {
        kind: PointKind::Output,
        index: output as u8,
    });
    format!("{letters}{number}")
}

/// The n-th bit of a mask alone.
fn nth(mask: u32, n: u64) -> u32 {
    let rest = (0..n).fold(mask, |rest, _| rest & (rest - 1));
    rest & rest.wrapping_neg()
}
