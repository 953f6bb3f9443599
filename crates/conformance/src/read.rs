//! Parses the text of cases.

use crate::bytes::bytes;
use railbus_device::{Family, Layout, Options, Setup};
use railbus_wire::{Address, Protocol};
use std::fmt;

/// One case.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Its file, such as `erc8.txt`.
    pub file: String,
    /// Its first line, from 1.
    pub line: usize,
    /// What it checks, with the facts it relies on.
    pub name: String,
    /// The modules it applies to; each runs it from the factory state.
    pub modules: Vec<Subject>,
    /// Its steps, each with its line.
    pub steps: Vec<(usize, CaseStep)>,
}

/// A module that a case applies to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Subject {
    /// Its setup.
    pub setup: Setup,
    /// Its options.
    pub options: Options,
}

/// A step of a case.
#[derive(Clone, Debug, PartialEq)]
pub enum CaseStep {
    /// Send these bytes; the module replies with those, which may be none.
    Ask(Vec<u8>, Vec<u8>),
    /// The outputs must be these: bit n = output n is on.
    Outputs(u32),
    /// Set the levels at the digital inputs: bit n = input n is high or open.
    Inputs(u32),
    /// Set an analog input, in hundredths.
    Analog(u8, i16),
    /// Set the DIP switch.
    Dip(u8),
    /// Ground or release the INIT* pin.
    Init(bool),
    /// Switch the power off and on again.
    Power,
    /// Let this many milliseconds pass; the module must send nothing.
    Wait(u64),
}

/// A line that can't be parsed.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseError {
    file: String,
    line: usize,
    why: String,
}

impl fmt::Display for CaseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.why)
    }
}

/// The cases of one list.
///
/// # Errors
/// The first line that can't be parsed.
pub fn read(file: &str, text: &str) -> Result<Vec<Case>, CaseError> {
    let mut cases: Vec<Case> = Vec::new();
    for (line, content) in (1..).zip(text.lines().map(str::trim)) {
        if content.is_empty() || content.starts_with('#') {
            continue;
        }
        let error = |why| CaseError {
            file: file.to_owned(),
            line,
            why,
        };
        if let Some(name) = content.strip_prefix("case ") {
            cases.push(Case {
                file: file.to_owned(),
                line,
                name: name.to_owned(),
                modules: Vec::new(),
                steps: Vec::new(),
            });
        } else {
            let case = cases.last_mut();
            let case = case.ok_or_else(|| error(String::from("no `case` stands above this")))?;
            add(case, line, content).map_err(error)?;
        }
    }
    match cases
        .iter()
        .find(|case| case.modules.is_empty() || case.steps.is_empty())
    {
        Some(case) => Err(CaseError {
            file: file.to_owned(),
            line: case.line,
            why: String::from("a case needs a module and a step"),
        }),
        None => Ok(cases),
    }
}

fn add(case: &mut Case, line: usize, content: &str) -> Result<(), String> {
    let (word, rest) = content.split_once(' ').unwrap_or((content, ""));
    if word == "module" {
        case.modules.push(module(rest)?);
    } else if word == "<" {
        answer(case, rest)?;
    } else {
        case.steps.push((line, step(word, rest)?));
    }
    Ok(())
}

/// The module's reply to the request above.
fn answer(case: &mut Case, text: &str) -> Result<(), String> {
    match case.steps.last_mut() {
        Some((_, CaseStep::Ask(request, reply))) if reply.is_empty() => {
            *reply = match text {
                "echo" => request.clone(),
                _ => bytes(text)?,
            };
            Ok(())
        }
        _ => Err(String::from(
            "there is no request to be answered above this",
        )),
    }
}

