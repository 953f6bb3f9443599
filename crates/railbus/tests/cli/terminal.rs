//! Terminals of 80 and 40 columns, and none at all.

use crate::site::Site;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};
use std::fs::{File, OpenOptions};
use std::io::Read;
use unicode_width::UnicodeWidthStr;

/// What a run shows on a terminal of so many columns.
fn shown(site: &Site, columns: u16, line: &str) -> String {
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
    // The end is an error here: nobody has the other side open any more.
    let _ = File::from(master).read_to_end(&mut text);
    child.wait().expect("it ends");
    String::from_utf8(text).expect("text").replace("\r\n", "\n")
}

#[test]
fn a_table_that_does_not_fit_is_told_row_by_row() {
    let site = Site::empty("terminal-table");
    let piped = site.run("ls models").out;
    let widest = piped
        .lines()
        .map(UnicodeWidthStr::width)
        .max()
        .expect("lines");
    let wide = shown(&site, u16::try_from(widest).expect("small"), "ls models");
    assert_eq!(wide, piped);
    for columns in [80, 40] {
        for lang in ["en", "zh"] {
            let text = shown(&site, columns, &format!("--lang {lang} ls models"));
            let widest = text.lines().map(UnicodeWidthStr::width).max();
            assert!(widest <= Some(usize::from(columns)), "{columns}: {text}");
            assert!(text.contains("eda9060a"), "{text}");
        }
    }
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
