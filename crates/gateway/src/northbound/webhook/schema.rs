//! Webhooks in the table of outlets. Their sections, `[webhook.NAME]`, are read by
//! `railbus_site::config`.

use super::{target, test, work};
use crate::northbound::kind::{ENABLED, EVENTS, Field, OnChange, OutletKind, Pair, Shape};
use railbus_api::problem::codes;
use railbus_site::Config;
use railbus_site::config::change::Keys;
use railbus_site::config::{URL_MAX, Webhook};
use railbus_store::history::Severity;

/// The lengths that a secret may have, in bytes.
const SECRET_MIN: usize = 16;
const SECRET_MAX: usize = 256;

/// Webhooks: events of the site, sent over HTTP. They are older than the table of outlets, so
/// that their section, their routes and the codes of their events have their own names.
pub(in crate::northbound) static KIND: OutletKind = OutletKind {
    table: "webhook",
    outlets: |_, config| configured(config),
    events: "webhook",
    notes: NOTES,
    missing: codes::NO_SUCH_HOOK,
    on_change: OnChange::HandOver,
    may_lead: target::may_lead,
    ..OutletKind::new("webhook", WORDS, FIELDS, work, test)
};

const WORDS: (Pair, Pair) = (
    ["Webhook", "Webhook"],
    [
        "Sends each event to an address as it happens, in order. What can't be delivered is tried \
         again for a while.",
        "事件发生时按顺序发送到指定地址；未能送达时会在一段时间内重试。",
    ],
);

/// The webhooks of a configuration, by the keys of their sections.
fn configured(config: &Config) -> Vec<(String, Keys)> {
    let all = config.webhooks.iter();
    all.map(|(name, hook)| (name.clone(), keys(hook))).collect()
}

/// A webhook as it is written, without what holds if it is left out.
fn keys(hook: &Webhook) -> Keys {
    let mut keys = Keys::new();
    keys.insert("url".to_owned(), hook.url.as_str().into());
    let events = hook.events.iter().map(|kind| kind.name().to_owned());
    let lists: [(&str, Vec<String>); 3] = [
        ("events", events.collect()),
        ("lines", hook.lines.iter().cloned().collect()),
        ("modules", hook.modules.iter().cloned().collect()),
    ];
    for (key, names) in lists {
        if !names.is_empty() {
            keys.insert(key.to_owned(), names.into());
        }
    }
    if hook.severity != Severity::Info {
        keys.insert("severity".to_owned(), hook.severity.name().into());
    }
    if !hook.enabled {
        keys.insert(ENABLED.to_owned(), false.into());
    }
    keys
}

const NOTES: &[Pair] = &[
    [
        "The receiver gets a POST with JSON: site, and event in the format of /events. \
         X-Railbus-Event is a unique ID; use it to detect duplicates. Any answer from 200 to 299 \
         within 10 s counts as delivered; redirects are not followed.",
        "接收方收到 POST 发送的 JSON：site 以及与 /events 相同格式的 event。X-Railbus-Event 为事件编号，\
         可用于识别重复。10 秒内返回 200 至 299 即视为已接收；不跟随重定向。",
    ],
    [
        "With a secret, X-Railbus-Signature is sha256= and the HMAC-SHA256, in hexadecimal, of \
         X-Railbus-Timestamp, a dot and the body as it came. Compare it in constant time, and \
         refuse what is older than five minutes.",
        "设有密钥时，X-Railbus-Signature 为 sha256= 加上对“X-Railbus-Timestamp、一个点、原始正文”计算的 \
         HMAC-SHA256（十六进制）。请用恒定时间比较，并拒绝超过五分钟的请求。",
    ],
];

const FIELDS: &[Field] = &[
    Field::new(
        "url",
        ["Address of the receiver", "接收方地址"],
        Shape::Url(URL_MAX),
    )
    .required(),
    Field::new(
        "events",
        ["Event types (none = all)", "事件类型；不选表示全部"],
        Shape::Choices(EVENTS),
    ),
    Field::new(
        "severity",
        ["At least", "最低级别"],
        Shape::Choice(SEVERITIES),
    ),
    Field::new(
        "lines",
        ["Only about these lines", "仅限这些总线"],
        Shape::Lines,
    ),
    Field::new(
        "modules",
        ["Only about these modules", "仅限这些模块"],
        Shape::Modules,
    )
    .with_hint([
        "Together with the lines; leave both empty for all",
        "与总线共同生效；均留空表示全部",
    ]),
    Field::new(
        "secret",
        ["Secret", "密钥"],
        Shape::Secret(SECRET_MIN, SECRET_MAX),
    )
    .with_hint([
        "Signs what is sent. The same at the receiver. Leave empty to keep. It is never shown \
         again.",
        "用于签名，与接收方一致。留空则不变。保存后不再显示。",
    ]),
];

const SEVERITIES: &[(&str, Pair)] = &[
    ("info", ["info", "提示"]),
    ("warning", ["warning", "警告"]),
    ("error", ["error", "错误"]),
];

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_store::history::EventKind;
    use std::collections::BTreeSet;

    /// The fields are the keys that the configuration has, and the words those it takes.
    #[test]
    fn the_form_has_what_the_configuration_has() {
        let words = |choices: &[(&'static str, Pair)]| -> Vec<&str> {
            choices.iter().map(|(word, _)| *word).collect()
        };
        let kinds: Vec<&str> = EventKind::ALL.iter().map(|kind| kind.name()).collect();
        assert_eq!(words(EVENTS), kinds);
        let all = [Severity::Info, Severity::Warning, Severity::Error];
        assert_eq!(words(SEVERITIES), all.map(|severity| severity.name()));
        let text = "[line.main]\nport = \"/dev/ttyS9\"\n[module.pump]\nline = \"main\"\n\
            model = \"erc8\"\naddress = 3\n[webhook.a]\nurl = \"http://a\"\n\
            events = [\"write\"]\nseverity = \"error\"\nlines = [\"main\"]\n\
            modules = [\"pump\"]\nenabled = false\n";
        let config = Config::parse(text).unwrap();
        let (_, keys) = configured(&config).pop().unwrap();
        let known = FIELDS.iter().map(|field| field.key).chain([ENABLED]);
        let known: BTreeSet<&str> = known.filter(|key| *key != "secret").collect();
        assert_eq!(
            keys.keys().map(String::as_str).collect::<BTreeSet<_>>(),
            known
        );
    }
}
