//! Its points and their addresses, by its settings alone.

use super::{LISTEN, settings};
use crate::northbound::modbus::{fields, offered};
use crate::northbound::network;
use crate::northbound::offered::{ModbusOffer, OfferWay};
use railbus_site::Config;
use railbus_site::config::change::Keys;

/// What a server with these settings offers: nothing with TLS, which the other programs do not
/// speak.
pub(super) fn offer(settings: &Keys, config: &Config) -> Option<OfferWay> {
    let is_secure = settings::FILES
        .iter()
        .any(|key| settings.contains_key(*key));
    let listen = network::listen(settings, LISTEN).filter(|_| !is_secure)?;
    Some(OfferWay::ModbusTcp(ModbusOffer {
        listen,
        within_ms: fields::within_ms(settings),
        points: offered::points(settings, config),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::northbound::offered::{ModbusPlace, offers};
    use std::path::Path;

    const SITE: &str = r#"
[line.main]
port = "/dev/ttyS99"
[module.oven]
line = "main"
model = "erc8"
address = 3
[module.oven.point]
k2 = { confirm = true }
k3 = { locked = true }
k4 = { hidden = true }
[module.pump]
line = "main"
model = "eda9060a"
address = 4
[module.tank]
line = "main"
model = "emd2a2q"
address = 5
"#;

    fn offered(settings: &str) -> Option<ModbusOffer> {
        let text = format!("{SITE}[outlet.plc]\ntype = \"modbus_tcp\"\n{settings}");
        let config = Config::parse(&text).unwrap();
        let offer = offers(Path::new("/etc/plant/railbus.toml"), &config).pop()?;
        match offer.way {
            OfferWay::ModbusTcp(offer) => Some(offer),
            OfferWay::Mqtt(_) => panic!("Modbus"),
        }
    }

    #[test]
    fn a_point_stands_where_the_server_has_it() {
        let places = |offer: &ModbusOffer, module: &str| -> Vec<_> {
            let its = offer.points.iter().filter(|point| point.module == module);
            its.map(|one| {
                (
                    one.label.clone(),
                    one.unit,
                    one.place,
                    one.address,
                    one.may_switch,
                )
            })
            .collect()
        };
        let own = offered("write = [\"oven\"]\nunits = [\"tank=9\"]").unwrap();
        let oven = places(&own, "oven");
        assert_eq!(oven.len(), 7, "k4 is hidden");
        assert_eq!(oven[0], ("k1".to_owned(), 3, ModbusPlace::Coil, 60, true));
        assert!(!oven[1].4, "k2 wants to be confirmed");
        assert_eq!(oven[3], ("k5".to_owned(), 3, ModbusPlace::Coil, 64, true));
        let tank = places(&own, "tank");
        let ai2 = (
            "ai2".to_owned(),
            9,
            ModbusPlace::HoldingHundredths,
            7,
            false,
        );
        assert!(tank.contains(&ai2), "{tank:?}");
        assert!(tank.contains(&("k1".to_owned(), 9, ModbusPlace::Coil, 8, false)));
        let pump = places(&own, "pump");
        let di1 = ("di1".to_owned(), 4, ModbusPlace::DiscreteInput, 1, false);
        assert!(pump.contains(&di1), "{pump:?}");
        let uniform = offered("map = \"uniform\"").unwrap();
        let ai2 = ("ai2".to_owned(), 5, ModbusPlace::InputFloat, 18, false);
        assert!(places(&uniform, "tank").contains(&ai2));
        assert_eq!(places(&uniform, "oven")[0].3, 0);
    }

    #[test]
    fn what_is_off_or_only_for_holders_of_certificates_is_not_offered() {
        assert!(offered("").is_some());
        assert!(offered("enabled = false\n").is_none());
        let secure = "tls_cert = \"/c\"\ntls_key = \"/k\"\nclient_ca = \"/a\"\n";
        assert!(offered(secure).is_none());
    }
}
