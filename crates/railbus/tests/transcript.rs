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
];

/// What differs from run to run is the same in all: times, counts of errors on a busy machine,
/// the inputs of the demo, which move, and the width of columns that hold these.
fn calm(text: &str) -> String {
    let mut calm = String::new();
    for line in text.lines() {
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
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../README.md")
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
