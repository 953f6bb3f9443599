//! The topics of an outlet, below `<base>/<site>/`.

use super::discovery::Discovery;
use super::orders::Target;
use crate::northbound::broker::level;
use std::collections::BTreeSet;

/// The longest topic that a result goes to because its sender asked for it.
const RESPONSE_MAX: usize = 256;
/// The longest topic of all (MQTT 5, section 1.5.4), in bytes.
pub(super) const TOPIC_MAX: usize = 65_535;
/// The first levels that are no modules.
const OWN: [&str; 5] = ["batch", "bridge", "event", "group", "scene"];

/// What is said of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Facet {
    /// Its value.
    State,
    /// How good that is.
    Attr,
}

/// The topics of an outlet.
#[derive(Clone, Debug)]
pub(super) struct Topics {
    /// `<base>/<site>`.
    prefix: String,
    /// The modules that it is about; empty for all.
    modules: BTreeSet<String>,
    /// How Home Assistant is told of them, if it is.
    discovery: Option<Discovery>,
}

impl Topics {
    /// Below these, about these modules, or about all if there are none.
    pub(super) fn new(base: &str, site: &str, modules: BTreeSet<String>) -> Topics {
        let prefix = format!("{base}/{}", level(site));
        Topics {
            prefix,
            modules,
            discovery: None,
        }
    }

    /// The same, and Home Assistant is told of them, if so.
    pub(super) fn with(self, discovery: Option<Discovery>) -> Topics {
        Topics { discovery, ..self }
    }

    /// How Home Assistant is told of them, if it is.
    pub(super) const fn discovery(&self) -> Option<&Discovery> {
        self.discovery.as_ref()
    }

    /// Whether Home Assistant is told of a module at a topic.
    pub(super) fn describes(&self, topic: &str) -> bool {
        let discovery = self.discovery.as_ref();
        discovery.is_some_and(|discovery| discovery.has(topic))
    }

    /// Whether Home Assistant says at a topic that it is there.
    pub(super) fn is_status(&self, topic: &str) -> bool {
        let discovery = self.discovery.as_ref();
        discovery.is_some_and(|discovery| discovery.status() == topic)
    }

    /// Whether a module is told. One that is called as a first level of another meaning is not.
    pub(super) fn has(&self, module: &str) -> bool {
        let is_chosen = self.modules.is_empty() || self.modules.contains(module);
        is_chosen && !OWN.contains(&module)
    }

    /// `online` or `offline`, for the outlet as a whole.
    pub(super) fn bridge_state(&self) -> String {
        self.of("bridge/state")
    }

    /// What is served.
    pub(super) fn bridge_info(&self) -> String {
        self.of("bridge/info")
    }

    /// How it does.
    pub(super) fn bridge_health(&self) -> String {
        self.of("bridge/health")
    }

    /// What happens at the site.
    pub(super) fn event(&self) -> String {
        self.of("event")
    }

    /// Every change in its order.
    pub(super) fn batch(&self) -> String {
        self.of("batch")
    }

    /// Whether a module answers.
    pub(super) fn availability(&self, module: &str) -> String {
        self.of(&format!("{module}/availability"))
    }

    /// What is said of a point.
    pub(super) fn point(&self, module: &str, label: &str, facet: Facet) -> String {
        let facet = match facet {
            Facet::State => "state",
            Facet::Attr => "attr",
        };
        self.of(&format!("{module}/{label}/{facet}"))
    }

    /// The topic of the value that this one says the quality and time of.
    pub(super) fn value_of(topic: &str) -> Option<String> {
        let point = topic.strip_suffix("/attr")?;
        Some(format!("{point}/state"))
    }

    /// Where an output is commanded.
    pub(super) fn set(&self, module: &str, label: &str) -> String {
        self.of(&format!("{module}/{label}/set"))
    }

    fn of(&self, rest: &str) -> String {
        format!("{}/{rest}", self.prefix)
    }

    /// Where commands come from, and that Home Assistant is there.
    pub(super) fn commands(&self) -> Vec<String> {
        let own = [self.of("+/+/set"), self.of("scene/+/run")];
        let status = self.discovery.as_ref().map(Discovery::status);
        own.into_iter().chain(status).collect()
    }

