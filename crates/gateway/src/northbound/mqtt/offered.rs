//! Its topics and entities, by its settings alone.

use super::discovery::{Form, by_hand};
use super::node::HEALTH_EVERY;
use super::settings;
use super::topics::Facet;
use crate::northbound::offered::{
    HomeEntity, MqttOffer, MqttOfferModule, MqttOfferPoint, can_be_wired, shown,
};
use crate::northbound::outlet;
use railbus_site::Config;
use railbus_site::config::ModuleConfig;
use railbus_site::config::change::Keys;

/// What the outlet of this name offers at this site.
pub(super) fn offer(name: &str, settings: &Keys, site: &str, config: &Config) -> MqttOffer {
    let broker = settings::broker(settings, site, name);
    let topics = settings::topics(settings, site);
    let rights = outlet::rights(settings);
    let of_module = |(module, described): (&String, &ModuleConfig)| MqttOfferModule {
        module: module.clone(),
        availability: topics.availability(module),
        states: topics.point(module, "+", Facet::State),
        points: shown(described)
            .map(|(label, point)| {
                let may = rights.may_switch(module, &label).is_ok();
                MqttOfferPoint {
                    state: topics.point(module, &label, Facet::State),
                    set: (may && can_be_wired(described, point))
                        .then(|| topics.set(module, &label)),
                    point,
                    label,
                }
            })
            .collect(),
    };
    let modules = config.modules.iter().filter(|(name, _)| topics.has(name));
    let discovery = settings::described(settings, site, Form::Device);
    let entities = by_hand(&topics, &discovery, config).into_iter();
    MqttOffer {
        host: broker.host,
        port: broker.port,
        is_tls: broker.is_tls,
        bridge: topics.bridge_state(),
        health: topics.bridge_health(),
        health_every_s: HEALTH_EVERY.as_secs(),
        modules: modules.map(of_module).collect(),
        entities: entities
            .map(|(kind, config)| HomeEntity { kind, config })
            .collect(),
        is_discovered: topics.discovery().is_some(),
    }
}

#[cfg(test)]
mod tests;
