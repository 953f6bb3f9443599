//! `railbus explain`: what a code means.

use crate::args;
use crate::commands::Context;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out};
use railbus_app::texts::AppText;
use railbus_words::Lang;
use railbus_words::{Code, EXITS, Page, findings};
use serde_json::{Value, json};

/// The name of the command.
pub(crate) const NAME: &str = "explain";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    args::verb(lang, NAME, Text::ExplainAbout, "railbus explain [CODE]")
        .before_help(args::examples(lang, Text::ExplainExamples))
        .arg(Arg::new("CODE").help(lang.get(Text::ExplainCode)))
}

/// Prints a page, the table of exit codes, or the list of all codes.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let format = Context::of(lang, matches)?.format;
    let text = match matches.get_one::<String>("CODE").map(String::as_str) {
        None => codes(lang, &all()).render(format),
        Some("exit-codes") => exit_codes(lang).render(format),
        Some(name) => {
            let code = find(name).ok_or_else(|| no_such_code(lang, name))?;
            match format {
                Format::Table => page(lang, &code),
                _ => codes(lang, &[code]).render(format),
            }
        }
    };
    out::result(lang, &text)
}

/// The failure for a code that does not exist.
pub(super) fn no_such_code(lang: Lang, name: &str) -> Failure {
    let message = lang.fill(Text::NoSuchCode, &[("name", &name)]);
    Failure::new(Code::Usage, message).with_try("railbus explain")
}

/// A code of any kind; only errors have an exit code.
struct Explained {
    name: &'static str,
    page: Page,
    exit: Option<u8>,
}

fn all() -> Vec<Explained> {
    let errors = Code::all().map(|code| Explained {
        name: code.name(),
        page: code.page(),
        exit: Some(code.exit()),
    });
    let findings = findings::all().map(|finding| Explained {
        name: finding.code,
        page: finding.page,
        exit: None,
    });
    errors.chain(findings).collect()
}

/// `E0301`, `d204`, or an error by its number alone: `e301`, `301`.
fn find(name: &str) -> Option<Explained> {
    let digits = name.trim_start_matches(['e', 'E']);
    let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    let error = is_number.then(|| format!("E{digits:0>4}"));
    let wanted = error.as_deref().unwrap_or(name);
    all()
        .into_iter()
        .find(|code| code.name.eq_ignore_ascii_case(wanted))
}

fn page(lang: Lang, code: &Explained) -> String {
    let mut table = Table::bare();
    let mut add = |label: &str, text: String| {
        table.add([String::new(), label.to_owned(), text]);
    };
    add(lang.get(AppText::Likely), code.page.likely(lang).to_owned());
    add(lang.get(AppText::Try), code.page.next(lang).to_owned());
    if let Some(exit) = code.exit {
        let name = EXITS.iter().find(|known| known.code == exit);
        let name = name.map_or("", |known| known.name);
        add(lang.get(Text::ExitLabel), format!("{exit} {name}"));
    }
    format!(
        "{}  {}\n{}",
        code.name,
        code.page.title(lang),
        table.render()
    )
}

fn codes(lang: Lang, codes: &[Explained]) -> Records {
    let mut table = Table::bare();
    let mut rows = Vec::new();
    for code in codes {
        let title = code.page.title(lang);
        table.add([code.name.to_owned(), title.to_owned()]);
        rows.push(json!({
            "code": code.name, "title": title, "likely": code.page.likely(lang),
            "next": code.page.next(lang), "exit": code.exit,
        }));
    }
    Records {
        key: "codes",
        rows,
        columns: &["code", "title", "likely", "next", "exit"],
        value: "code",
        table,
    }
}

/// The table of exit codes.
pub(super) fn exit_codes(lang: Lang) -> Records {
    let mut table = Table::bare();
    let mut rows: Vec<Value> = Vec::new();
    for exit in EXITS {
        let meaning = exit.meaning(lang);
        table.add([
            exit.code.to_string(),
            exit.name.to_owned(),
            meaning.to_owned(),
        ]);
        rows.push(json!({ "exit": exit.code, "name": exit.name, "meaning": meaning }));
    }
    Records {
        key: "exits",
        rows,
        columns: &["exit", "name", "meaning"],
        value: "exit",
        table,
    }
}
