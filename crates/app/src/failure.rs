//! Failures: what happened, where, why, and what to try, under a code that never changes.

#[cfg(test)]
mod outlets;
mod problem;

use crate::render::Format;
use crate::render::colour::Paint;
use crate::texts::AppText;
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::{reasons, width};
use serde_json::{Map, Value, json};
use std::process::ExitCode;

/// The width of an error's labels.
const LABEL: usize = 7;

/// Why a command failed.
#[derive(Debug)]
pub struct Failure {
    code: Code,
    message: String,
    why: Vec<String>,
    likely: bool,
    tries: Vec<String>,
    facts: Map<String, Value>,
    /// What may still have taken effect, if anything.
    perhaps: Option<Box<Perhaps>>,
    /// The output already says it: only the exit code is left.
    is_told: bool,
}

/// The part of a command that may still have taken effect.
#[derive(Debug)]
enum Perhaps {
    Whole,
    Parts(Vec<String>),
}

impl Failure {
    /// A failure with its own message.
    pub fn new(code: Code, message: String) -> Failure {
        Failure {
            code,
            message,
            why: Vec::new(),
            likely: false,
            tries: Vec::new(),
            facts: Map::new(),
            perhaps: None,
            is_told: false,
        }
    }

    /// Not an error, and the output says everything: people see no error message. Programs that
    /// requested JSON get its document, as with every exit code.
    pub const fn told(mut self) -> Failure {
        self.is_told = true;
        self
    }

    /// Whether the output says everything, and only the exit code is left.
    pub const fn is_told(&self) -> bool {
        self.is_told
    }

    /// A failure with the title, usual causes and next steps of the table.
    pub fn of(lang: Lang, code: Code) -> Failure {
        let title = code.page().title(lang).to_owned();
        Failure::new(code, title).diagnosed()
    }

    /// Adds the usual causes of the table.
    pub const fn diagnosed(mut self) -> Failure {
        self.likely = true;
        self
    }

    /// Adds the reason, as given by the system or the parser, or as observed.
    pub fn because(mut self, why: impl ToString) -> Failure {
        self.why.push(why.to_string());
        self
    }

    /// Adds a command that may help.
    pub fn with_try(mut self, command: impl Into<String>) -> Failure {
        self.tries.push(command.into());
        self
    }

    /// Adds a fact for programs.
    pub fn with_fact(mut self, key: &str, value: impl Into<Value>) -> Failure {
        self.facts.insert(key.to_owned(), value.into());
        self
    }

    /// Marks, if so, that the command may still have taken effect.
    pub fn perhaps_acted(mut self, perhaps: bool) -> Failure {
        if perhaps && self.perhaps.is_none() {
            self.perhaps = Some(Box::new(Perhaps::Whole));
        }
        self
    }

    /// The same for these parts of it, and no others.
    pub fn perhaps_acted_on(mut self, parts: Vec<String>) -> Failure {
        self.perhaps = (!parts.is_empty()).then(|| Box::new(Perhaps::Parts(parts)));
        self
    }

    /// Whether the command may still have taken effect.
    pub const fn may_have_acted(&self) -> bool {
        self.perhaps.is_some()
    }

    /// Its code.
    pub const fn code(&self) -> Code {
        self.code
    }

    /// What happened, in one sentence.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// The details of this case.
    pub fn why(&self) -> &[String] {
        &self.why
    }

