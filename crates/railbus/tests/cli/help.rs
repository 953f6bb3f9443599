//! The help of every command as it is, in both languages: a change of a text is seen where it is
//! reviewed. `UPDATE=1` writes the files anew.

use crate::site::Site;
use std::collections::BTreeSet;
use std::path::PathBuf;
use unicode_width::UnicodeWidthStr;

fn folder(lang: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/help")
        .join(lang)
}

/// The commands that the help lists, and those below them.
fn commands(site: &Site, before: &str) -> Vec<String> {
    let help = site.run(format!("{before} --help").trim()).out;
    let mut lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let mut found = Vec::new();
    while let Some(line) = lines.next().filter(|line| !line.is_empty()) {
        let name = line.trim_start().split(' ').next().unwrap_or_default();
        // A description that goes on in the next line stands further in.
        if line.starts_with("  ") && !line.starts_with("   ") {
            let path = format!("{before} {name}").trim().to_owned();
            found.extend(commands(site, &path));
            found.push(path);
        }
    }
    found
}

#[test]
fn the_help_of_every_command_is_as_reviewed() {
    let site = Site::empty("help");
    let mut all = commands(&site, "");
    assert!(all.len() >= 20, "{all:?}");
    all.push(String::new());
    let update = std::env::var_os("UPDATE").is_some();
    for lang in ["en", "zh"] {
        let mut files = BTreeSet::new();
        for command in &all {
            let name = if command.is_empty() {
                "railbus"
            } else {
                command
            };
            let file = folder(lang).join(format!("{}.txt", name.replace(' ', "-")));
            let ran = site.run(
                format!("--lang {lang} {command} --help")
                    .replace("  ", " ")
                    .trim(),
            );
            assert_eq!((ran.code, ran.err.as_str()), (0, ""), "{command}");
            let wide = ran.out.lines().find(|line| line.width() > 80);
            assert_eq!(wide, None, "{lang} {command}: more than 80 columns");
            if update {
                std::fs::write(&file, &ran.out).expect("a file");
            }
            let reviewed = std::fs::read_to_string(&file).unwrap_or_default();
            assert!(
                reviewed == ran.out,
                "{}: UPDATE=1 writes it:\n{}",
                file.display(),
                ran.out
            );
            files.insert(file);
        }
        for entry in std::fs::read_dir(folder(lang)).expect("a folder") {
            let path = entry.expect("a file").path();
            assert!(files.contains(&path), "{} is of no command", path.display());
        }
    }
}

#[test]
fn help_says_the_same_as_the_flag() {
    let site = Site::empty("help-same");
    for command in ["set", "ls", "config check"] {
        let flag = site.run(&format!("{command} --help")).out;
        assert_eq!(site.run(&format!("help {command}")).out, flag, "{command}");
    }
    assert_eq!(site.run("help").out, site.run("--help").out);
    for topic in ["exit-codes", "addressing", "units", "protocols", "safety"] {
        for lang in ["en", "zh"] {
            let ran = site.run(&format!("--lang {lang} help {topic}"));
            let widest = ran.out.lines().map(UnicodeWidthStr::width).max();
            assert!(
                ran.code == 0 && widest <= Some(100),
                "{topic}: {widest:?}: {ran:?}"
            );
        }
    }
}
