//! What only the owner of a site can allow: where a configuration that arrives over the network may
//! connect to. The tables `[ports]` and `[webhooks]`.

use super::Config;
use super::read::{Reader, Section};
use std::ops::Range as Span;
use toml::de::DeTable;

pub(super) const ALLOW_KEYS: [&str; 1] = ["allow"];
/// The maximum number of patterns in a list.
const ALLOWED_MAX: usize = 64;

/// What is allowed beyond the defaults, as patterns with `*` and `?`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Allowed {
    /// Ports that lines may have.
    pub ports: Vec<String>,
    /// Receivers on this machine or its link that webhooks may have: `host`, `host:port`.
    pub webhooks: Vec<String>,
}

impl Allowed {
    /// The tables of which it is made, as they are written.
    pub const TABLES: &'static str = "[ports] [webhooks]";
}

impl<'t> Reader<'t> {
    /// `[ports]` and `[webhooks]`.
    pub(super) fn allowed(&mut self, root: &DeTable<'t>, config: &mut Config) {
        // Their problems are already reported.
        config.allowed.ports = self.allow(root, "ports").unwrap_or_default();
        config.allowed.webhooks = self.allow(root, "webhooks").unwrap_or_default();
    }

    fn allow(&mut self, root: &DeTable<'t>, name: &'static str) -> Option<Vec<String>> {
        let value = root.get(name)?;
        let table = self.table(value, name)?;
        let section = Section::of(name.to_owned(), value, table);
        self.check_keys(&section, &ALLOW_KEYS);
        let list: Option<Vec<(Span<usize>, String)>> =
            self.optional(&section, "allow", |reader, value, path| {
                reader.names(value, path, ("list of patterns", ALLOWED_MAX))
            })?;
        let patterns = list.unwrap_or_default().into_iter();
        Some(patterns.map(|(_, pattern)| pattern).collect())
    }
}