    /// Its exit code.
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(self.code.exit())
    }

    /// In the requested form, within this many columns, if they are limited.
    pub fn tell(&self, lang: Lang, format: Format, paint: Paint, columns: Option<usize>) -> String {
        if format.is_json() {
            return json!({ "error": self.to_json(lang) }).to_string();
        }
        let text = self.render_within(lang, columns);
        // The label and code are highlighted.
        match text.split_once(']') {
            Some((name, rest)) => paint.bad(&format!("{name}]")) + rest,
            None => text,
        }
    }

    /// For programs.
    pub fn to_json(&self, lang: Lang) -> Value {
        // No fact may replace one of the standard fields.
        let mut error = self.facts.clone();
        error.remove("why");
        error.insert("code".to_owned(), self.code.name().into());
        error.insert("exit".to_owned(), self.code.exit().into());
        error.insert("message".to_owned(), self.message.as_str().into());
        error.insert("hint".to_owned(), self.hints(lang).into());
        if self.may_have_acted() {
            error.insert("may_have_acted".to_owned(), true.into());
        }
        let why = self.reasons(lang);
        if !why.is_empty() {
            error.insert("why".to_owned(), why.into());
        }
        error.into()
    }

    /// The details of this case, and what may have taken effect.
    fn reasons(&self, lang: Lang) -> Vec<String> {
        let sentence = lang.get(AppText::MayHaveActed);
        let of_part =
            |part: &String| lang.fill(AppText::Named, &[("title", part), ("name", &sentence)]);
        let why = self.why.iter();
        let mut told: Vec<String> = why.map(|why| reasons::error(lang, why)).collect();
        match self.perhaps.as_deref() {
            None => {}
            Some(Perhaps::Whole) => told.push(sentence.to_owned()),
            Some(Perhaps::Parts(parts)) => told.extend(parts.iter().map(of_part)),
        }
        told
    }

    fn hints(&self, lang: Lang) -> Vec<String> {
        if self.tries.is_empty() && self.likely {
            return vec![self.code.page().next(lang).to_owned()];
        }
        self.tries.clone()
    }

    /// For people.
    pub fn render(&self, lang: Lang) -> String {
        self.render_within(lang, None)
    }

    /// The same within this many columns, if they are limited. Long text wraps below its own
    /// beginning, so that labels and codes stand out.
    pub fn render_within(&self, lang: Lang, columns: Option<usize>) -> String {
        let code = self.code.name();
        let head = lang.fill(AppText::Error, &[("code", &code), ("message", &"")]);
        let mut text = width::hang(&head, &self.message, columns);
        let labelled = |label, lines: Vec<String>| lines.into_iter().map(move |line| (label, line));
        let page = self.code.page();
        let likely = self.likely.then(|| page.likely(lang).to_owned());
        let more = self.likely.then(|| format!("railbus explain {code}"));
        let lines = labelled(AppText::Why, self.reasons(lang))
            .chain(labelled(AppText::Likely, likely.into_iter().collect()))
            .chain(labelled(AppText::Try, self.hints(lang)))
            .chain(labelled(AppText::More, more.into_iter().collect()));
        for (label, line) in lines {
            let label = format!(
                "
  {} ",
                width::pad(lang.get(label), LABEL)
            );
            text += &width::hang(&label, &line, columns);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_says_what_why_and_what_to_try() {
        let failure = Failure::new(
            Code::Listen,
            "can't listen on TCP 127.0.0.1:4001".to_owned(),
        )
        .because("Address already in use (os error 98)")
        .with_try("railbus sim --demo --tcp 127.0.0.1:0");
        assert_eq!(
            failure.render(Lang::En),
            "error[E0701]: can't listen on TCP 127.0.0.1:4001\n  \
             why:    Address already in use (os error 98)\n  \
             try:    railbus sim --demo --tcp 127.0.0.1:0"
        );
    }

    #[test]
    fn a_failure_of_the_table_tells_all_of_it() {
        let text = Failure::of(Lang::Zh, Code::PortMissing).render(Lang::Zh);
        assert_eq!(
            text,
            "错误[E0705]：端口不存在\n  \
             可能：  转换器未插好 · 重新插入后编号改变\n  \
             可试：  railbus ls ports\n  \
             详见：  railbus explain E0705"
        );
    }

    #[test]
    fn programs_get_it_as_json() {
        let failure = Failure::of(Lang::En, Code::NoReply)
            .because("silence")
            .with_fact("why", "silence")
            .with_fact("module", "pump");
        let told: Value =
            serde_json::from_str(&failure.tell(Lang::En, Format::Json, Paint::Plain, None))
                .unwrap();
        let error = &told["error"];
        assert_eq!(error["code"], "E0301");
        assert_eq!(error["exit"], 3);
        assert_eq!(error["module"], "pump");
        assert_eq!(error["why"][0], "silence");
        assert_eq!(error["hint"][0], "railbus scan");
    }
}
