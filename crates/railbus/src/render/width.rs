//! Text in columns of a terminal, where a Chinese character takes two.

use unicode_width::UnicodeWidthStr;

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
