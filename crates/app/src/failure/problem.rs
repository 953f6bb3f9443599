//! Converts a problem of the API to a failure of the command, in words.

use super::{Code, Failure};
use crate::render::wire_words;
use crate::texts::AppText;
use railbus_api::fleet::AT_SITE;
use railbus_api::problem::Problem;
use railbus_device::Family;
use railbus_site::config::resembles;
use railbus_wire::Address;
use railbus_wire::rtu::Exception;
use railbus_words::Lang;
use railbus_words::reasons;

impl Failure {
    /// The failure for a problem.
    pub fn of_problem(lang: Lang, problem: &Problem) -> Failure {
        let code = code_of(problem);
        let mut failure = Failure::new(code, message(lang, code, problem));
        // At a site of a fleet other things help than here; what this code advises is done there.
        if !problem.with.contains_key(AT_SITE) || code == Code::ReadsOnly {
            failure = failure.diagnosed();
        }
        for why in reasons(lang, code, problem) {
            failure = failure.because(why);
        }
        failure = problem
            .hint
            .iter()
            .cloned()
            .fold(failure, Failure::with_try);
        for (key, value) in &problem.with {
            failure = failure.with_fact(key, value.clone());
        }
        failure.perhaps_acted(problem.may_have_acted)
    }

    /// The problem to report over HTTP.
    pub fn to_problem(&self) -> Problem {
        let mut problem = Problem {
            code: self.code.name().to_owned(),
            title: self.code.page().title(Lang::En).to_owned(),
            status: status(self.code),
            with: self.facts.clone().into_iter().collect(),
            hint: self.tries.clone(),
            may_have_acted: self.may_have_acted(),
        };
        if !self.why.is_empty() {
            problem = problem.with("reason", self.why.join(" · "));
        }
        problem
    }
}

/// The HTTP status of a failure, by its exit code.
fn status(code: Code) -> u16 {
    match (code, code.exit()) {
        (Code::NoChange, _) => 404,
        (Code::JournalBusy | Code::NoPowerCycle, _) | (_, 2 | 4 | 6) => 409,
        (_, 3) => 504,
        (_, 5) => 502,
        (_, 7) => 503,
        (_, 8) => 422,
        _ => 500,
    }
}

/// The code: for a line that is not open, that of the cause; for a configuration, that of its first
/// problem.
fn code_of(problem: &Problem) -> Code {
    let code = Code::from_name(&problem.code).unwrap_or(Code::System);
    match code {
        Code::LineClosed => match problem.text("reason").as_str() {
            "missing" => Code::PortMissing,
            "busy" | "lent" => Code::PortBusy,
            "permission" => Code::PortDenied,
            "not_a_tty" => Code::NotATty,
            "refused" | "unreachable" => Code::PortUnreachable,
            _ => Code::LineClosed,
        },
        Code::BadConfig => {
            let first = problem.with.get("problems").and_then(|all| all.get(0));
            let named = first.and_then(|first| first.get("code")?.as_str());
            named.and_then(Code::from_name).unwrap_or(code)
        }
        _ => code,
    }
}

/// What happened, and to what.
fn message(lang: Lang, code: Code, problem: &Problem) -> String {
    let text = |key: &str| problem.text(key);
    let title = code.page().title(lang);
    let module = text("module");
    let with_module = |label: AppText| {
        let at = place(lang, problem);
        lang.fill(label, &[("module", &module), ("at", &at)])
    };
    match code {
        Code::NoReply if !module.is_empty() => with_module(AppText::FromNobody),
        Code::Refused if !module.is_empty() => with_module(AppText::RefusedBy),
        Code::Garbled if !module.is_empty() => with_module(AppText::GarbledBy),
        Code::NotVerified if !module.is_empty() => {
            let point = match text("point") {
                // Several outputs were switched at once.
                none if none.is_empty() => module,
                point => format!("{module}.{point}"),
            };
            lang.fill(AppText::NotVerifiedAt, &[("point", &point)])
        }
        Code::NoModule
        | Code::NoLine
        | Code::NoUser
        | Code::NameTaken
        | Code::NoToken
        | Code::HookTarget
        | Code::BadName => with_name(lang, title, &text("name")),
        Code::AccountsFile | Code::AccountsHeld | Code::Tls => {
            with_name(lang, title, &text("path"))
        }
        Code::NoPoint if !module.is_empty() => {
            with_name(lang, title, &format!("{module}.{}", text("name")))
        }
        Code::ConfigFile => with_name(lang, title, &text("file")),
        Code::Limited => with_name(lang, title, &plain(&text("points"))),
        _ if text("point").is_empty() => {
            let name = [text("port"), module]
                .into_iter()
                .find(|name| !name.is_empty());
            with_name(lang, title, &name.unwrap_or_default())
        }
        _ => with_name(lang, title, &format!("{module}.{}", text("point"))),
    }
}

fn with_name(lang: Lang, title: &str, name: &str) -> String {
    if name.is_empty() {
        return title.to_owned();
    }
    lang.fill(AppText::Named, &[("title", &title), ("name", &name)])
}

