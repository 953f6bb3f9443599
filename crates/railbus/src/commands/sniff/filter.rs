//! Filters in words: `addr=3 and (bad or refused)`, `not read`, `slow>50ms`.
//!
//! ```text
//! any    = all { "or" all }
//! all    = one { "and" one }
//! one    = "not" one | "(" any ")" | word | key ("=" | "!=") value | key (">" | "<") time
//! ```

use super::texts::SniffText;
use crate::commands::context;
use railbus_app::frames::Facts;
use railbus_sniff::{FrameRole, FrameVerdict};
use railbus_wire::{Micros, Protocol};
use railbus_words::Lang;

/// The longest filter in bytes, which also bounds how deep it nests.
const LEN_MAX: usize = 500;

/// What is shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::commands) enum Filter {
    Not(Box<Filter>),
    All(Vec<Filter>),
    Any(Vec<Filter>),
    Word(Word),
    Address(u8),
    Protocol(Protocol),
    Module(String),
    /// The response time, or the gap, is longer than this.
    Longer(Time, Micros),
    /// It is shorter.
    Shorter(Time, Micros),
}

/// A word without a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::commands) enum Word {
    Good,
    Bad,
    Refused,
    Unknown,
    Missing,
    Request,
    Reply,
    Write,
    Read,
    Late,
    Ambiguous,
}

/// Which time is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::commands) enum Time {
    Reply,
    Gap,
}

const WORDS: [(&str, Word); 14] = [
    ("ok", Word::Good),
    ("bad", Word::Bad),
    ("refused", Word::Refused),
    ("exception", Word::Refused),
    ("unknown", Word::Unknown),
    ("missing", Word::Missing),
    ("timeout", Word::Missing),
    ("request", Word::Request),
    ("reply", Word::Reply),
    ("write", Word::Write),
    ("read", Word::Read),
    ("poll", Word::Read),
    ("late", Word::Late),
    ("ambiguous", Word::Ambiguous),
];

/// Where a filter is wrong, in characters from 1, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::commands) struct Wrong {
    at: usize,
    near: String,
    why: SniffText,
}

impl Wrong {
    pub(in crate::commands) fn told(&self, lang: Lang) -> String {
        let why = lang.get(self.why);
        let values: &[(&str, &dyn std::fmt::Display)] =
            &[("at", &self.at), ("near", &self.near), ("why", &why)];
        lang.fill(SniffText::FilterWrong, values)
    }
}

impl Filter {
    /// Parses a filter.
    pub(in crate::commands) fn parse(text: &str) -> Result<Filter, Wrong> {
        if text.len() > LEN_MAX {
            return Err(Wrong {
                at: LEN_MAX,
                near: String::new(),
                why: SniffText::FilterLong,
            });
        }
        let mut parser = Parser {
            tokens: tokens(text),
            next: 0,
            end: text.chars().count() + 1,
        };
        let filter = parser.any()?;
        match parser.peek() {
            None => Ok(filter),
            Some(_) => Err(parser.wrong(SniffText::FilterJoin)),
        }
    }

    /// Whether something received matches.
    pub(in crate::commands) fn wants(&self, facts: &Facts<'_>) -> bool {
        let time = |time: &Time| match time {
            Time::Reply => facts.after,
            Time::Gap => facts.gap,
        };
        match self {
            Filter::Not(inner) => !inner.wants(facts),
            Filter::All(all) => all.iter().all(|one| one.wants(facts)),
            Filter::Any(any) => any.iter().any(|one| one.wants(facts)),
            Filter::Address(address) => facts.address == Some(*address),
            Filter::Protocol(protocol) => facts.protocols.contains(protocol),
            Filter::Module(name) => facts.module == Some(name),
            Filter::Longer(which, limit) => time(which).is_some_and(|time| time > *limit),
            Filter::Shorter(which, limit) => time(which).is_some_and(|time| time < *limit),
            Filter::Word(word) => match word {
                Word::Good => facts.verdict == Some(FrameVerdict::Good),
                Word::Bad => matches!(facts.verdict, Some(FrameVerdict::Bad(_))),
                Word::Refused => facts.verdict == Some(FrameVerdict::Refused),
                Word::Unknown => facts.verdict == Some(FrameVerdict::Unknown),
                Word::Missing => facts.verdict.is_none(),
                Word::Request => facts.role == Some(FrameRole::Request),
                Word::Reply => facts.role == Some(FrameRole::Reply),
                Word::Write => facts.write == Some(true),
                Word::Read => facts.write == Some(false),
                Word::Late => facts.late,
                Word::Ambiguous => facts.protocols.len() > 1,
            },
        }
    }
}

