//! The topics of an edge node and its devices.

use crate::northbound::broker::link::Filter;
use std::collections::BTreeSet;

/// The namespace of Sparkplug B.
const NAMESPACE: &str = "spBv1.0";

/// What a topic is about, of those that come here.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Topic {
    /// A command to the node.
    Node,
    /// A command to a device.
    Device(String),
    /// The state of the primary host.
    Host,
}

/// Who the edge node is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Topics {
    pub(super) group: String,
    pub(super) node: String,
    /// The primary host application, if there is one.
    pub(super) host: Option<String>,
    /// The modules that it is about; empty for all.
    pub(super) modules: BTreeSet<String>,
}

impl Topics {
    /// Whether a module is a device of the node.
    pub(super) fn has(&self, module: &str) -> bool {
        self.modules.is_empty() || self.modules.contains(module)
    }

    /// Of a message about the node: `NBIRTH`, `NDEATH`, `NDATA`.
    pub(super) fn node(&self, kind: &str) -> String {
        format!("{NAMESPACE}/{}/{kind}/{}", self.group, self.node)
    }

    /// Of a message about a device: `DBIRTH`, `DDEATH`, `DDATA`.
    pub(super) fn device(&self, kind: &str, device: &str) -> String {
        format!("{}/{device}", self.node(kind))
    }

    fn state(&self) -> Option<String> {
        let host = self.host.as_ref()?;
        Some(format!("{NAMESPACE}/STATE/{host}"))
    }

    /// What is to come. The broker keeps the state of the host for those who come later, and
    /// commands that it kept are of another time.
    pub(super) fn filters(&self) -> Vec<Filter> {
        let filter = |topic, with_kept| Filter { topic, with_kept };
        let commands = [self.node("NCMD"), self.device("DCMD", "+")];
        let commands = commands.map(|topic| filter(topic, false));
        let state = self.state().map(|topic| filter(topic, true));
        commands.into_iter().chain(state).collect()
    }

    /// What a message at this topic is about; none where it is of somebody else.
    pub(super) fn about(&self, topic: &str) -> Option<Topic> {
        if self.state().as_deref() == Some(topic) {
            return Some(Topic::Host);
        }
        if topic == self.node("NCMD") {
            return Some(Topic::Node);
        }
        let device = topic.strip_prefix(&self.device("DCMD", ""))?;
        Some(Topic::Device(device.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_known_by_its_topic() {
        let topics = Topics {
            group: "g".to_owned(),
            node: "n".to_owned(),
            host: Some("scada".to_owned()),
            modules: BTreeSet::new(),
        };
        for (topic, about) in [
            ("spBv1.0/g/NCMD/n", Some(Topic::Node)),
            (
                "spBv1.0/g/DCMD/n/oven",
                Some(Topic::Device("oven".to_owned())),
            ),
            ("spBv1.0/STATE/scada", Some(Topic::Host)),
            ("spBv1.0/STATE/Scada", None),
            ("spBv1.0/g/NCMD/m", None),
            ("spBv1.0/g/DCMD/n", None),
            ("spBv1.0/g/DCMD/m/oven", None),
            ("spBv1.0/h/NCMD/n", None),
        ] {
            assert_eq!(topics.about(topic), about, "{topic}");
        }
        let filters = topics.filters();
        let kept: Vec<_> = filters.iter().filter(|filter| filter.with_kept).collect();
        assert_eq!(kept.len(), 1);
        assert_eq!(kept[0].topic, "spBv1.0/STATE/scada");
        let none = Topics {
            host: None,
            ..topics
        };
        assert_eq!(none.about("spBv1.0/STATE/"), None);
        assert_eq!(none.filters().len(), 2);
    }
}
