//! The receivers of events over HTTP: the tables `[webhook.<id>]`.

use super::Config;
use super::problem::Invalid;
use super::read::{Reader, Section, Value};
use railbus_store::history::{Event, EventKind, Severity};
use std::collections::{BTreeMap, BTreeSet};
use toml::de::DeTable;

/// The most webhooks of a site.
pub const WEBHOOKS_MAX: usize = 16;
/// The longest address of a receiver, in bytes.
pub const URL_MAX: usize = 2_048;
/// The most kinds, lines or modules that a webhook names.
const NAMES_MAX: usize = 256;

pub(super) const WEBHOOK_KEYS: [&str; 6] =
    ["url", "events", "severity", "lines", "modules", "enabled"];
const SEVERITIES: [(&str, Severity); 3] = [
    (Severity::Info.name(), Severity::Info),
    (Severity::Warning.name(), Severity::Warning),
    (Severity::Error.name(), Severity::Error),
];

/// A receiver of events.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Webhook {
    /// Its address, with `http` or `https`.
    pub url: String,
    /// The kinds of events it receives; empty for all of them.
    pub events: BTreeSet<EventKind>,
    /// The least severity it receives.
    pub severity: Severity,
    /// With `modules`: it is told only what is about one of these. Empty, both, for everything.
    pub lines: BTreeSet<String>,
    /// Modules, as `lines`.
    pub modules: BTreeSet<String>,
    /// It is told anything at all.
    pub enabled: bool,
}

impl Config {
    /// Whether a webhook of this configuration receives an event.
    #[must_use]
    pub fn tells(&self, hook: &Webhook, event: &Event) -> bool {
        let kind = hook.events.is_empty() || hook.events.contains(&event.kind);
        hook.enabled && kind && event.severity >= hook.severity && self.is_of(hook, event)
    }

    /// Whether an event is about what the webhook names.
    fn is_of(&self, hook: &Webhook, event: &Event) -> bool {
        if hook.lines.is_empty() && hook.modules.is_empty() {
            return true;
        }
        let module = event.module.as_ref();
        let of_module = module.and_then(|module| self.modules.get(module));
        let of_module = of_module.map(|module| &module.line);
        let line = event.line.as_ref().or(of_module);
        module.is_some_and(|module| hook.modules.contains(module))
            || line.is_some_and(|line| hook.lines.contains(line))
    }
}

impl<'t> Reader<'t> {
    /// `[webhook.<id>]`, once the lines and modules are known.
    pub(super) fn webhooks(&mut self, root: &DeTable<'t>, config: &mut Config) {
        let Some(value) = root.get("webhook") else {
            return;
        };
        let mut read = BTreeMap::new();
        let mut count = 0;
        self.named(value, "webhook", |reader, name, section| {
            count += 1;
            if count > WEBHOOKS_MAX {
                let kind = Invalid::TooMany(WEBHOOKS_MAX);
                reader.problem(section.place_of("url"), &section.path, kind);
            } else if let Some(hook) = reader.webhook(root, config, &section) {
                read.insert(name, hook);
            }
        });
        config.webhooks = read;
    }

    fn webhook(
        &mut self,
        root: &DeTable<'t>,
        config: &Config,
        section: &Section<'_, 't>,
    ) -> Option<Webhook> {
        self.check_keys(section, &WEBHOOK_KEYS);
        let url = self.required(section, "url", Self::url);
        let events = self.kinds(section);
        let severity = self.one_of(section, "severity", &SEVERITIES);
        let enabled = self.optional(section, "enabled", Self::truth);
        let lines = self.known(root, section, ("lines", "line"), &config.lines);
        let modules = self.known(root, section, ("modules", "module"), &config.modules);
        Some(Webhook {
            url: url?,
            events: events?,
            severity: severity?.unwrap_or(Severity::Info),
            lines: lines?,
            modules: modules?,
            enabled: enabled?.unwrap_or(true),
        })
    }

    fn url(&mut self, value: &Value<'t>, path: &str) -> Option<String> {
        let url = self.string(value, path)?;
        if is_url(&url) {
            return Some(url);
        }
        self.problem(value.span(), path, Invalid::BadUrl);
        None
    }