/// A token of a filter and its position, in characters from 1.
#[derive(Clone, Debug)]
struct Token {
    text: String,
    at: usize,
}

/// Words, and the operators between them.
fn tokens(text: &str) -> Vec<Token> {
    let mut tokens: Vec<Token> = Vec::new();
    let mut fresh = true;
    for (index, letter) in text.chars().enumerate() {
        let at = index + 1;
        if letter.is_whitespace() {
            fresh = true;
            continue;
        }
        let sign = "()=<>!".contains(letter);
        match tokens.last_mut() {
            Some(last) if !fresh && !sign => last.text.push(letter),
            Some(last) if letter == '=' && last.text == "!" && last.at + 1 == at => {
                last.text.push(letter);
            }
            _ => tokens.push(Token {
                text: letter.to_string(),
                at,
            }),
        }
        fresh = sign;
    }
    tokens
}

struct Parser {
    tokens: Vec<Token>,
    next: usize,
    /// The position after the last character.
    end: usize,
}

impl Parser {
    fn peek(&self) -> Option<&str> {
        self.tokens.get(self.next).map(|token| token.text.as_str())
    }

    fn take(&mut self, wanted: &str) -> bool {
        let found = self.peek() == Some(wanted);
        self.next += usize::from(found);
        found
    }

    /// The error that the next token is not what is expected there.
    fn wrong(&self, why: SniffText) -> Wrong {
        let token = self.tokens.get(self.next);
        Wrong {
            at: token.map_or(self.end, |token| token.at),
            near: token.map(|token| token.text.clone()).unwrap_or_default(),
            why,
        }
    }

    fn any(&mut self) -> Result<Filter, Wrong> {
        let mut any = vec![self.all()?];
        while self.take("or") {
            any.push(self.all()?);
        }
        Ok(one_or(any, Filter::Any))
    }

    fn all(&mut self) -> Result<Filter, Wrong> {
        let mut all = vec![self.one()?];
        while self.take("and") {
            all.push(self.one()?);
        }
        Ok(one_or(all, Filter::All))
    }

    fn one(&mut self) -> Result<Filter, Wrong> {
        if self.take("not") {
            return self.one().map(|inner| Filter::Not(Box::new(inner)));
        }
        if self.take("(") {
            let inner = self.any()?;
            return match self.take(")") {
                true => Ok(inner),
                false => Err(self.wrong(SniffText::FilterClose)),
            };
        }
        let Some(word) = self.peek().map(str::to_owned) else {
            return Err(self.wrong(SniffText::FilterEnds));
        };
        if let Some((_, known)) = WORDS.iter().find(|(name, _)| *name == word) {
            self.next += 1;
            return Ok(Filter::Word(*known));
        }
        match word.as_str() {
            "addr" | "address" | "proto" | "protocol" | "module" => self.equality(&word),
            "slow" | "gap" => self.comparison(&word),
            _ => Err(self.wrong(SniffText::FilterWord)),
        }
    }

