//! Integrations that publish the site to other systems: one folder each.

pub(super) mod webhook;