/// Address, protocol, speed and line of a module, as far as given.
fn place(lang: Lang, problem: &Problem) -> String {
    let text = |key: &str| problem.text(key);
    let address = problem
        .with
        .get("address")
        .and_then(serde_json::Value::as_u64);
    let address = address.and_then(|address| u8::try_from(address).ok());
    let settings = format!("{} {}", text("baud"), text("format"));
    let line = text("line");
    let parts = [
        address.map(|address| {
            let address = Address(address);
            lang.fill(AppText::AtAddress, &[("address", &address)])
        }),
        Some(text("protocol")),
        Some(settings.trim().to_owned()),
        (!line.is_empty()).then(|| lang.fill(AppText::OnLine, &[("line", &line)])),
    ];
    let parts: Vec<String> = parts
        .into_iter()
        .flatten()
        .filter(|part| !part.is_empty())
        .collect();
    parts.join(lang.get(AppText::Comma))
}

/// What was observed.
fn reasons(lang: Lang, code: Code, problem: &Problem) -> Vec<String> {
    let number = |key: &str| problem.with.get(key).and_then(serde_json::Value::as_u64);
    let mut told = Vec::new();
    if let (Some(attempts), Some(bytes)) = (number("attempts"), number("rx_bytes")) {
        let heard = match (code, bytes) {
            (_, 0) => AppText::HeardNothing,
            (Code::NoReply, _) => AppText::HeardHalf,
            _ => AppText::HeardBytes,
        };
        let values: &[(&str, &dyn std::fmt::Display)] =
            &[("attempts", &attempts), ("bytes", &bytes)];
        told.push(lang.fill(heard, values));
    }
    let lost = problem.with.get("lost").cloned();
    if let Some(lost) = lost.and_then(|lost| serde_json::from_value(lost).ok()) {
        let (module, lost) = (problem.text("module"), wire_words::lost(lang, &lost));
        let values: &[(&str, &dyn std::fmt::Display)] = &[("module", &module), ("lost", &lost)];
        told.push(lang.fill(AppText::OnlyGarbled, values));
        told.push(Code::Garbled.page().likely(lang).to_owned());
    }
    if problem.with.contains_key("channel_doubtful") {
        let (module, point) = (problem.text("module"), problem.text("point"));
        let values: &[(&str, &dyn std::fmt::Display)] = &[("module", &module), ("point", &point)];
        told.push(lang.fill(AppText::ChannelDoubtful, values));
    }
    for key in ["why", "refusal", "reason"] {
        let text = problem.text(key);
        let is_code = code != Code::LineClosed && key == "reason" && problem.code == "E0710";
        if text.is_empty() || is_code {
            continue;
        }
        told.push(match (key, number("exception")) {
            ("refusal", Some(exception)) => {
                let why = Exception(u8::try_from(exception).unwrap_or_default());
                let why = wire_words::exception(lang, why);
                lang.fill(AppText::ModbusException, &[("why", &why)])
            }
            ("why", _) => wire_words::malformed(lang, &text),
            ("reason", _) if code == Code::LineClosed => reasons::word(lang, &text),
            ("reason", _) => reasons::told(lang, &text),
            _ => text,
        });
    }
    let found = problem.text("answers_as");
    if !found.is_empty() {
        let model = problem.text("model");
        let model = Family::from_name(&model).map_or(model, |family| family.to_string());
        let values: &[(&str, &dyn std::fmt::Display)] = &[("found", &found), ("model", &model)];
        told.push(lang.fill(AppText::AnswersAs, values));
    }
    let holder = problem.text("holder");
    if !holder.is_empty() {
        told.push(lang.fill(AppText::HeldBy, &[("holder", &holder)]));
    }
    let group = problem.text("group");
    if !group.is_empty() {
        told.push(lang.fill(AppText::OfGroup, &[("group", &group)]));
    }
    told.extend(places_in_config(problem));
    let known = problem.text("known");
    if !known.is_empty() {
        let name = problem.text("name");
        let names = plain(&known);
        let meant = names.split(' ').find(|other| resembles(other, &name));
        told.extend(meant.map(|meant| lang.fill(AppText::DidYouMean, &[("name", &meant)])));
        told.push(lang.fill(AppText::Known, &[("names", &plain(&known))]));
    }
    told
}

/// `["a","b"]` as `a b`.
fn plain(list: &str) -> String {
    let names: Vec<String> = serde_json::from_str(list).unwrap_or_default();
    if names.is_empty() {
        list.to_owned()
    } else {
        names.join(" ")
    }
}

/// The position of each problem in the configuration.
fn places_in_config(problem: &Problem) -> Vec<String> {
    let file = problem.text("file");
    let all = problem.with.get("problems").and_then(|all| all.as_array());
    let of = |entry: &serde_json::Value, key: &str| match entry.get(key) {
        Some(serde_json::Value::String(text)) => text.clone(),
        Some(other) => other.to_string(),
        None => String::new(),
    };
    all.into_iter()
        .flatten()
        .map(|entry| {
            let [line, column, path, reason] =
                ["line", "column", "path", "reason"].map(|key| of(entry, key));
            match path.is_empty() {
                true => format!("{file}:{line}:{column}: {reason}"),
                false => format!("{file}:{line}:{column}: {path}: {reason}"),
            }
        })
        .collect()
}
