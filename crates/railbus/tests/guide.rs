//! The guide, tried as written: every command in it is run, page by page, and must print what the
//! page shows. `UPDATE=1` writes the pages anew, and `PAGE=api-live` tries only that one.
//!
//! In a page of `docs/guide/<lang>/src`:
//! - ```` ```console ```` holds commands after `$ `, each followed by what it prints;
//! - ```` ```console,background ```` holds one command that stays running until the page ends;
//! - ```` ```toml,file=NAME ```` is a file that the reader makes;
//! - ```` ```websocket,PATH ```` is a talk with the daemon: after `> ` what is sent, after `< `
//!   what comes, and commands after `$ ` meanwhile.

#[path = "guide/calm.rs"]
mod calm;
#[path = "guide/page.rs"]
mod page;
#[path = "guide/shell.rs"]
mod shell;
#[path = "api/websocket.rs"]
mod websocket;

use calm::calm;
use page::Block;
use railbus_site::config::TABLES;
use shell::Shell;
use std::path::{Path, PathBuf};

fn pages(lang: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../docs/guide")
        .join(lang)
        .join("src");
    let mut pages: Vec<PathBuf> = std::fs::read_dir(&folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|end| end == "md"))
        .filter(|path| std::env::var_os("PAGE").is_none_or(|page| path.file_stem() == Some(&page)))
        .collect();
    pages.sort();
    pages
}

/// Does what a reader of the page would do, and gives the page as it should be.
fn played(lang: &str, text: &str) -> String {
    let mut shell = Shell::new(lang);
    let mut whole = String::new();
    for block in page::blocks(text) {
        match block {
            Block::Text(lines) => whole += lines,
            Block::File { name, head, body } => {
                shell.file(name, body);
                whole += &format!("{head}{body}```\n");
            }
            Block::Background {
                head,
                command,
                shown,
            } => {
                let said = shell.start(command, shown.lines().count());
                whole += &format!("{head}$ {command}\n{said}```\n");
            }
            Block::Session { head, commands } => {
                whole += head;
                for command in commands {
                    whole += &format!("$ {command}\n{}", shell.run(command));
                }
                whole += "```\n";
            }
            Block::Talk { head, path, body } => {
                whole += &format!("{head}{}```\n", talked(&shell, path, body));
            }
        }
    }
    whole
}

/// A conversation over a WebSocket: as many messages are awaited as the page shows.
fn talked(shell: &Shell, path: &str, body: &str) -> String {
    let mut client = shell.websocket(path);
    let mut said = String::new();
    for line in body.lines() {
        if let Some(message) = line.strip_prefix("> ") {
            client.send(message);
            said += &format!("{line}\n");
        } else if line.starts_with('<') {
            let message = client.next_text().expect("the connection lasts");
            said += &format!("< {message}\n");
        } else if let Some(command) = line.strip_prefix("$ ") {
            said += &format!("{line}\n{}", shell.run(command));
        }
    }
    said
}

/// Only the first differing line of a page is shown.
fn same(path: &Path, shown: &str, printed: &str) {
    let page = path.display();
    for (at, (shown, printed)) in shown.lines().zip(printed.lines()).enumerate() {
        assert_eq!(
            shown,
            printed,
            "{page}, line {} or so; UPDATE=1 writes it anew",
            at + 1
        );
    }
    assert_eq!(
        shown.len(),
        printed.len(),
        "{page} ends early; UPDATE=1 writes it anew"
    );
}

fn try_out(lang: &str) {
    let mut commands = 0;
    for path in pages(lang) {
        let text = std::fs::read_to_string(&path).expect("a page");
        let played = played(lang, &text);
        commands += played.lines().filter(|line| line.starts_with("$ ")).count();
        if std::env::var_os("UPDATE").is_some() {
            // A page in which only times have changed stays as it is.
            if calm(&text) != calm(&played) {
                std::fs::write(&path, played).expect("the guide is ours");
            }
            continue;
        }
        same(&path, &calm(&text), &calm(&played));
    }
    assert!(commands > 0, "the guide shows nothing");
}

#[test]
fn the_english_guide_is_true() {
    try_out("en");
}

#[test]
fn the_chinese_guide_is_true() {
    try_out("zh");
}

/// The heading of a table of the configuration in the reference.
fn heading(table: &str, lang: &str) -> String {
    let name = if lang == "zh" { "名称" } else { "NAME" };
    let label = if lang == "zh" { "标签" } else { "LABEL" };
    match table {
        "" if lang == "zh" => "根".to_owned(),
        "" => "Root".to_owned(),
        "line" | "module" | "group" | "scene" | "rule" | "webhook" | "outlet" => {
            format!("`[{table}.{name}]`")
        }
        "line_sim" => format!("`[line.{name}.sim]`"),
        "module_sim" => format!("`[module.{name}.sim]`"),
        "point" => format!("`[module.{name}.point.{label}]`"),
        "scale" => "`range`".to_owned(),
        "names" => "`name`".to_owned(),
        "step" => "`steps`".to_owned(),
        "action" => "`then`".to_owned(),
        "when" => "`when`".to_owned(),
        root => format!("`[{root}]`"),
    }
}

/// Every configuration key has its line in the reference, with its values, its default and its
/// meaning, and the reference has no others.
#[test]
fn every_key_of_the_configuration_is_in_the_reference() {
    for lang in ["en", "zh"] {
        let page = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../docs/guide")
            .join(lang)
            .join("src/configuration.md");
        let text = std::fs::read_to_string(&page).expect("the reference");
        let sections: Vec<&str> = text.split("\n## ").skip(1).collect();
        // One of them is the example.
        assert_eq!(sections.len(), TABLES.len() + 1, "{lang}");
        for (table, keys) in TABLES {
            let heading = heading(table, lang) + "\n";
            let section = sections.iter().find(|text| text.starts_with(&heading));
            let section = section.unwrap_or_else(|| panic!("{lang}: {heading} is missing"));
            let rows = section.lines().filter(|line| line.starts_with("| `"));
            let mut told: Vec<&str> = Vec::new();
            for row in rows {
                let cells: Vec<&str> = row.trim_matches('|').split(" | ").map(str::trim).collect();
                assert_eq!(cells.len(), 4, "{lang} {heading}{row}");
                assert!(cells.iter().all(|cell| !cell.is_empty()), "{lang}: {row}");
                told.push(cells[0].trim_matches('`'));
            }
            let mut known = keys.to_vec();
            known.sort_unstable();
            told.sort_unstable();
            assert_eq!(told, known, "{lang} {heading}");
        }
    }
}

/// A reader of one language must not miss a chapter or a command of the other.
#[test]
fn both_guides_have_the_same_pages_and_commands() {
    let commands = |path: &PathBuf| -> Vec<String> {
        let text = std::fs::read_to_string(path).expect("a page");
        let is_command = |line: &&str| line.starts_with("$ ");
        text.lines().filter(is_command).map(str::to_owned).collect()
    };
    let (en, zh) = (pages("en"), pages("zh"));
    assert_eq!(en.len(), zh.len());
    for (en, zh) in en.iter().zip(&zh) {
        assert_eq!(en.file_name(), zh.file_name());
        assert_eq!(commands(en), commands(zh), "{}", en.display());
    }
}
