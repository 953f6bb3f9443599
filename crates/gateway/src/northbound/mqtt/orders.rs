//! What a payload orders.

use crate::body;
use railbus_site::KEY_LEN_MAX;
use serde::Deserialize;

/// The longest payload that is looked at.
pub(super) const PAYLOAD_MAX: usize = 4 << 10;

/// What a command is for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Target {
    /// An output: its module and its label.
    Output(String, String),
    /// The outputs of a group.
    Group(String),
    /// A scene.
    Scene(String),
}

impl Target {
    /// As text, for a key.
    pub(super) fn parts(&self) -> [&str; 3] {
        match self {
            Target::Output(module, label) => ["output", module, label],
            Target::Group(name) => ["group", name, ""],
            Target::Scene(name) => ["scene", name, ""],
        }
    }
}

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wish {
    /// On, or off.
    Set(bool),
    /// The other state.
    Toggle,
    /// A pulse of so many milliseconds, or of the module's own width.
    Pulse(Option<u64>),
    /// A scene is played.
    Run,
}

/// What is ordered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Order {
    pub(super) target: Target,
    pub(super) wish: Wish,
    /// Who asks means it.
    pub(super) confirm: bool,
    /// Only where the output is in this state.
    pub(super) only_if: Option<bool>,
    /// Under which it is carried out once.
    pub(super) id: Option<String>,
    /// It must be sent within so many milliseconds.
    pub(super) within_ms: Option<u64>,
}

/// A payload in JSON.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Long {
    value: Option<Spoken>,
    #[serde(default)]
    confirm: bool,
    #[serde(rename = "if")]
    only_if: Option<Spoken>,
    id: Option<String>,
    within_ms: Option<u64>,
}

/// A value in JSON.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Spoken {
    Bool(bool),
    Word(String),
}

impl Spoken {
    fn wish(&self) -> Option<Wish> {
        match self {
            Spoken::Bool(on) => Some(Wish::Set(*on)),
            Spoken::Word(word) => wish(word),
        }
    }
}

/// `ON`, `OFF`, `TOGGLE`, `PULSE`, `PULSE 500` or `RUN`.
fn wish(word: &str) -> Option<Wish> {
    let word = word.trim().to_ascii_uppercase();
    Some(match word.as_str() {
        "ON" => Wish::Set(true),
        "OFF" => Wish::Set(false),
        "TOGGLE" => Wish::Toggle,
        "PULSE" => Wish::Pulse(None),
        "RUN" => Wish::Run,
        other => {
            let width = other.strip_prefix("PULSE ")?.trim();
            // A sign or an empty text is no number.
            let is_number = !width.is_empty() && width.bytes().all(|byte| byte.is_ascii_digit());
            Wish::Pulse(Some(width.parse().ok().filter(|_| is_number)?))
        }
    })
}

