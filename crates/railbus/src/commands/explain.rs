//! `railbus explain`: what a code means.

use crate::cli;
use crate::failure::{Code, EXITS, Failure};
use crate::i18n::Lang;
use crate::render::out;
use crate::render::table::Table;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};

/// The name of the command.
pub(crate) const NAME: &str = "explain";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    cli::verb(lang, NAME, Text::ExplainAbout, "railbus explain [CODE]")
        .before_help(cli::examples(lang, Text::ExplainExamples))
        .arg(Arg::new("CODE").help(lang.get(Text::ExplainCode)))
}

/// Prints a page, the table of exit codes, or the list of all codes.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let text = match matches.get_one::<String>("CODE").map(String::as_str) {
        None => all(lang),
        Some("exit-codes") => exit_codes(lang),
        Some(name) => {
            let code = Code::from_name(name).ok_or_else(|| {
                let values: &[(&str, &dyn std::fmt::Display)] = &[("name", &name)];
                Failure::new(Code::Usage, lang.fill(Text::NoSuchCode, values))
                    .with_try("railbus explain")
            })?;
            page(lang, code)
        }
    };
    out::result(lang, &text)
}

fn page(lang: Lang, code: Code) -> String {
    let page = code.page();
    let exit = code.exit();
    let name = EXITS.iter().find(|known| known.code == exit);
    let mut table = Table::bare();
    for (label, text) in [
        (Text::Likely, page.likely(lang)),
        (Text::Try, page.next(lang)),
    ] {
        table.add([String::new(), lang.get(label).to_owned(), text.to_owned()]);
    }
    let exit = format!("{exit} {}", name.map_or("", |known| known.name));
    table.add([String::new(), lang.get(Text::ExitLabel).to_owned(), exit]);
    format!("{}  {}\n{}", code.name(), page.title(lang), table.render())
}

fn all(lang: Lang) -> String {
    let mut table = Table::bare();
    for code in Code::ALL {
        table.add([code.name().to_owned(), code.page().title(lang).to_owned()]);
    }
    table.render()
}

fn exit_codes(lang: Lang) -> String {
    let mut table = Table::bare();
    for exit in EXITS {
        let meaning = exit.meaning(lang).to_owned();
        table.add([exit.code.to_string(), exit.name.to_owned(), meaning]);
    }
    table.render()
}
