//! Text in columns of a terminal, where a Chinese character takes two.

use rustix::termios::tcgetwinsize;
use std::io::IsTerminal;
use unicode_width::UnicodeWidthStr;

/// How many columns the terminal has that the result goes to; none where it goes elsewhere, and
/// nothing needs to fit.
pub(crate) fn terminal() -> Option<usize> {
    let stdout = std::io::stdout();
    let size = stdout.is_terminal().then(|| tcgetwinsize(&stdout).ok())??;
    (size.ws_col > 0).then_some(usize::from(size.ws_col))
}

/// How many columns a text takes.
pub(crate) fn of(text: &str) -> usize {
    text.width()
}

/// The text with blanks behind it up to a width.
pub(crate) fn pad(text: &str, width: usize) -> String {
    let missing = width.saturating_sub(of(text));
    format!("{text}{}", " ".repeat(missing))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chinese_characters_take_two_columns() {
        assert_eq!(of("模块"), 4);
        assert_eq!(pad("模块", 6), "模块  ");
        assert_eq!(pad("module", 4), "module");
    }
}
