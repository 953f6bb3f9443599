//! QEMU's monitor: one JSON object per line in each direction.

use serde_json::{Value, json};
use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::time::Duration;

/// How long QEMU may take for an answer. It answers within a millisecond unless the machine is very
/// busy.
const PATIENCE: Duration = Duration::from_secs(30);

/// The monitor of one QEMU.
#[derive(Debug)]
pub(crate) struct Qmp {
    lines: BufReader<UnixStream>,
    /// Whether the processor is to be halted, as it is at first.
    halted: bool,
}

impl Qmp {
    /// Starts the protocol on a new connection.
    ///
    /// # Errors
    /// If QEMU does not answer as expected.
    pub(crate) fn new(stream: UnixStream) -> io::Result<Qmp> {
        stream.set_read_timeout(Some(PATIENCE))?;
        let mut qmp = Qmp {
            lines: BufReader::new(stream),
            halted: true,
        };
        qmp.line()?; // Its greeting.
        qmp.execute(&[json!({"execute": "qmp_capabilities"})])?;
        Ok(qmp)
    }

    /// Executes commands one after another; returns their results.
    ///
    /// # Errors
    /// If one is refused, or QEMU is gone.
    pub(crate) fn execute(&mut self, commands: &[Value]) -> io::Result<Vec<Value>> {
        let lines: String = commands
            .iter()
            .map(|command| format!("{command}\n"))
            .collect();
        self.lines.get_mut().write_all(lines.as_bytes())?;
        commands
            .iter()
            .map(|command| self.answer(command))
            .collect()
    }

    /// Lets the processor run.
    pub(crate) fn go(&mut self) -> io::Result<()> {
        self.halted = false;
        self.execute(&[json!({"execute": "cont"})]).map(|_| ())
    }

    /// Halts it.
    pub(crate) fn halt(&mut self) -> io::Result<()> {
        self.halted = true;
        self.execute(&[json!({"execute": "stop"})]).map(|_| ())
    }

    /// Does something while the processor is halted.
    pub(crate) fn while_halted<T>(
        &mut self,
        doing: impl FnOnce() -> io::Result<T>,
    ) -> io::Result<T> {
        if self.halted {
            return doing();
        }
        self.halt()?;
        let done = doing();
        self.go()?;
        done
    }

    /// Reads a word at an address, as the debugger of a chip would.
    pub(crate) fn word(&mut self, address: u32) -> io::Result<u32> {
        let answers = self.execute(&[peek(address)])?;
        let word = answers.first().and_then(peeked);
        word.ok_or_else(|| io::Error::other(format!("no word at {address:#x}: {answers:?}")))
    }

    fn answer(&mut self, command: &Value) -> io::Result<Value> {
        loop {
            let mut line = self.line()?;
            if let Some(answer) = line.get_mut("return") {
                return Ok(answer.take());
            }
            if let Some(error) = line.get("error") {
                return Err(io::Error::other(format!("QEMU refuses {command}: {error}")));
            }
            // Otherwise it is an event.
        }
    }

    fn line(&mut self) -> io::Result<Value> {
        let mut line = String::new();
        if self.lines.read_line(&mut line)? == 0 {
            return Err(io::Error::other("QEMU has ended"));
        }
        serde_json::from_str(&line).map_err(io::Error::other)
    }
}

/// The command that reads a word at an address.
fn peek(address: u32) -> Value {
    let line = format!("xp /1xw {address:#x}");
    json!({"execute": "human-monitor-command", "arguments": {"command-line": line}})
}

/// The word in the answer to [`peek`]: `40004010: 0x00000a2c`.
fn peeked(answer: &Value) -> Option<u32> {
    let (_, word) = answer.as_str()?.trim().split_once("0x")?;
    u32::from_str_radix(word, 16).ok()
}

/// The command that reads a property of a chip.
pub(crate) fn get(chip: &str, property: &str) -> Value {
    let path = format!("/machine/peripheral/{chip}");
    json!({"execute": "qom-get", "arguments": {"path": path, "property": property}})
}

/// The command that sets a property of a chip.
pub(crate) fn set(chip: &str, property: &str, value: Value) -> Value {
    let path = format!("/machine/peripheral/{chip}");
    let arguments = json!({"path": path, "property": property, "value": value});
    json!({"execute": "qom-set", "arguments": arguments})
}
