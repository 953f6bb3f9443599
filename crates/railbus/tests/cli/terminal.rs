//! Terminals of 80 and 40 columns, and none at all.

use crate::site::Site;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};
use std::fs::{File, OpenOptions};
use std::io::Read;
use unicode_width::UnicodeWidthStr;

/// What a run shows on a terminal of so many columns.
pub(crate) fn shown(site: &Site, columns: u16, line: &str) -> String {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pseudo-terminal");
    grantpt(&master).expect("it is ours");
    unlockpt(&master).expect("it is ours");
    let size = Winsize {
        ws_row: 24,
        ws_col: columns,
        ws_xpixel: 0,
        ws_ypixel: 0,
    };
    tcsetwinsize(&master, size).expect("it has a size");
    let path = ptsname(&master, Vec::new())
        .expect("it has a name")
        .into_string()
        .expect("text");
    let slave = || {
        OpenOptions::new()
            .read(true)
            .write(true)
            .open(&path)
            .expect("it opens")
    };
    let mut command = site.command();
    command
        .args(line.split(' '))
        .env("TERM", "xterm")
        .env_remove("NO_COLOR");
    command.stdin(slave()).stdout(slave()).stderr(slave());
    let mut child = command.spawn().expect("railbus starts");
    drop(command);
    let mut text = Vec::new();
    // The end is an error here: the other side is no longer open.
    let _ = File::from(master).read_to_end(&mut text);
    child.wait().expect("it ends");
    String::from_utf8(text).expect("text").replace("\r\n", "\n")
}

/// The least important columns go first, and what is left is still a table that fits.
#[test]
fn a_table_too_wide_for_the_terminal_does_without_some_columns() {
    let mut site = Site::demo("terminal-table");
    site.serve();
    let socket = format!("--socket {}", site.socket());
    for (line, least) in [
        ("ls", ["MODULE", "STATE"]),
        ("scan --addr 1-6 --timeout 200ms", ["ADDR", "VERDICT"]),
        ("ls lines", ["LINE", "STATE"]),
        ("ls points tank gate", ["tank.ai1", "gate.do0"]),
        ("get tank gate", ["tank.ai1", "gate.do0"]),
        ("ls models", ["MODEL", "OUTPUTS"]),
    ] {
        // A scan takes its time, and its columns do the same in Chinese.
        let langs: &[&str] = match line.starts_with("scan") {
            true => &["en"],
            false => &["en", "zh"],
        };
        for lang in langs {
            for columns in [80, 60, 40] {
                let text = shown(&site, columns, &format!("{socket} -q --lang {lang} {line}"));
                let plain: Vec<&str> = text.lines().map(uncovered).collect();
                let widest = plain.iter().map(|line| line.width()).max();
                assert!(widest <= Some(usize::from(columns)), "{columns}: {text}");
                // One line each, and none of its own for a cell.
                assert!(plain.iter().all(|line| line.contains("  ")), "{text}");
                for word in least.iter().filter(|_| *lang == "en") {
                    assert!(text.contains(word), "{columns} {word}: {text}");
                }
            }
        }
    }
    let modules = shown(&site, 80, &format!("{socket} ls"));
    assert_eq!(modules.lines().count(), 6, "{modules}");
    let narrow = shown(&site, 40, &format!("{socket} ls"));
    assert_eq!(narrow.lines().count(), 6, "{narrow}");
    assert!(narrow.starts_with("MODULE  "), "{narrow}");
}

/// Display names are shown beside command names; in the other language if there is none in this
/// one.
#[test]
fn names_are_listed_at_eighty_columns() {
    let mut site = Site::demo("terminal-names");
    let text = std::fs::read_to_string(site.folder.join("railbus.toml")).expect("a file");
    let called = |name: &str, en: &str, zh: &str| {
        format!("[{name}]\nname = {{ en = \"{en}\", zh = \"{zh}\" }}\n")
    };
    let text = text
        .replace("[line.main]\n", &called("line.main", "Cellar", "地下室"))
        .replace(
            "[module.oven]\n",
            &called("module.oven", "Oven hall", "炉房"),
        )
        .replace(
            "[module.tank]\n",
            "[module.tank]\nname = { zh = \"水池\" }\n",
        );
    site.configure(&(text + &called("module.oven.point.k1", "Heater", "加热")));
    site.serve();
    let run = |columns, line: &str| {
        let text = shown(
            &site,
            columns,
            &format!("--socket {} {line}", site.socket()),
        );
        let widest = text.lines().map(UnicodeWidthStr::width).max();
        assert!(widest <= Some(usize::from(columns)), "{text}");
        text
    };
    let modules = run(80, "ls");
    assert!(modules.starts_with("MODULE  NAME       "), "{modules}");
    assert!(modules.contains("\noven    Oven hall  "), "{modules}");
    assert!(modules.contains("\ntank    水池       "), "{modules}");
    assert_eq!(modules.lines().count(), 6, "{modules}");
    assert!(run(80, "ls --lang zh").contains("\noven  炉房  "));
    assert!(run(80, "ls lines").contains("\nmain  Cellar  "));
    let points = run(80, "get oven --fresh");
    assert!(points.starts_with("oven.k1  off  Heater"), "{points}");
    assert_eq!(run(40, "ls").lines().count(), 6);
    // Where nothing has a display name, there is no column for one.
    let nameless = run(80, "get gate.do0 --fresh");
    assert!(nameless.starts_with("gate.do0  off\n"), "{nameless}");
}

