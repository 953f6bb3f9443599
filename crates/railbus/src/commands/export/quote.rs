//! Texts within texts of other languages. Names may have any character.

/// A text in double quotes, as JSON, YAML, TOML and the queries of Prometheus all read it: what one
/// of them takes for the end of a line, or does not take at all, is a number.
pub(super) fn quoted(text: &str) -> String {
    let mut quoted = String::from('"');
    for char in text.chars() {
        match char {
            '"' | '\\' => quoted.extend(['\\', char]),
            char if char.is_control() || is_special(char) => {
                quoted += &format!("\\u{:04x}", u32::from(char));
            }
            char => quoted.push(char),
        }
    }
    quoted + "\""
}

/// What YAML takes for an end of a line or for no text. All of these have four digits.
fn is_special(char: char) -> bool {
    matches!(
        char,
        '\u{2028}' | '\u{2029}' | '\u{feff}' | '\u{fffe}' | '\u{ffff}'
    )
}

/// Lines of a comment that begins with `# `.
pub(super) fn comment(text: &str) -> String {
    let line = |line: &str| format!("# {line}").trim_end().to_owned() + "\n";
    text.split(|char: char| char.is_control() || is_special(char))
        .map(line)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What one of the languages means something by.
    const ODD: [&str; 12] = [
        "\u{2028}", "\u{2029}", "\u{feff}", "\u{85}", "\u{7f}", "\n", "\r\n", "\"", "\\", ": ",
        " #", "\u{ffff}",
    ];

    proptest! {
        #[test]
        fn every_text_is_itself_again(text in any::<String>(), odd in prop::sample::select(&ODD)) {
            let text = format!("{text}{odd}{text}");
            let quoted = quoted(&text);
            prop_assert_eq!(&serde_json::from_str::<String>(&quoted).unwrap(), &text);
            prop_assert_eq!(&serde_yaml_ng::from_str::<String>(&quoted).unwrap(), &text);
            let toml: toml::Table = toml::from_str(&format!("a = {quoted}")).unwrap();
            prop_assert_eq!(toml["a"].as_str(), Some(&*text));
        }

        #[test]
        fn nothing_leaves_a_comment(text in any::<String>(), odd in prop::sample::select(&ODD)) {
            let comment = comment(&format!("{text}{odd}{text}"));
            let yaml = format!("{comment}a: 1\n");
            let parsed: serde_json::Value = serde_yaml_ng::from_str(&yaml).unwrap();
            prop_assert_eq!(parsed, serde_json::json!({ "a": 1 }));
            let toml: toml::Table = toml::from_str(&format!("{comment}a = 1\n")).unwrap();
            prop_assert_eq!(toml.len(), 1);
        }
    }
}
