//! `railbus man`: manual pages from the same definition as the help.

mod texts;

use super::install;
use crate::args;
use crate::cli;
use crate::texts::Text;
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};
use clap_mangen::Man;
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_words::Code;
use railbus_words::Lang;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use texts::ManText;

/// The name of the command.
pub(crate) const NAME: &str = "man";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus man [COMMAND] [--install] [--dir FOLDER]";
    args::verb(lang, NAME, ManText::About, usage)
        .before_help(args::examples(lang, ManText::Examples))
        .arg(Arg::new("NAME").help(lang.get(ManText::Name)))
        .arg(args::flag(lang, "install", ManText::Install).action(ArgAction::SetTrue))
        .arg(
            args::flag(lang, "dir", ManText::Dir)
                .value_name("FOLDER")
                .value_parser(value_parser!(PathBuf)),
        )
}

/// Prints a page, or writes all of them in both languages.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let folder: Option<&PathBuf> = matches.get_one("dir");
    let named = matches.get_one::<String>("NAME").map(String::as_str);
    match folder {
        Some(folder) => write_all(lang, folder),
        None if matches.get_flag("install") => write_all(lang, &install::data_folder().join("man")),
        None => {
            let pages = pages(lang);
            let name = named.map_or_else(|| "railbus".to_owned(), |name| format!("railbus-{name}"));
            let found = pages.iter().find(|(known, _)| *known == name);
            let (_, command) = found.ok_or_else(|| {
                let name = named.unwrap_or_default();
                let message = lang.fill(Text::NoSuchCommand, &[("name", &name)]);
                Failure::new(Code::Usage, message).with_try("railbus man")
            })?;
            let page = page(lang, command).map_err(|error| system(lang, error))?;
            out::result(lang, &page)
        }
    }
}

fn system(lang: Lang, error: io::Error) -> Failure {
    Failure::of(lang, Code::System).because(error)
}

/// Writes all pages below a folder for manuals, in English and Chinese.
fn write_all(lang: Lang, folder: &Path) -> Result<(), Failure> {
    for (of, below) in [(Lang::En, "man1"), (Lang::Zh, "zh_CN/man1")] {
        for (name, command) in pages(of) {
            let path = folder.join(below).join(format!("{name}.1"));
            let text = page(of, &command).map_err(|error| system(lang, error))?;
            install::write(lang, &path, text.as_bytes())?;
            out::result(lang, &format!("{}\n", path.display()))?;
        }
    }
    Ok(())
}

/// The program, its commands and their subcommands, by the name of the page.
fn pages(lang: Lang) -> Vec<(String, Command)> {
    let mut root = cli::define(lang);
    root.build();
    let mut pages = Vec::new();
    add("railbus", &root, &mut pages);
    pages
}

fn add(name: &str, command: &Command, pages: &mut Vec<(String, Command)>) {
    pages.push((name.to_owned(), command.clone()));
    for below in command
        .get_subcommands()
        .filter(|below| !below.is_hide_set())
    {
        add(&format!("{name}-{}", below.get_name()), below, pages);
    }
}

/// A page. Its section titles are those customary for manuals in that language.
fn page(lang: Lang, command: &Command) -> io::Result<String> {
    let man = Man::new(command.clone())
        .manual("railbus")
        .source(env!("CARGO_PKG_VERSION"));
    let mut bytes = Vec::new();
    man.render_title(&mut bytes)?;
    man.render_name_section(&mut bytes)?;
    man.render_synopsis_section(&mut bytes)?;
    man.render_description_section(&mut bytes)?;
    if let Some(text) = command.get_before_help() {
        let text = text.to_string();
        let examples = text.lines().skip(1).map(verbatim).collect::<Vec<_>>();
        write!(bytes, ".SH EXAMPLES\n.nf\n{}\n.fi\n", examples.join("\n"))?;
    }
    man.render_options_section(&mut bytes)?;
    if command.has_subcommands() {
        man.render_subcommands_section(&mut bytes)?;
    }
    if command.get_after_help().is_some() {
        man.render_extra_section(&mut bytes)?;
    }
    let text = String::from_utf8_lossy(&bytes).into_owned();
    Ok(match lang {
        Lang::En => text,
        Lang::Zh => SECTIONS.iter().fold(text, |text, (en, zh)| {
            text.replace(&format!("\n.SH {en}\n"), &format!("\n.SH {zh}\n"))
        }),
    })
}

const SECTIONS: [(&str, &str); 6] = [
    ("NAME", "名称"),
    ("SYNOPSIS", "用法"),
    ("DESCRIPTION", "说明"),
    ("EXAMPLES", "示例"),
    ("OPTIONS", "选项"),
    ("EXTRA", "其他"),
];

/// Escapes a line that roff would take for a command of its own.
fn verbatim(line: &str) -> String {
    let line = line.replace('\\', "\\e").replace('-', "\\-");
    match line.starts_with(['.', '\'']) {
        true => format!("\\&{line}"),
        false => line,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page_in_both_languages() {
        for lang in [Lang::En, Lang::Zh] {
            let names: Vec<String> = pages(lang).into_iter().map(|(name, _)| name).collect();
            for verb in cli::names().filter(|name| !["complete", "extcap"].contains(name)) {
                assert!(names.contains(&format!("railbus-{verb}")), "{verb}");
            }
            for (name, command) in pages(lang) {
                let text = page(lang, &command).unwrap();
                let heading = lang.of(["\n.SH NAME\n", "\n.SH 名称\n"]);
                assert!(text.contains(heading), "{name}");
                assert!(text.contains("\\-\\-lang"), "{name}");
                let foreign = lang.of(["选项", "\n.SH OPTIONS"]);
                assert!(!text.contains(foreign), "{name}");
            }
        }
    }
}
