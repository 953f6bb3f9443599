//! The session that the README shows, run for real. `UPDATE=1` writes it anew.

#[path = "cli/site.rs"]
mod site;

use site::Site;
use std::path::{Path, PathBuf};

const BEGIN: &str = "<!-- transcript -->";

const SESSION: &[&[&str]] = &[
    &["scan", "--addr", "1-8"],
    &["ls"],
    &["set", "pump.do0", "on"],
    &["set", "yard", "1,3=on"],
    &["pulse", "yard.k2", "500ms"],
    &["get", "pump"],
    &["set", "oven.k9", "on"],
    &["config", "set", "pump", "address=9", "--yes"],
    &["config", "undo", "--yes"],
];

/// What differs from run to run is made the same: times, counts of errors on a busy machine, the
/// inputs of the demo, which move, and the width of columns that hold these.
fn calm(text: &str) -> String {
    let mut calm = String::new();
    for line in text.lines() {
        // On a busy machine a reply may be late.
        let late = line.split_once(" late)");
        let late = late.and_then(|(before, after)| Some((before.rsplit_once(" (")?.0, after)));
        let line = late.map_or(line.to_owned(), |(before, after)| {
            format!("{before}{after}")
        });
        let mut words: Vec<&str> = line.split_whitespace().collect();
        for at in 1..words.len() {
            let is_number = |word: &str| word.parse::<f64>().is_ok();
            if words[at] == "ms" && is_number(words[at - 1]) {
                words[at - 1] = "20";
                if let Some(errors) = words.get_mut(at + 1).filter(|word| is_number(word)) {
                    *errors = "0";
                }
            }
        }
        if let Some(inputs) = words.last_mut()
            && (4..=7).contains(&inputs.len())
            && inputs.bytes().all(|bit| bit == b'0' || bit == b'1')
        {
            *inputs = "inputs";
        }
        let is_input = |word: &&str| word.contains(".di");
        if words.first().is_some_and(is_input) && words.len() > 1 {
            words[1] = "0";
        }
        calm += &words.join(" ");
        calm.push('\n');
    }
    calm
}

fn session() -> String {
    let site = Site::served("transcript");
    let mut text = String::from("```console\n");
    for words in SESSION {
        text += &format!("$ railbus {}\n", words.join(" "));
        let socket = site.socket();
        // A busy machine that runs the tests may be slower than a module.
        let flags = ["--socket", &socket, "--timeout", "200ms"];
        let ran = site.run_with(&[words, &flags[..]].concat(), "");
        let shown = if ran.code == 0 { ran.out } else { ran.err };
        text += shown.trim_end();
        text.push('\n');
    }
    text + "```\n"
}

fn readme() -> PathBuf {
    root().join("README.md")
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Input beyond what is printed, so that it comes to its end.
const ENDS: [(&str, &str); 3] = [
    ("config set", " --yes"),
    ("sniff", " --time 500ms"),
    ("scan -l", " --addr 1-3"),
];
/// It serves the line that the commands on a port are tried on.
const SERVES: &str = "sim --demo";

/// The commands of a page, in its order: in blocks and in sentences.
fn commands(text: &str) -> Vec<&str> {
    let pieces = text.split(['`', '\n']).map(str::trim);
    pieces
        .filter_map(|piece| piece.trim_start_matches("$ ").strip_prefix("railbus "))
        .filter(|command| *command != SERVES)
        .collect()
}

/// Every command that a page of the root names does what it says, one after the other.
fn runs(name: &str, file: &str, from: &str, to: &str) {
    let Ok(page) = std::fs::read_to_string(root().join(file)) else {
        return;
    };
    let (_, text) = page.rsplit_once(from).expect("it begins");
    let (text, _) = text.split_once(to).expect("it ends");
    let site = Site::served(name);
    let ports = Site::demo(&format!("{name}-port"));
    let port = format!("pty:{}", ports.folder.join("line").display());
    let commands = commands(text);
    for wanted in ["config set pump address=9", "doctor", "sniff"] {
        assert!(commands.contains(&wanted), "{wanted}: {commands:?}");
    }
    for command in commands {
        let more = ENDS.iter().find(|(start, _)| command.starts_with(start));
        let line = command.replace("/dev/ttyUSB0", &port) + more.map_or("", |(_, more)| more);
        let ran = match line == command || !command.contains("/dev/") {
            true => site.run(&format!("--socket {} {line}", site.socket())),
            false => ports.run(&line),
        };
        if command == "doctor" {
            // Its findings depend on the machine.
            assert!(ran.out.contains("running for the demo"), "{line}: {ran:?}");
            continue;
        }
        assert_eq!(ran.code, 0, "{line}: {ran:?}");
        assert_ne!(ran.out, "", "{line}: {ran:?}");
    }
}

#[test]
fn every_command_that_the_readme_names_runs() {
    runs("named", "README.md", BEGIN, "\n## Test it");
}

#[test]
fn every_command_that_the_chinese_readme_names_runs() {
    runs(
        "named-zh",
        "README.zh-CN.md",
        "cargo xtask demo\n",
        "\n## 测试",
    );
}

#[test]
fn the_readme_shows_what_happens() {
    let session = session();
    assert!(
        session.contains("EDA9060A") && session.contains("→ on"),
        "{session}"
    );
    let Ok(page) = std::fs::read_to_string(readme()) else {
        return;
    };
    let Some((before, rest)) = page.split_once(BEGIN) else {
        return;
    };
    let (shown, after) = rest
        .split_once(BEGIN)
        .expect("the mark stands at both ends");
    if std::env::var_os("UPDATE").is_some() {
        let page = format!("{before}{BEGIN}\n{session}{BEGIN}{after}");
        std::fs::write(readme(), page).expect("the README is ours");
        return;
    }
    assert_eq!(
        calm(shown.trim()),
        calm(session.trim()),
        "UPDATE=1 writes it anew"
    );
}