    fn equality(&mut self, key: &str) -> Result<Filter, Wrong> {
        self.next += 1;
        let not = self.take("!=");
        if !not && !self.take("=") {
            return Err(self.wrong(SniffText::FilterEquals));
        }
        let value = self.peek().unwrap_or_default().to_owned();
        let (found, why) = match key {
            "addr" | "address" => {
                let address = railbus_app::address(&value).ok().map(Filter::Address);
                (address, SniffText::FilterAddress)
            }
            "module" => {
                let name = (!value.is_empty()).then_some(Filter::Module(value));
                (name, SniffText::FilterEnds)
            }
            _ => {
                let known = Protocol::ALL
                    .into_iter()
                    .find(|known| known.name() == value);
                (known.map(Filter::Protocol), SniffText::FilterProtocol)
            }
        };
        let filter = found.ok_or_else(|| self.wrong(why))?;
        self.next += 1;
        Ok(match not {
            true => Filter::Not(Box::new(filter)),
            false => filter,
        })
    }

    fn comparison(&mut self, key: &str) -> Result<Filter, Wrong> {
        self.next += 1;
        let which = if key == "gap" { Time::Gap } else { Time::Reply };
        let longer = self.take(">");
        if !longer && !self.take("<") {
            return Err(self.wrong(SniffText::FilterCompare));
        }
        let limit = context::duration(self.peek().unwrap_or_default());
        let limit = limit.map_err(|_| self.wrong(SniffText::FilterTime))?;
        self.next += 1;
        Ok(match longer {
            true => Filter::Longer(which, limit),
            false => Filter::Shorter(which, limit),
        })
    }
}

fn one_or(mut filters: Vec<Filter>, join: fn(Vec<Filter>) -> Filter) -> Filter {
    match filters.pop() {
        Some(only) if filters.is_empty() => only,
        Some(last) => {
            filters.push(last);
            join(filters)
        }
        None => join(filters),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts() -> Facts<'static> {
        Facts {
            protocols: vec![Protocol::Rtu],
            address: Some(3),
            module: Some("oven"),
            role: Some(FrameRole::Reply),
            verdict: Some(FrameVerdict::Good),
            write: Some(false),
            late: false,
            after: Some(Micros::from_millis(60)),
            gap: Some(Micros::from_millis(60)),
        }
    }

    #[test]
    fn words_are_joined_as_one_reads_them() {
        for (text, wants) in [
            ("addr=3", true),
            ("addr=03h and proto=rtu", true),
            ("addr != 3", false),
            ("addr=3 and bad", false),
            ("bad or addr=3 and reply", true),
            ("(bad or addr=3) and request", false),
            ("not bad", true),
            ("not not bad", false),
            ("module=oven and read", true),
            ("module=pump or write", false),
            ("slow>50ms", true),
            ("slow > 60ms", false),
            ("gap<0.1s", true),
            ("not poll", false),
            ("missing or late or ambiguous or unknown or refused", false),
        ] {
            let filter = Filter::parse(text).unwrap_or_else(|wrong| panic!("{text}: {wrong:?}"));
            assert_eq!(filter.wants(&facts()), wants, "{text}");
        }
    }

    #[test]
    fn what_is_wrong_is_told_with_its_place() {
        for (text, at, why) in [
            ("", 1, SniffText::FilterEnds),
            ("addr=3 bad", 8, SniffText::FilterJoin),
            ("addr", 5, SniffText::FilterEquals),
            ("addr>3", 5, SniffText::FilterEquals),
            ("addr=300", 6, SniffText::FilterAddress),
            ("proto=profibus", 7, SniffText::FilterProtocol),
            ("adr=3", 1, SniffText::FilterWord),
            ("bad and", 8, SniffText::FilterEnds),
            ("(bad or ok", 11, SniffText::FilterClose),
            ("slow>50", 6, SniffText::FilterTime),
            ("slow=50ms", 5, SniffText::FilterCompare),
            ("坏 and bad", 1, SniffText::FilterWord),
            (")", 1, SniffText::FilterWord),
        ] {
            let wrong = Filter::parse(text).expect_err(text);
            assert_eq!((wrong.at, wrong.why), (at, why), "{text}");
        }
        let deep = "(".repeat(LEN_MAX);
        assert!(Filter::parse(&deep).is_err());
        assert!(Filter::parse(&"not ".repeat(LEN_MAX)).is_err());
    }
}
