//! `railbus sim ctl`: commands for a simulator that runs elsewhere.

use super::texts::SimFlagText;
use crate::args;
use clap::{Arg, ArgMatches, Command, value_parser};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_words::Code;
use railbus_words::Lang;
use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The name of the command.
pub(super) const NAME: &str = "ctl";

/// Commands are carried out at once; a simulator that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(30);

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    args::verb(
        lang,
        NAME,
        SimFlagText::CtlAbout,
        "railbus sim ctl SOCKET [ORDER]",
    )
    .before_help(args::examples(lang, SimFlagText::CtlExamples))
    .arg(
        Arg::new("SOCKET")
            .help(lang.get(SimFlagText::CtlSocket))
            .required(true)
            .value_parser(value_parser!(PathBuf)),
    )
    .arg(
        Arg::new("ORDER")
            .help(lang.get(SimFlagText::CtlOrder))
            .num_args(0..)
            .allow_hyphen_values(true)
            .trailing_var_arg(true),
    )
}

/// Sends the command, or those on stdin, and prints the answers.
pub(super) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let path: PathBuf = matches.get_one("SOCKET").cloned().unwrap_or_default();
    let words: Vec<&str> = matches
        .get_many::<String>("ORDER")
        .into_iter()
        .flatten()
        .map(String::as_str)
        .collect();
    let failed = |error: io::Error| railbus_plant::unreachable(lang, &path, &error);
    let mut link = Link::open(&path).map_err(failed)?;
    if !words.is_empty() {
        return link.ask(lang, &path, &words.join(" "));
    }
    for line in io::stdin().lock().lines() {
        let line = line.map_err(failed)?;
        if !line.trim().is_empty() {
            link.ask(lang, &path, &line)?;
        }
    }
    Ok(())
}

struct Link {
    writer: UnixStream,
    reader: BufReader<UnixStream>,
}

impl Link {
    fn open(path: &Path) -> io::Result<Link> {
        let writer = UnixStream::connect(path)?;
        writer.set_read_timeout(Some(PATIENCE))?;
        writer.set_write_timeout(Some(PATIENCE))?;
        let reader = BufReader::new(writer.try_clone()?);
        Ok(Link { writer, reader })
    }

    fn ask(&mut self, lang: Lang, path: &Path, order: &str) -> Result<(), Failure> {
        let answer = self
            .exchange(order)
            .map_err(|error| railbus_plant::unreachable(lang, path, &error))?;
        match refusal(&answer) {
            Some((code, message)) => Err(Failure::new(code, message.to_owned()).diagnosed()),
            None => out::result(lang, &format!("{answer}\n")),
        }
    }

    fn exchange(&mut self, order: &str) -> io::Result<String> {
        let order = order.replace('\n', " ");
        self.writer.write_all(format!("{order}\n").as_bytes())?;
        let mut answer = String::new();
        if self.reader.read_line(&mut answer)? == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(answer.trim_end().to_owned())
    }
}

/// The code and the text of an error, in either language.
fn refusal(answer: &str) -> Option<(Code, &str)> {
    let head = ["error[", "错误["];
    let rest = head.iter().find_map(|head| answer.strip_prefix(head))?;
    let (code, message) = rest.split_once(']')?;
    let message = message.trim_start_matches([':', '：', ' ']);
    Some((Code::from_name(code)?, message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_known_in_both_languages() {
        for lang in [Lang::En, Lang::Zh] {
            let failure = Failure::new(Code::SimOrder, "so: 1".to_owned());
            let told = failure.render(lang);
            let line = told.lines().next().unwrap_or_default();
            assert_eq!(refusal(line), Some((Code::SimOrder, "so: 1")));
        }
        assert_eq!(refusal("pump: power on"), None);
    }
}
