//! Reads a password: from the terminal, without showing it, or from a file; never from the command
//! line, which every user of the machine can read.

use super::UserText;
use railbus_app::failure::Failure;
use railbus_gateway::access::secret::Secret;
use railbus_words::Code;
use railbus_words::Lang;
use rustix::termios::{LocalModes, OptionalActions, Termios, tcgetattr, tcsetattr};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::Path;

/// The longest line that is read, in bytes.
const LEN_MAX: usize = 1_024;

/// The password, from a file or typed at the terminal.
///
/// `command` is the command line that reads it from a file instead.
pub(super) fn password(
    lang: Lang,
    (name, command): (&str, &str),
    file: Option<&Path>,
) -> Result<Secret, Failure> {
    match file {
        Some(path) => from_file(path).map_err(|error| {
            let message = lang.fill(UserText::NoFile, &[("file", &path.display())]);
            Failure::new(Code::Usage, message).because(error)
        }),
        None => at_terminal(lang, name, command),
    }
}

fn from_file(path: &Path) -> io::Result<Secret> {
    let from: Box<dyn Read> = match path.to_str() {
        Some("-") => Box::new(io::stdin()),
        _ => Box::new(File::open(path)?),
    };
    let mut line = String::new();
    BufReader::new(from.take(LEN_MAX as u64)).read_line(&mut line)?;
    Ok(Secret::new(line.trim_end_matches(['\r', '\n']).to_owned()))
}

fn at_terminal(lang: Lang, name: &str, command: &str) -> Result<Secret, Failure> {
    let no_terminal = |error: io::Error| {
        let message = lang.get(UserText::NoTerminal).to_owned();
        let failure = Failure::new(Code::Usage, message).because(error);
        failure.with_try(format!("{command} --password-file FILE"))
    };
    let ask = |question: &str| {
        let hidden = Hidden::open().map_err(no_terminal)?;
        let typed = hidden.ask(question).map_err(no_terminal)?;
        typed.ok_or_else(|| Failure::of(lang, Code::Interrupted))
    };
    let first = ask(&lang.fill(UserText::Ask, &[("name", &name)]))?;
    let again = ask(lang.get(UserText::Again))?;
    match first.fingerprint() == again.fingerprint() {
        true => Ok(first),
        false => Err(Failure::new(
            Code::Usage,
            lang.get(UserText::Differ).to_owned(),
        )),
    }
}

/// A terminal that does not show what is typed, until this is dropped.
struct Hidden {
    terminal: File,
    before: Termios,
}

impl Hidden {
    fn open() -> io::Result<Hidden> {
        let terminal = File::options().read(true).write(true).open("/dev/tty")?;
        let before = tcgetattr(&terminal)?;
        let mut hidden = before.clone();
        // Ctrl-C is read as a character, so that the terminal is restored before the process ends.
        hidden.local_modes -= LocalModes::ECHO | LocalModes::ICANON | LocalModes::ISIG;
        tcsetattr(&terminal, OptionalActions::Flush, &hidden)?;
        Ok(Hidden { terminal, before })
    }

    /// What was typed; none if it was cancelled.
    fn ask(&self, question: &str) -> io::Result<Option<Secret>> {
        let mut terminal = &self.terminal;
        write!(terminal, "{question}")?;
        let mut typed = Vec::new();
        let mut letter = [0];
        let end = loop {
            if terminal.read(&mut letter)? == 0 || [3, 4].contains(&letter[0]) {
                break None;
            }
            match letter[0] {
                b'\r' | b'\n' => break Some(&typed),
                // Ctrl-U, and both keys that delete a character, with all of its bytes.
                21 => typed.clear(),
                8 | 127 => while typed.pop().is_some_and(|byte: u8| byte & 0xC0 == 0x80) {},
                byte if typed.len() < LEN_MAX => typed.push(byte),
                _ => {}
            }
        };
        writeln!(terminal)?;
        Ok(end.map(|typed| Secret::new(String::from_utf8_lossy(typed).into_owned())))
    }
}

impl Drop for Hidden {
    fn drop(&mut self) {
        // If this fails, there is no terminal any more.
        let _ = tcsetattr(&self.terminal, OptionalActions::Flush, &self.before);
    }
}
