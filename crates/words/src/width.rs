//! Text in terminal columns, where a Chinese character takes two.

use rustix::termios::tcgetwinsize;
use std::io::IsTerminal;
use std::os::fd::AsFd;
use unicode_width::{UnicodeWidthChar, UnicodeWidthStr};

/// Below this width, text is not wrapped.
const ROOM_MIN: usize = 10;

/// Characters that must not begin a line, and those that must not end one.
const CLOSING: &str = "，。；：、！？）》」”…·,.;:!?)";
const OPENING: &str = "（《「“(";

/// The number of columns of the terminal that standard output goes to; `None` if it goes elsewhere,
/// and nothing needs to fit.
pub fn terminal() -> Option<usize> {
    of_stream(&std::io::stdout())
}

/// The same for the terminal of standard error.
pub fn of_errors() -> Option<usize> {
    of_stream(&std::io::stderr())
}

fn of_stream(stream: &(impl IsTerminal + AsFd)) -> Option<usize> {
    let size = stream.is_terminal().then(|| tcgetwinsize(stream).ok())??;
    (size.ws_col > 0).then_some(usize::from(size.ws_col))
}

/// The number of columns of a text.
pub fn of(text: &str) -> usize {
    text.width()
}

/// The text, padded with blanks to a width.
pub fn pad(text: &str, width: usize) -> String {
    let missing = width.saturating_sub(of(text));
    format!("{text}{}", " ".repeat(missing))
}

/// The text wrapped to this many columns, between words and between Chinese characters. What people
/// copy is not broken: a word such as a path, quoted text, a flag and its value, and a command at
/// the beginning of the text, up to two blanks. If such a piece alone is wider than the line, it is
/// printed as it is.
pub fn wrap(text: &str, room: Option<usize>) -> Vec<String> {
    let Some(room) = room.filter(|room| *room >= ROOM_MIN) else {
        return vec![text.to_owned()];
    };
    let mut lines = Vec::new();
    for text in text.split('\n') {
        let mut line = String::new();
        let mut begun = 0;
        for end in breaks(text, room) {
            // The blanks before it are printed if it does not begin a line.
            let piece = text.get(begun..end).unwrap_or_default();
            begun = end;
            if !line.is_empty() && of(&line) + of(piece.trim_end()) > room {
                lines.push(std::mem::take(&mut line).trim_end().to_owned());
            }
            line += match line.is_empty() {
                true => piece.trim_start(),
                false => piece,
            };
        }
        lines.push(line.trim_end().to_owned());
    }
    lines
}

/// A text after its label, within this many columns, if they are limited. The text wraps below its
/// own beginning.
pub fn hang(label: &str, text: &str, columns: Option<usize>) -> String {
    let margin = label.lines().last().map_or(0, of);
    let room = columns.map(|columns| columns.saturating_sub(margin));
    let lines = wrap(text, room);
    label.to_owned()
        + &lines.join(&format!(
            "
{}",
            " ".repeat(margin)
        ))
}

/// Where the unbreakable pieces of a text end.
fn breaks(text: &str, room: usize) -> Vec<usize> {
    let command = ["railbus ", "ssh "]
        .iter()
        .any(|name| text.starts_with(name));
    let mut whole_until = match command {
        true => text.find("  ").unwrap_or(text.len()),
        false => 0,
    };
    let mut ends = Vec::new();
    let mut word = 0;
    let mut last = ' ';
    for (at, next) in text.char_indices() {
        let rest = text.get(at..).unwrap_or_default();
        if at > 0
            && at >= whole_until
            && may_part(text.get(word..at).unwrap_or_default(), last, rest)
        {
            ends.push(at);
            word = at;
        }
        if at >= whole_until
            && let Some(length) = quoted(last, rest)
            && of(rest.get(..length).unwrap_or_default()) <= room
        {
            whole_until = at + length;
        }
        last = next;
    }
    ends.push(text.len());
    ends
}

/// Whether a line may end after this word, of which `last` is the last character.
fn may_part(word: &str, last: char, rest: &str) -> bool {
    let Some(next) = rest.chars().next().filter(|next| *next != ' ') else {
        return false;
    };
    if CLOSING.contains(next) || OPENING.contains(last) {
        return false;
    }
    let is_wide = |c: char| c.width() == Some(2);
    match last {
        ' ' => !(word.starts_with('-') && word.trim_end().len() > 1 && !rest.starts_with('-')),
        last => is_wide(last) || is_wide(next),
    }
}