fn step(word: &str, rest: &str) -> Result<CaseStep, String> {
    let unknown = || format!("`{word} {rest}` is no step");
    let mask = |text| u32::from_str_radix(text, 16).map_err(|_| unknown());
    Ok(match word {
        ">" => CaseStep::Ask(bytes(rest)?, Vec::new()),
        "outputs" => CaseStep::Outputs(mask(rest)?),
        "inputs" => CaseStep::Inputs(mask(rest)?),
        "analog" => {
            let (channel, value) = rest.split_once(' ').ok_or_else(unknown)?;
            let channel = channel.parse().map_err(|_| unknown())?;
            CaseStep::Analog(channel, value.parse().map_err(|_| unknown())?)
        }
        "dip" => CaseStep::Dip(rest.parse().map_err(|_| unknown())?),
        "init" if rest == "grounded" => CaseStep::Init(true),
        "init" if rest == "open" => CaseStep::Init(false),
        "power" if rest == "cycle" => CaseStep::Power,
        "wait" => CaseStep::Wait(rest.parse().map_err(|_| unknown())?),
        _ => return Err(unknown()),
    })
}

/// `eda9050 lc02 address=8`: a module in its factory state, except for what is listed.
fn module(text: &str) -> Result<Subject, String> {
    let mut words = text.split_whitespace();
    let family = words.next().and_then(Family::from_name);
    let family = family.ok_or_else(|| format!("`{text}` begins with no family"))?;
    let mut setup = Setup::new(family, Address(1));
    let mut options = Options::default();
    for word in words {
        let (key, value) = word.split_once('=').unwrap_or((word, ""));
        let number = || {
            value
                .parse::<u8>()
                .map_err(|_| format!("`{word}` has no number"))
        };
        match key {
            "ascii" => setup.protocol = Protocol::Ascii,
            "lc02" => setup.protocol = Protocol::Lc02,
            "rtu" => setup.protocol = Protocol::Rtu,
            "checksum" => setup.checksum = true,
            "address" => setup.address = Address(number()?),
            "outputs" => setup.outputs = number()?,
            "inputs" => setup.inputs = number()?,
            "variables" => setup.variables = number()?,
            "layout" => setup.layout = layout(value)?,
            "beyond" => options.extensions = true,
            "inverted" => setup.invert_on_off = true,
            _ => return Err(format!("`{word}` says nothing of a module")),
        }
    }
    setup.check().map_err(|error| error.to_string())?;
    Ok(Subject { setup, options })
}

fn layout(text: &str) -> Result<Layout, String> {
    match text {
        "outputs" => Ok(Layout::Outputs),
        "inputs" => Ok(Layout::Inputs),
        "mixed" => Ok(Layout::Mixed),
        _ => Err(format!("`{text}` is no layout")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case() {
        let text = "# a list\n\ncase on [ERC-8 §3.5]\nmodule erc8 address=7\n\
                    > 07 05 003C FF00 crc\n< echo\n> 02 07 crc\noutputs 01\npower cycle\n";
        let cases = read("erc8.txt", text).expect("it is well-formed");
        let [case] = &cases[..] else { panic!("one") };
        assert_eq!((case.line, case.name.as_str()), (3, "on [ERC-8 §3.5]"));
        let subject = Subject {
            setup: Setup::new(Family::Erc8, Address(7)),
            options: Options::default(),
        };
        assert_eq!(case.modules, [subject]);
        let write = bytes("07 05 003C FF00 crc").expect("bytes");
        let silent = bytes("02 07 crc").expect("bytes");
        let steps = [
            (5, CaseStep::Ask(write.clone(), write)),
            (7, CaseStep::Ask(silent, vec![])),
            (8, CaseStep::Outputs(1)),
            (9, CaseStep::Power),
        ];
        assert_eq!(case.steps, steps);
    }

    #[test]
    fn what_is_not_understood_is_named_by_its_line() {
        let wrong = [
            "outputs 01",
            "case a\nmodule erc8",
            "case a\noutputs 01",
            "case a\nmodule erc9\noutputs 01",
            "case a\nmodule erc8 lc02\noutputs 01",
            "case a\nmodule erc8 speed=1\noutputs 01",
            "case a\nmodule erc8\noutputs G",
            "case a\nmodule erc8\noutput 01",
            "case a\nmodule erc8\n< 01",
            "case a\nmodule erc8\n> 01\n< 02\n< 03",
            "case a\nmodule erc8\npower",
            "case a\nmodule erc8\ninit on",
        ];
        for text in wrong {
            let error = read("x.txt", text).expect_err(text).to_string();
            assert!(error.starts_with("x.txt:"), "{error}");
        }
    }
}