/// A line of the terminal after what was shown on it before and taken away.
fn uncovered(line: &str) -> &str {
    line.rsplit("\x1b[K").next().unwrap_or_default()
}

/// The same words, broken elsewhere; nothing is left out.
#[test]
fn help_fits_itself_to_the_terminal() {
    let site = Site::empty("terminal-help");
    let words = |text: &str| {
        text.split_whitespace()
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    for line in [
        "--help",
        "set --help",
        "doctor --help",
        "--lang zh get --help",
    ] {
        let piped = site.run(line).out;
        for columns in [80, 40] {
            let text = shown(&site, columns, line);
            assert_eq!(words(&text), words(&piped), "{columns}: {text}");
        }
    }
    let narrow = shown(&site, 80, "doctor --help");
    let widest = narrow.lines().map(UnicodeWidthStr::width).max();
    assert!(widest <= Some(80), "{narrow}");
}

#[test]
fn errors_are_coloured_on_a_terminal_and_not_in_a_pipe() {
    let site = Site::empty("terminal-colour");
    let text = shown(&site, 80, "get pump");
    assert!(
        text.starts_with("\x1b[1;31merror[E0809]\x1b[0m: "),
        "{text:?}"
    );
    assert!(!site.run("get pump").err.contains('\x1b'));
}

/// An error message is broken between words on a narrow terminal, and its next lines are indented.
/// Commands and paths are not broken, and a pipe has each text on one line.
#[test]
fn errors_fit_themselves_to_the_terminal() {
    let site = Site::empty("terminal-errors");
    let path = format!(
        "{}/a-folder-with-a-name/railbus.toml",
        site.folder.display()
    );
    for line in [
        "get pump",
        "--lang zh get pump",
        "pulse pump.do0 3x",
        "-l /dev/ttyNONE -m erc8 -a 3 get erc8",
        "--lang zh -l /dev/ttyNONE -m erc8 -a 3 get erc8",
        "--lang zh -m nosuch -a 3 -l /dev/ttyNONE get erc8",
        &format!("--config {path} get pump"),
    ] {
        let piped = site.run(line).err;
        for columns in [80, 40] {
            let text = plain(&shown(&site, columns, line));
            let joined = |text: &str| text.split_whitespace().collect::<String>();
            assert_eq!(joined(&text), joined(&piped), "{columns}: {text}");
            for line in text.lines() {
                let fits = line.width() <= usize::from(columns);
                // A command or a path must be copied whole.
                let whole = line.contains("railbus -l") || line.contains(&path);
                assert!(fits || whole, "{columns}: {text}");
            }
            let labels = |text: &str| {
                let labelled = text.lines().skip(1);
                let labelled = labelled.filter(|line| !line.starts_with("          "));
                labelled.count()
            };
            assert_eq!(
                labels(&text),
                piped.lines().count() - 1,
                "{columns}: {text}"
            );
        }
    }
    let text = plain(&shown(&site, 40, "get pump"));
    assert_eq!(
        text,
        "error[E0809]: there is no configuration\n  \
         likely: no railbus.toml here, in a\n          \
         parent folder, in\n          \
         ~/.config/railbus or\n          \
         /etc/railbus\n  \
         try:    railbus serve --demo\n  \
         try:    railbus -l /dev/ttyUSB0 -m eda9060a -a 1 get eda9060a\n  \
         more:   railbus explain E0809\n"
    );
    let text = plain(&shown(&site, 40, "--lang zh get pump"));
    assert!(text.contains("\n          "), "{text}");
}

/// What is shown, without its colours.
fn plain(text: &str) -> String {
    text.replace("\x1b[1;31m", "").replace("\x1b[0m", "")
}
