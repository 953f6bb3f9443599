//! Rust source as the checks need it: code, comments and literals distinguished, and test code
//! known.
//!
//! This is a lexer, no parser: it sees brackets and attributes, not types. That is enough to know
//! whether a word is in code or in text, and where an item ends.

use std::ops::Range;

/// What a byte of source belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Code,
    Comment,
    Literal,
}

/// One Rust file. The views have the length and the line ends of the text; what does not belong to
/// a view is blank.
#[derive(Debug)]
pub(crate) struct Source<'a> {
    text: &'a str,
    /// Only code.
    code: String,
    /// Only comments.
    comments: String,
    /// Bytes of items that only tests see.
    test_only: Vec<Range<usize>>,
}

/// Prefixes of attributes that make a function a test.
const TEST_ATTRIBUTES: &[&str] = &["#[test]", "#[tokio::test", "#[rstest", "#[test_case"];

impl<'a> Source<'a> {
    /// Splits a file. Any text is accepted: what is not Rust gives blank or odd views, no failure.
    pub(crate) fn parse(text: &'a str) -> Self {
        let kinds = kinds(text);
        let code = view(text, &kinds, Kind::Code);
        let comments = view(text, &kinds, Kind::Comment);
        let test_only = ["#[cfg(test)]", "#[cfg(all(test,"]
            .iter()
            .flat_map(|mark| code.match_indices(mark))
            .map(|(start, mark)| start..item_end(&code, start + mark.len()))
            .collect();
        Self {
            text,
            code,
            comments,
            test_only,
        }
    }

    /// The lines as written, with their numbers from 1.
    pub(crate) fn lines(&self) -> impl Iterator<Item = (usize, &'a str)> {
        numbered(self.text)
    }

    /// The code, for searches over several lines.
    pub(crate) fn code(&self) -> &str {
        &self.code
    }

    /// Code lines outside `#[cfg(test)]`.
    pub(crate) fn shipped_lines(&self) -> impl Iterator<Item = (usize, &str)> {
        let mut start = 0;
        let placed = self.code.split('\n').enumerate().map(move |(index, line)| {
            let at = start;
            start += line.len() + 1;
            (index + 1, at, line)
        });
        placed
            .filter(|&(_, at, _)| self.is_shipped(at))
            .map(|(number, _, line)| (number, line))
    }

    /// Whether the byte is outside `#[cfg(test)]`.
    pub(crate) fn is_shipped(&self, at: usize) -> bool {
        !self.test_only.iter().any(|range| range.contains(&at))
    }

    /// All code lines.
    pub(crate) fn code_lines(&self) -> impl Iterator<Item = (usize, &str)> {
        numbered(&self.code)
    }

    /// All comment lines.
    pub(crate) fn comment_lines(&self) -> impl Iterator<Item = (usize, &str)> {
        numbered(&self.comments)
    }

    /// The line of a byte, from 1.
    pub(crate) fn line_at(&self, at: usize) -> usize {
        1 + self.text.as_bytes()[..at]
            .iter()
            .filter(|&&byte| byte == b'\n')
            .count()
    }

    /// Each test function as written, with the comments and attributes directly above it.
    pub(crate) fn test_functions(&self) -> Vec<&'a str> {
        let marks = TEST_ATTRIBUTES
            .iter()
            .flat_map(|mark| self.code.match_indices(mark));
        marks
            .map(|(at, mark)| {
                let end = item_end(&self.code, at + mark.len());
                &self.text[self.comment_start(at)..end]
            })
            .collect()
    }

    /// Where the comments and attributes directly above the line of a byte begin.
    fn comment_start(&self, at: usize) -> usize {
        let line_start = |end: usize| self.text[..end].rfind('\n').map_or(0, |found| found + 1);
        let mut start = line_start(at);
        while start > 0 {
            let above = line_start(start - 1);
            let code = self.code[above..start].trim();
            let comment = self.comments[above..start].trim();
            let belongs = if code.is_empty() {
                !comment.is_empty()
            } else {
                code.starts_with("#[")
            };
            if !belongs {
                break;
            }
            start = above;
        }
        start
    }
}

/// The position of `word` in `line` as a whole word: `std::` is not in `my_std::`.
pub(crate) fn find_word(line: &str, word: &str) -> Option<usize> {
    let in_name = |c: char| c.is_alphanumeric() || c == '_';
    let ends_in_name = |text: &str| text.chars().next_back().is_some_and(in_name);
    let starts_in_name = |text: &str| text.chars().next().is_some_and(in_name);
    // There is no word boundary only if the characters on both sides could be part of one name.
    line.match_indices(word).map(|(at, _)| at).find(|&at| {
        let goes_on_before = starts_in_name(word) && ends_in_name(&line[..at]);
        let goes_on_after = ends_in_name(word) && starts_in_name(&line[at + word.len()..]);
        !goes_on_before && !goes_on_after
    })
}

fn numbered(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.split('\n')
        .enumerate()
        .map(|(index, line)| (index + 1, line))
}

/// Blanks every byte that is not of this kind, except line ends.
fn view(text: &str, kinds: &[Kind], wanted: Kind) -> String {
    let blank = |(byte, &kind): (u8, &Kind)| match byte {
        b'\n' => b'\n',
        _ if kind == wanted => byte,
        _ => b' ',
    };
    let bytes = text.bytes().zip(kinds).map(blank).collect();
    // Kinds change at ASCII characters only, so no character is cut.
    String::from_utf8(bytes).unwrap_or_default()
}

fn kinds(text: &str) -> Vec<Kind> {
    let bytes = text.as_bytes();
    let mut kinds = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        let (kind, end) = piece(text, at);
        kinds.resize(end, kind);
        at = end;
    }
    kinds
}