/// The length of a quoted piece, including the quotes, if it begins here.
fn quoted(last: char, rest: &str) -> Option<usize> {
    let opening = rest.chars().next()?;
    let closing = match opening {
        '"' | '`' if !last.is_alphanumeric() => opening,
        '“' => '”',
        _ => return None,
    };
    let inside = rest.get(opening.len_utf8()..)?;
    let length = inside.find(closing)?;
    Some(opening.len_utf8() + length + closing.len_utf8())
}

/// Whether a letter of a text that came from elsewhere may be shown: it controls no terminal, and
/// does not turn the direction of others, which could change what is read.
pub fn is_shown(letter: char) -> bool {
    let turns = matches!(
        letter,
        '\u{200E}'..='\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}'
    );
    !letter.is_control() && !turns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_broken_between_words_and_between_chinese_characters() {
        let wrapped = |text: &str, room| wrap(text, Some(room));
        let english = "no railbus.toml here, in a parent folder";
        assert_eq!(
            wrapped(english, 21),
            ["no railbus.toml here,", "in a parent folder"]
        );
        assert_eq!(
            wrapped(english, 20),
            ["no railbus.toml", "here, in a parent", "folder"]
        );
        assert_eq!(wrap(english, None), [english]);
        assert_eq!(wrapped(english, 9), [english]);
        // No line begins with closing punctuation, nor ends with opening punctuation.
        assert_eq!(
            wrapped("转换器未插好，重新插入", 12),
            ["转换器未插", "好，重新插入"]
        );
        assert_eq!(wrapped("转换器未（插好）", 10), ["转换器未", "（插好）"]);
        assert_eq!(wrapped("one · two · three", 11), ["one · two ·", "three"]);
        assert_eq!(wrapped("one\ntwo", 40), ["one", "two"]);
        assert_eq!(wrapped("", 40), [""]);
    }

    #[test]
    fn what_people_copy_is_not_broken() {
        let wrapped = |text: &str, room| wrap(text, Some(room));
        let path = "/run/user/1000/railbus/main.sock";
        assert_eq!(
            wrapped(&format!("see {path} there"), 20),
            ["see", path, "there"]
        );
        assert_eq!(
            wrapped("ask with `railbus ls points` there", 20),
            ["ask with", "`railbus ls points`", "there"]
        );
        assert_eq!(
            wrapped("请见手册“railbus.toml 文件”一页", 20),
            ["请见手册", "“railbus.toml 文件”", "一页"]
        );
        // A piece that is longer than a line is broken like everything else, and so is an unclosed
        // quote.
        assert_eq!(
            wrapped("say \"one two three\"", 12),
            ["say \"one two", "three\""]
        );
        assert_eq!(
            wrapped("5\" or \"six and so on", 12),
            ["5\" or \"six", "and so on"]
        );
        assert_eq!(
            wrapped("name it: -l /dev/ttyUSB0 -m erc8 -a 3", 34),
            ["name it: -l /dev/ttyUSB0 -m erc8", "-a 3"]
        );
        let command = "railbus -l /dev/ttyUSB0 -m erc8 -a 3 get erc8";
        assert_eq!(wrapped(command, 20), [command]);
        assert_eq!(
            wrapped("railbus config show MODULE   lists the values", 28),
            ["railbus config show MODULE", "lists the values"]
        );
    }

    #[test]
    fn what_does_not_fit_goes_on_below_its_own_text() {
        let text = "wrong address or no supply";
        assert_eq!(
            hang("\n  likely: ", text, Some(26)),
            "\n  likely: wrong address or\n          no supply"
        );
        assert_eq!(hang("why: ", text, None), format!("why: {text}"));
        assert_eq!(hang("why: ", "a\nb", Some(26)), "why: a\n     b");
        assert_eq!(hang("why: ", text, Some(3)), format!("why: {text}"));
    }

    #[test]
    fn chinese_characters_take_two_columns() {
        assert_eq!(of("模块"), 4);
        assert_eq!(pad("模块", 6), "模块  ");
        assert_eq!(pad("module", 4), "module");
    }
}