    /// What a command at this topic is for.
    pub(super) fn target(&self, topic: &str) -> Option<Target> {
        let rest = topic.strip_prefix(&self.prefix)?.strip_prefix('/')?;
        let levels: Vec<&str> = rest.split('/').collect();
        let [first, name, verb] = levels[..] else {
            return None;
        };
        let name = name.to_owned();
        match (first, verb) {
            ("group", "set") => Some(Target::Group(name)),
            ("scene", "run") => Some(Target::Scene(name)),
            (module, "set") => Some(Target::Output(module.to_owned(), name)),
            _ => None,
        }
    }

    /// Where the result of a command at this topic goes.
    pub(super) fn result(topic: &str) -> String {
        let parent = topic.rsplit_once('/').map_or(topic, |(parent, _)| parent);
        format!("{parent}/result")
    }

    /// Whether a result may go to a topic because its sender asks for it. It may not where that is
    /// one of the outlet's own: who may only command can't speak in its name.
    pub(super) fn may_respond(&self, topic: &str) -> bool {
        let is_topic = (1..=RESPONSE_MAX).contains(&topic.len())
            && !topic.starts_with('$')
            && !topic.contains(['+', '#', '\0']);
        is_topic && !self.is_own(topic)
    }

    /// Whether the outlet speaks at this topic in its own name.
    pub(super) fn is_own(&self, topic: &str) -> bool {
        let own = topic.strip_prefix(&self.prefix);
        let is_own = own.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
        is_own || self.describes(topic)
    }

    /// Whether a topic has a value, or whether a module answers: who reads an old one acts on
    /// what is no longer true.
    pub(super) fn is_vital(topic: &str) -> bool {
        topic.ends_with("/state") || topic.ends_with("/availability")
    }
}

/// Whether a text can stand before the topics: levels that are not empty, without wildcards.
pub(super) fn is_base(text: &str) -> bool {
    text.split('/')
        .all(|part| !part.is_empty() && level(part) == part)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn topics() -> Topics {
        Topics::new("railbus", "plant", BTreeSet::new())
    }

    #[test]
    fn a_command_is_known_by_its_topic() {
        let target = |topic: &str| topics().target(topic);
        let output =
            |module: &str, label: &str| Some(Target::Output(module.to_owned(), label.to_owned()));
        assert_eq!(target("railbus/plant/oven/k1/set"), output("oven", "k1"));
        let group = Some(Target::Group("lamps".to_owned()));
        assert_eq!(target("railbus/plant/group/lamps/set"), group);
        let scene = Some(Target::Scene("night".to_owned()));
        assert_eq!(target("railbus/plant/scene/night/run"), scene);
        for other in [
            "railbus/plant/oven/k1/run",
            "railbus/plant/oven/k1/state",
            "railbus/plant/oven/k1/k2/set",
            "railbus/plant/oven/set",
            "railbus/plants/oven/k1/set",
            "railbus/plant",
            "",
        ] {
            assert_eq!(target(other), None, "{other}");
        }
        let result = Topics::result("railbus/plant/oven/k1/set");
        assert_eq!(result, "railbus/plant/oven/k1/result");
    }

    #[test]
    fn a_site_is_one_level() {
        assert_eq!(level("North wing/2+#$"), "North_wing_2___");
        assert_eq!(level("1号车间"), "1号车间");
        assert_eq!(level(""), "site");
        assert!(is_base("railbus") && is_base("plants/north"));
        for wrong in ["", "/", "a/", "/a", "a//b", "a/#", "+", "a b", "$SYS"] {
            assert!(!is_base(wrong), "{wrong}");
        }
    }

    #[test]
    fn names_of_other_meaning_are_no_modules() {
        let some = Topics::new("railbus", "plant", BTreeSet::from(["oven".to_owned()]));
        assert!(topics().has("oven") && topics().has("pump"));
        assert!(some.has("oven") && !some.has("pump"));
        for own in OWN {
            assert!(!topics().has(own), "{own}");
        }
    }

    #[test]
    fn a_result_goes_nowhere_where_the_outlet_speaks_itself() {
        let may = |topic: &str| topics().may_respond(topic);
        assert!(may("answers/7") && may("railbus/plants") && may("railbus"));
        for wrong in [
            "",
            "a/+",
            "#",
            "$SYS/x",
            "railbus/plant",
            "railbus/plant/bridge/state",
            "railbus/plant/oven/k1/set",
        ] {
            assert!(!may(wrong), "{wrong}");
        }
        assert!(!may(&"a".repeat(RESPONSE_MAX + 1)));
    }
}