/// What a payload orders, or what is wrong with it.
pub(super) fn parse(target: Target, payload: &[u8]) -> Result<Order, String> {
    if payload.len() > PAYLOAD_MAX {
        return Err(format!(
            "the payload has {} bytes; at most {PAYLOAD_MAX} are taken",
            payload.len()
        ));
    }
    let text = std::str::from_utf8(payload).map_err(|_| "the payload is no UTF-8".to_owned())?;
    let long = match text.trim_start().starts_with('{') {
        true => body::parse(payload).map_err(|why| format!("the payload is no command: {why}"))?,
        false => Long {
            value: Some(Spoken::Word(text.to_owned())),
            confirm: false,
            only_if: None,
            id: None,
            within_ms: None,
        },
    };
    let is_scene = matches!(target, Target::Scene(_));
    let asked = match &long.value {
        Some(value) => value.wish(),
        None => is_scene.then_some(Wish::Run),
    };
    let (wish, words) = match &target {
        Target::Output(..) => (
            asked.filter(|wish| *wish != Wish::Run),
            "ON, OFF, TOGGLE, PULSE or PULSE 500",
        ),
        Target::Group(_) => (
            asked.filter(|wish| matches!(wish, Wish::Set(_) | Wish::Toggle)),
            "ON, OFF or TOGGLE",
        ),
        // Lamps of other programs only know ON.
        Target::Scene(_) => (
            asked
                .filter(|wish| matches!(wish, Wish::Run | Wish::Set(true)))
                .map(|_| Wish::Run),
            "RUN",
        ),
    };
    let wish = wish.ok_or_else(|| format!("the value must be {words}"))?;
    let only_if = match long.only_if.map(|word| word.wish()) {
        None => None,
        Some(Some(Wish::Set(on))) => Some(on),
        Some(_) => return Err("\"if\" must be ON or OFF".to_owned()),
    };
    if only_if.is_some() && !matches!((&target, wish), (Target::Output(..), Wish::Set(_))) {
        return Err("\"if\" is for ON and OFF of one output".to_owned());
    }
    if long
        .id
        .as_ref()
        .is_some_and(|id| !(1..=KEY_LEN_MAX).contains(&id.len()))
    {
        return Err(format!("\"id\" has 1 to {KEY_LEN_MAX} bytes"));
    }
    Ok(Order {
        target,
        wish,
        confirm: long.confirm,
        only_if,
        id: long.id,
        within_ms: long.within_ms,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn output() -> Target {
        Target::Output("oven".to_owned(), "k1".to_owned())
    }

    fn wish_of(target: Target, payload: &str) -> Option<Wish> {
        parse(target, payload.as_bytes())
            .ok()
            .map(|order| order.wish)
    }

    #[test]
    fn a_word_is_a_command() {
        let wish = |payload| wish_of(output(), payload);
        assert_eq!(wish("ON"), Some(Wish::Set(true)));
        assert_eq!(wish(" off\n"), Some(Wish::Set(false)));
        assert_eq!(wish("TOGGLE"), Some(Wish::Toggle));
        assert_eq!(wish("PULSE"), Some(Wish::Pulse(None)));
        assert_eq!(wish("PULSE 500"), Some(Wish::Pulse(Some(500))));
        assert_eq!(wish("{\"value\": true}"), Some(Wish::Set(true)));
        assert_eq!(
            wish("{\"value\": \"pulse 20\"}"),
            Some(Wish::Pulse(Some(20)))
        );
        for none in [
            "",
            " ",
            "1",
            "0",
            "true",
            "ONN",
            "RUN",
            "PULSE x",
            "PULSE -1",
            "PULSE +1",
            "PULSE 1.5",
            "PULSE500",
            "PULSE 99999999999999999999",
            "[\"ON\"]",
            "\"ON\"",
            "null",
            "{",
            "{}",
            "{\"value\": 1}",
            "{\"value\": \"ON\", \"valeu\": 1}",
            "{\"value\": \"ON\", \"value\": \"OFF\"}",
            "{\"value\": \"ON\"}x",
            "{\"value\": \"ON\", \"confirm\": 1}",
            "{\"value\": \"ON\", \"if\": \"TOGGLE\"}",
            "{\"value\": \"TOGGLE\", \"if\": \"ON\"}",
            "{\"value\": \"ON\", \"id\": \"\"}",
            "{\"value\": \"ON\", \"id\": 7}",
            "{\"value\": \"ON\", \"within_ms\": -1}",
        ] {
            assert_eq!(wish(none), None, "{none}");
        }
        assert!(parse(output(), b"\xFF").is_err());
        assert!(parse(output(), &b" ".repeat(PAYLOAD_MAX + 1)).is_err());
        let longest = format!("ON{}", " ".repeat(PAYLOAD_MAX - 2));
        assert_eq!(wish(&longest), Some(Wish::Set(true)));
    }

    #[test]
    fn json_says_more() {
        let text = "{\"value\": \"ON\", \"confirm\": true, \"if\": \"OFF\", \"id\": \"a7\", \
            \"within_ms\": 900}";
        let order = parse(output(), text.as_bytes()).unwrap();
        assert!(order.confirm);
        assert_eq!((order.only_if, order.within_ms), (Some(false), Some(900)));
        assert_eq!(order.id.as_deref(), Some("a7"));
    }

    #[test]
    fn groups_and_scenes_have_their_own_words() {
        let group = || Target::Group("lamps".to_owned());
        let scene = || Target::Scene("night".to_owned());
        assert_eq!(wish_of(group(), "TOGGLE"), Some(Wish::Toggle));
        assert_eq!(wish_of(group(), "PULSE"), None);
        assert_eq!(wish_of(group(), "RUN"), None);
        for run in ["RUN", "ON", "{}", "{\"confirm\": true}"] {
            assert_eq!(wish_of(scene(), run), Some(Wish::Run), "{run}");
        }
        for none in ["", "OFF", "TOGGLE", "{\"value\": \"OFF\"}"] {
            assert_eq!(wish_of(scene(), none), None, "{none}");
        }
        let with_if = "{\"value\": \"ON\", \"if\": \"OFF\"}";
        assert_eq!(wish_of(group(), with_if), None);
    }
}