/// Kind and end of what begins at a byte.
fn piece(text: &str, at: usize) -> (Kind, usize) {
    let rest = &text.as_bytes()[at..];
    let from = |len: usize| (at + len).min(text.len());
    match rest {
        [b'/', b'/', ..] => (
            Kind::Comment,
            text[at..].find('\n').map_or(text.len(), |len| at + len),
        ),
        [b'/', b'*', ..] => (Kind::Comment, from(block_comment(rest))),
        [b'"', ..] => (Kind::Literal, from(string(rest))),
        [b'r', ..] => match raw_string(text, at) {
            Some(len) => (Kind::Literal, from(len)),
            None => (Kind::Code, at + 1),
        },
        [b'\'', ..] => match character(&text[at..]) {
            Some(len) => (Kind::Literal, from(len)),
            None => (Kind::Code, at + 1),
        },
        _ => (Kind::Code, at + 1),
    }
}

/// Length of a block comment; they nest.
fn block_comment(bytes: &[u8]) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < bytes.len() {
        let step = match &bytes[at..] {
            [b'/', b'*', ..] => 1,
            [b'*', b'/', ..] => -1,
            _ => 0,
        };
        depth += step;
        at += if step == 0 { 1 } else { 2 };
        if depth == 0 {
            break;
        }
    }
    at
}

/// Length of a string with escapes, from its first quote.
fn string(bytes: &[u8]) -> usize {
    let mut at = 1;
    while at < bytes.len() && bytes[at] != b'"' {
        at += if bytes[at] == b'\\' { 2 } else { 1 };
    }
    at + 1
}

/// Length of a raw string from its `r`, if that is what begins here.
fn raw_string(text: &str, at: usize) -> Option<usize> {
    let prefix = text[..at].trim_end_matches(['b', 'c']);
    let in_name = |c: char| c.is_alphanumeric() || c == '_';
    if prefix.chars().next_back().is_some_and(in_name) || at - prefix.len() > 1 {
        return None;
    }
    let body = &text[at + 1..];
    let hashes = body.len() - body.trim_start_matches('#').len();
    let body = body[hashes..].strip_prefix('"')?;
    let close = format!("\"{}", "#".repeat(hashes));
    let len = body
        .find(&close)
        .map_or(body.len(), |found| found + close.len());
    Some(1 + hashes + 1 + len)
}

/// Length of a character literal, or nothing for a lifetime.
fn character(text: &str) -> Option<usize> {
    let first = text[1..].chars().next()?;
    if first == '\\' {
        // Past the escaped character, which may itself be a quote.
        return text.get(3..)?.find('\'').map(|found| 3 + found + 1);
    }
    let end = 1 + first.len_utf8();
    (text.as_bytes().get(end) == Some(&b'\'')).then_some(end + 1)
}

/// Where the item after an attribute ends: at its closing brace, at a semicolon, or before the
/// brace that closes what contains it.
fn item_end(code: &str, start: usize) -> usize {
    let (mut braces, mut others) = (0, 0);
    for (at, byte) in code.bytes().enumerate().skip(start) {
        match byte {
            b'(' | b'[' => others += 1,
            b')' | b']' => others -= 1,
            b'{' => braces += 1,
            b'}' if braces == 0 => return at,
            b'}' => braces -= 1,
            b';' if braces == 0 && others <= 0 => return at + 1,
            _ => {}
        }
        if byte == b'}' && braces == 0 && others <= 0 {
            return at + 1;
        }
    }
    code.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strings_and_comments_are_no_code() {
        let text = "let a = \"std:: \\\" unsafe\"; // unsafe\n\
                    let b = r#\"x\"unsafe\"#; /* a /* b */ c */ d";
        let source = Source::parse(text);
        assert!(!source.code().contains("unsafe"));
        assert!(!source.code().contains(" c "), "block comments nest");
        assert!(source.code().ends_with(" d"));
        assert_eq!(source.comment_lines().next().unwrap().1.trim(), "// unsafe");
    }

    #[test]
    fn a_lifetime_is_no_character() {
        let source = Source::parse("fn f<'a>(x: &'a str) { g('\"', '\\'', 'é', b'x'); unsafe_() }");
        assert!(source.code().contains("fn f<'a>(x: &'a str)"));
        assert!(
            source.code().contains("unsafe_()"),
            "the quote in a character opens no string"
        );
    }

    #[test]
    fn test_code_ends_where_its_item_ends() {
        let text = "#[cfg(test)]\nextern crate std;\nfn a() {}\n\
                    #[cfg(test)]\nmod t {\n  fn b() {}\n}\nfn c() {}\n";
        let source = Source::parse(text);
        let shipped: Vec<usize> = source
            .shipped_lines()
            .filter(|(_, line)| !line.trim().is_empty())
            .map(|(number, _)| number)
            .collect();
        assert_eq!(shipped, [3, 8]);
    }

    #[test]
    fn a_test_function_has_the_comments_above_it() {
        let text = "// [far]\n\n/// [near]\n#[should_panic]\n#[test]\n\
                    fn a() {\n // [inside]\n}\n// [after]\n";
        assert_eq!(
            Source::parse(text).test_functions(),
            ["/// [near]\n#[should_panic]\n#[test]\nfn a() {\n // [inside]\n}"]
        );
    }

    #[test]
    fn words_have_borders() {
        assert_eq!(find_word("use my_std::x; std::y", "std::"), Some(15));
        assert_eq!(find_word("#![forbid(unsafe_code)]", "unsafe"), None);
    }
}
