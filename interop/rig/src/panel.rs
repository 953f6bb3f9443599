//! The panel of the modules: a command per line of standard input, and a line in answer: `ok`, `ok`
//! with a value, or `error` with the reason.

use crate::describe;
use crate::line::Served;
use railbus_device::Eeprom;
use railbus_sim::{Act, Power, SlotId};
use railbus_wire::{Character, Micros};

/// Carries out one command.
///
/// # Errors
/// Says what is not understood.
pub fn obey(served: &mut Served, line: &str) -> Result<String, String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words[..] {
        ["skip", millis] => served.skip(Micros::from_millis(number(millis)?)),
        ["parity", letter] => {
            served.character = match letter {
                "n" => Character::N1,
                "o" => Character::O1,
                "e" => Character::E1,
                _ => return Err(format!("no parity `{letter}`")),
            };
        }
        ["outputs", name] => return Ok(format!("{:X}", served.outputs(find(served, name)?))),
        ["changes", name] => {
            let module = find(served, name)?;
            let changes = served.take_changes(module).into_iter();
            let words = changes.map(|(at, channel, on)| format!("{at}:{channel}:{}", u8::from(on)));
            return Ok(words.collect::<Vec<_>>().join(" "));
        }
        [verb, name, ref rest @ ..] => {
            let module = find(served, name)?;
            let act = act(served, module, verb, rest)?;
            served.act(module, act);
        }
        _ => return Err(format!("`{line}` is not understood")),
    }
    Ok(String::new())
}

fn act(served: &Served, module: SlotId, verb: &str, rest: &[&str]) -> Result<Act, String> {
    Ok(match (verb, rest) {
        ("power", ["off"]) => Act::Power(Power::Off),
        ("power", ["on"]) => Act::Power(Power::On),
        ("power", ["cycle"]) => Act::Power(Power::Cycle),
        ("init", ["ground"]) => Act::Init(true),
        ("init", ["open"]) => Act::Init(false),
        ("dip", [dip]) => Act::Dip(number(dip)?),
        ("levels", [levels]) => Act::Levels(number(levels)?),
        ("analog", [channel, value]) => Act::Analog(number(channel)?, number(value)?),
        ("protocol", [name]) => Act::Rewrite(Eeprom {
            protocol: describe::protocol(name)?,
            ..served.eeprom(module)
        }),
        _ => return Err(format!("`{verb} {}` is not understood", rest.join(" "))),
    })
}

fn find(served: &Served, name: &str) -> Result<SlotId, String> {
    served
        .find(name)
        .ok_or_else(|| format!("no module `{name}`"))
}

fn number<T: TryFrom<i64>>(text: &str) -> Result<T, String> {
    let wide: Option<i64> = text.parse().ok();
    let fits = wide.and_then(|wide| T::try_from(wide).ok());
    fits.ok_or_else(|| format!("`{text}` is no number that fits"))
}