    fn kinds(&mut self, section: &Section<'_, 't>) -> Option<BTreeSet<EventKind>> {
        let named = self.optional(section, "events", |reader, value, path| {
            reader.names(value, path, ("list of kinds", NAMES_MAX))
        })?;
        let mut kinds = BTreeSet::new();
        for (span, name) in named.unwrap_or_default() {
            let Some(kind) = EventKind::from_name(&name) else {
                let names = EventKind::ALL.iter().map(|kind| kind.name());
                let path = format!("{}.events", section.path);
                self.problem(span, &path, Invalid::NotOneOf(names.collect()));
                return None;
            };
            kinds.insert(kind);
        }
        Some(kinds)
    }

    /// Names of tables that must be there. Those that could not be read are skipped: their
    /// problems were reported.
    fn known<T>(
        &mut self,
        root: &DeTable<'t>,
        section: &Section<'_, 't>,
        (key, kind): (&'static str, &'static str),
        known: &BTreeMap<String, T>,
    ) -> Option<BTreeSet<String>> {
        let named = self.optional(section, key, |reader, value, path| {
            reader.names(value, path, ("list of names", NAMES_MAX))
        })?;
        let written = root.get(kind).and_then(|all| all.get_ref().as_table());
        let mut names = BTreeSet::new();
        for (span, name) in named.unwrap_or_default() {
            let is_written = written.is_some_and(|all| all.contains_key(name.as_str()));
            if !known.contains_key(&name) && !is_written {
                let path = format!("{}.{key}", section.path);
                let problem = match kind {
                    "line" => Invalid::NoSuchLine,
                    _ => Invalid::NoSuchModule,
                };
                self.problem(span, &path, problem);
            }
            names.insert(name);
        }
        Some(names)
    }
}

/// Whether this is an address that can be asked, of at most [`URL_MAX`] bytes: `http` or `https`, a
/// host, maybe a port, and nothing that is not written in ASCII. A name and a password in it would
/// stand in the file for all to read, and are not taken.
#[must_use]
pub fn is_url(text: &str) -> bool {
    let Some(rest) = ["http://", "https://"]
        .iter()
        .find_map(|scheme| text.strip_prefix(scheme))
    else {
        return false;
    };
    let is_plain = text.bytes().all(|byte| byte.is_ascii_graphic());
    let (authority, _) = rest.split_at(rest.find(['/', '?']).unwrap_or(rest.len()));
    is_plain
        && text.len() <= URL_MAX
        && !text.contains(['#', '"', '<', '>', '\\', '^', '`', '{', '|', '}'])
        && is_authority(authority)
}

/// `host`, `host:port`, `[::1]:port`.
fn is_authority(text: &str) -> bool {
    let (host, port) = match text.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        Some((host, rest)) => {
            if host.parse::<std::net::Ipv6Addr>().is_err() {
                return false;
            }
            ("ipv6", rest)
        }
        None => text.split_at(text.find(':').unwrap_or(text.len())),
    };
    let letter = |byte: u8| byte.is_ascii_alphanumeric() || b"-._".contains(&byte);
    let is_host = !host.is_empty() && host.bytes().all(letter);
    let is_port = match port.strip_prefix(':') {
        Some(port) => port.parse::<u16>().is_ok_and(|port| port > 0),
        None => port.is_empty(),
    };
    is_host && is_port
}

#[cfg(test)]
mod tests {
    use super::*;

    const SITE: &str = "[line.main]\nport = \"/dev/ttyUSB0\"\n[line.yard]\n\
        port = \"/dev/ttyUSB1\"\n[module.pump]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";

    fn parse(hooks: &str) -> Result<Config, Vec<(usize, usize, String, &'static str)>> {
        let told = Config::parse(&format!("{SITE}{hooks}"));
        told.map_err(|problems| {
            let each = problems.into_iter();
            each.map(|p| (p.line - 8, p.column, p.path, p.kind.code()))
                .collect()
        })
    }

