//! A module as the command line describes it: `name=oven,model=erc8,addr=3`.

use railbus_device::{Applies, Eeprom, Family, Layout, Options, Setup};
use railbus_wire::{Address, Baud, Micros, Protocol};

/// A module of the line.
pub struct Description {
    /// Its name at the panel.
    pub name: String,
    /// The settings that the wire can't show.
    pub setup: Setup,
    /// Its settings at power-up.
    pub eeprom: Eeprom,
    /// The options that are on.
    pub options: Options,
}

/// Parses the value of one `--module`.
///
/// # Errors
/// Names the word that is not understood.
pub fn module(text: &str) -> Result<Description, String> {
    let words: Vec<(&str, &str)> = text
        .split(',')
        .map(|word| word.split_once('=').unwrap_or((word, "on")))
        .collect();
    let of = |key| {
        let found = words.iter().find(|(known, _)| *known == key);
        found.map(|(_, value)| *value)
    };
    let model = of("model").ok_or("`model` is missing")?;
    let family = Family::from_name(model).ok_or_else(|| format!("no model `{model}`"))?;
    let address = number(of("addr").unwrap_or("1"))?;
    let mut setup = Setup::new(family, Address(address));
    let mut options = Options::default();
    let mut name = model;
    for (key, value) in &words {
        match *key {
            "model" | "addr" => {}
            "name" => name = value,
            "proto" => setup.protocol = protocol(value)?,
            "baud" => {
                let rate = value.parse().ok().and_then(Baud::from_rate);
                setup.serial.baud = rate.ok_or_else(|| format!("no speed `{value}`"))?;
            }
            "checksum" => setup.checksum = true,
            "outputs" => setup.outputs = number(value)?,
            "inputs" => setup.inputs = number(value)?,
            "variables" => setup.variables = number(value)?,
            "layout" => {
                setup.layout = match *value {
                    "outputs" => Layout::Outputs,
                    "inputs" => Layout::Inputs,
                    "mixed" => Layout::Mixed,
                    _ => return Err(format!("no layout `{value}`")),
                };
            }
            "turnaround" => options.turnaround = Micros::from_millis(number(value)?.into()),
            "aloud" => options.refuse_aloud = true,
            "lower-case" => options.lower_case = true,
            "answer-bad" => options.answer_bad_frames = true,
            "insist-on-gap" => options.insist_on_gap = true,
            "beyond" => options.extensions = true,
            "applies" => {
                options.applies = match *value {
                    "reply" => Applies::AfterReply,
                    "restart" => Applies::AfterRestart,
                    "address" => Applies::AddressAfterReply,
                    _ => return Err(format!("no `applies={value}`")),
                };
            }
            _ => return Err(format!("no key `{key}`")),
        }
    }
    Ok(Description {
        name: name.to_owned(),
        setup,
        eeprom: Eeprom::of(&setup),
        options,
    })
}

/// A protocol by its name.
///
/// # Errors
/// If there is none of that name.
pub fn protocol(name: &str) -> Result<Protocol, String> {
    let found = Protocol::ALL.into_iter().find(|known| known.name() == name);
    found.ok_or_else(|| format!("no protocol `{name}`"))
}

/// A number that fits a byte.
fn number(text: &str) -> Result<u8, String> {
    text.parse().map_err(|_| format!("`{text}` is no byte"))
}