    #[test]
    fn addresses_are_those_that_can_be_asked() {
        for good in [
            "http://127.0.0.1:8080/x?y=1",
            "https://hooks.example.com",
            "https://[::1]:443/a%20b",
        ] {
            assert!(is_url(good), "{good}");
        }
        let long = format!("http://a/{}", "x".repeat(URL_MAX));
        for wrong in [
            "",
            "ftp://a",
            "http://",
            "http:///x",
            "http://a:0",
            "http://a:70000",
            "http://a b",
            "http://me:pass@a/",
            "http://[::1",
            "http://[::g]/",
            "http://a/#x",
            "http://ä/",
            "//a/",
            "http://a/\n",
            &long,
        ] {
            assert!(!is_url(wrong), "{wrong}");
        }
    }

    #[test]
    fn what_is_wrong_is_told_with_its_place() {
        let told = |text: &str| parse(text).unwrap_err();
        let wrong = told("\n[webhook.a]\nurl = \"ftp://a\"\nevents = [\"alarm\", \"alarms\"]\n");
        let path = |key: &str| format!("webhook.a.{key}");
        assert_eq!(
            wrong,
            [
                (3, 7, path("url"), "E0876"),
                (4, 20, path("events"), "E0815")
            ]
        );
        let wrong = told("\n[webhook.a]\nurl = \"http://a\"\nlines = [\"x\"]\nmodules = [\"y\"]\n");
        assert_eq!(
            wrong,
            [
                (4, 10, path("lines"), "E0820"),
                (5, 12, path("modules"), "E0801")
            ]
        );
        assert_eq!(told("\n[webhook.A]\n")[0].3, "E0817");
        assert_eq!(told("\n[webhook.a]\n")[0].3, "E0813");
        assert_eq!(
            told("\n[webhook.a]\nurl = \"http://a\"\nsecret = \"x\"\n")[0].3,
            "E0812"
        );
        let many: String = (0..=WEBHOOKS_MAX)
            .map(|at| format!("[webhook.h{at}]\nurl = \"http://a\"\n"))
            .collect();
        assert_eq!(told(&many)[0].3, "E0868");
    }

    #[test]
    fn a_new_name_of_a_line_or_module_is_its_name_here_too() {
        let hook = "[webhook.a]\nurl = \"http://a\"\nlines = [\"main\"]\nmodules = [\"pump\"]\n";
        let text = format!("{SITE}{hook}");
        let text = super::super::change::rename(&text, "line", "main", "hall").unwrap();
        let text = super::super::change::rename(&text, "module", "pump", "well").unwrap();
        let config = Config::parse(&text).unwrap();
        let names = |set: &BTreeSet<String>| set.iter().cloned().collect::<Vec<_>>();
        let hook = &config.webhooks["a"];
        assert_eq!(
            (names(&hook.lines), names(&hook.modules)),
            (vec!["hall".into()], vec!["well".into()])
        );
    }

    #[test]
    fn a_webhook_is_told_what_it_asks_for() {
        let config = parse(
            "[webhook.all]\nurl = \"http://a\"\n\
             [webhook.some]\nurl = \"http://a\"\nevents = [\"module\", \"line\"]\n\
             severity = \"warning\"\nlines = [\"main\"]\n\
             [webhook.one]\nurl = \"http://a\"\nmodules = [\"pump\"]\n\
             [webhook.off]\nurl = \"http://a\"\nenabled = false\n",
        )
        .unwrap();
        let told = |event: Event| -> Vec<&str> {
            let hooks = config.webhooks.iter();
            hooks
                .filter(|(_, hook)| config.tells(hook, &event))
                .map(|(name, _)| name.as_str())
                .collect()
        };
        let event = |kind, severity| Event::new(kind, severity, "x");
        let lost = event(EventKind::Module, Severity::Warning);
        assert_eq!(told(lost.clone().module("pump")), ["all", "one", "some"]);
        assert_eq!(told(lost.module("other")), ["all"]);
        let back = event(EventKind::Module, Severity::Info).module("pump");
        assert_eq!(told(back), ["all", "one"]);
        let line = event(EventKind::Line, Severity::Error);
        assert_eq!(told(line.clone().line("main")), ["all", "some"]);
        assert_eq!(told(line.line("yard")), ["all"]);
        assert_eq!(told(event(EventKind::System, Severity::Error)), ["all"]);
    }
}
