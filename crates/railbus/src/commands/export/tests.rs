//! What the files say.

use super::asked::{Asked, url};
use super::{File, grafana, ha, nodered, prometheus, telegraf};
use proptest::prelude::*;
use railbus_app::config_file::FoundConfig;
use railbus_site::Config;
use railbus_words::Lang;
use serde_json::Value;
use std::path::PathBuf;

const SITE: &str = r#"
[line.main]
port = "/dev/ttyS99"
[module.oven]
line = "main"
model = "erc8"
address = 3
[module.oven.point]
k1 = { name = { en = "Fan", zh = "风扇" } }
k2 = { confirm = true }
k3 = { locked = true }
k4 = { hidden = true }
[module.tank]
line = "main"
model = "emd2a2q"
address = 5
[module.tank.point]
ai1 = { range = { signal = "4-20mA", low = -20, high = 80, unit = "℃", decimals = 1 } }
"#;
const MQTT: &str = "[outlet.home]\ntype = \"mqtt\"\nwrite = [\"*\"]\n";
const MODBUS: &str = "[outlet.plc]\ntype = \"modbus_tcp\"\nwrite = [\"*\"]\nwithin_ms = 2500\n";

fn site(folder: &str, text: &str) -> FoundConfig {
    FoundConfig {
        path: PathBuf::from(format!("/etc/{folder}/railbus.toml")),
        config: Config::parse(text).unwrap(),
    }
}

/// A form of the site with these outlets.
fn form(outlets: &str, address: &str, of: impl Fn(&Asked<'_>) -> File) -> File {
    let found = site("plant", &format!("{SITE}{outlets}"));
    of(&Asked::about(
        (Lang::En, "ha"),
        &found,
        url(address).unwrap(),
    ))
}

fn read(file: &File) -> Value {
    serde_yaml_ng::from_str(&file.text).unwrap()
}

const NEAR: &str = "http://127.0.0.1:7485";
const FAR: &str = "https://gate.example:7485";

/// What is this machine for railbus is the machine of railbus for others.
#[test]
fn another_machine_is_told_where_railbus_is() {
    let modbus = |address| read(&form(MODBUS, address, |asked| ha::file(asked).unwrap()));
    assert_eq!(modbus(NEAR)["modbus"][0]["host"], "127.0.0.1");
    assert_eq!(modbus(FAR)["modbus"][0]["host"], "gate.example");
    let broker = |outlets: &str, address| -> Value {
        let file = form(outlets, address, |asked| nodered::file(asked).unwrap());
        let flow: Vec<Value> = serde_json::from_str(&file.text).unwrap();
        let mut nodes = flow.into_iter();
        nodes.find(|node| node["type"] == "mqtt-broker").unwrap()["broker"].clone()
    };
    assert_eq!(broker(MQTT, FAR), "gate.example");
    let elsewhere = format!("{MQTT}host = \"10.0.0.7\"\n");
    assert_eq!(broker(&elsewhere, FAR), "10.0.0.7");
}

#[test]
fn a_switch_shows_what_was_read_back() {
    let mqtt = read(&form(MQTT, NEAR, |asked| ha::file(asked).unwrap()));
    let switches = mqtt["mqtt"]["switch"].as_array().unwrap();
    assert_eq!(switches.len(), 7, "k2, k3 and k4 are none");
    for switch in switches {
        assert_eq!(switch["optimistic"], false);
        assert!(switch["state_topic"].is_string(), "{switch}");
    }
    let modbus = read(&form(MODBUS, NEAR, |asked| ha::file(asked).unwrap()));
    let hub = &modbus["modbus"][0];
    for switch in hub["switches"].as_array().unwrap() {
        assert_eq!(switch["verify"]["input_type"], "coil", "{switch}");
    }
    let names = |kind: &str| -> Vec<&str> {
        let entities = hub[kind].as_array().unwrap().iter();
        entities
            .map(|entity| entity["name"].as_str().unwrap())
            .collect()
    };
    assert!(
        !names("switches")
            .iter()
            .any(|name| ["oven k2", "oven k3"].contains(name))
    );
    assert_eq!(names("binary_sensors"), ["oven k2", "oven k3"]);
    // The answer to a write comes within 2.5 s, and takes its own time.
    assert_eq!(hub["timeout"], 6);
    // -20 to 80 ℃ are 4 to 20 mA, in hundredths: 400 is -20, and 2000 is 80.
    let sensor = &hub["sensors"][0];
    assert_eq!(sensor["unit_of_measurement"], "°C");
    let value = |raw: f64| {
        let number = |key: &str| sensor[key].as_f64().unwrap();
        raw * number("scale") + number("offset")
    };
    assert!((value(400.0) + 20.0).abs() < 1e-6 && (value(2_000.0) - 80.0).abs() < 1e-6);
}

/// Numbers of any size keep their digits.
#[test]
fn a_small_range_is_scaled_as_exactly_as_a_large_one() {
    let text = SITE.replace(
        "low = -20, high = 80, unit = \"℃\", decimals = 1",
        "low = 0, high = 0.000001, unit = \"m\", decimals = 4",
    );
    let found = site("plant", &format!("{text}{MODBUS}"));
    let asked = Asked::about((Lang::En, "ha"), &found, url(NEAR).unwrap());
    let package = read(&ha::file(&asked).unwrap());
    let sensor = &package["modbus"][0]["sensors"][0];
    let number = |key: &str| sensor[key].as_f64().unwrap();
    let full = 2_000.0 * number("scale") + number("offset");
    assert!((full - 1e-6).abs() < 1e-15, "{full}");
}

#[test]
fn what_does_not_reach_home_assistant_is_named() {
    let notes = |text: &str, address| {
        let found = site("plant", text);
        let asked = Asked::about((Lang::En, "ha"), &found, url(address).unwrap());
        ha::file(&asked).unwrap().notes
    };
    let all = format!("{SITE}{MODBUS}");
    assert_eq!(notes(&all, NEAR), Vec::<String>::new());
    let [far] = &notes(&all, FAR)[..] else {
        panic!("it is reached from here only");
    };
    assert!(far.contains("plc listens at 127.0.0.1"), "{far}");
    let twice = format!(
        "[line.other]\nport = \"/dev/ttyS98\"\n[module.twin]\nline = \"other\"\n\
         model = \"erc8\"\naddress = 3\n{all}"
    );
    let [clash] = &notes(&twice, NEAR)[..] else {
        panic!("two modules have one address");
    };
    assert!(clash.ends_with(": oven, twin"), "{clash}");
}

#[test]
fn two_sites_of_one_name_can_have_ids_of_their_own() {
    let found = site("plant", &format!("{SITE}{MODBUS}"));
    let package = |name: &str| {
        let mut asked = Asked::about((Lang::En, "ha"), &found, url(NEAR).unwrap());
        asked.site = name.to_owned();
        read(&ha::file(&asked).unwrap())["modbus"][0].clone()
    };
    let (oslo, bergen) = (package("oslo"), package("bergen"));
    let id = |hub: &Value| hub["switches"][0]["unique_id"].clone();
    assert_ne!(id(&oslo), id(&bergen));
    assert_ne!(oslo["name"], bergen["name"]);
}

#[test]
fn what_is_never_polled_raises_no_alert() {
    let text = SITE.replace("address = 3", "address = 3\npoll = \"never\"");
    let found = site("plant", &text);
    let asked = Asked::about((Lang::En, "prometheus"), &found, url(NEAR).unwrap());
    let rules = read(&prometheus::rules(&asked));
    let expr = |alert: &str| {
        let mut all = rules["groups"][0]["rules"].as_array().unwrap().iter();
        let rule = all.find(|rule| rule["alert"] == alert).unwrap();
        rule["expr"].as_str().unwrap().to_owned()
    };
    let offline = expr("RailbusModuleOffline");
    assert!(offline.contains("module!~\"oven\""), "{offline}");
    let not_good = expr("RailbusValuesNotGood");
    assert!(
        not_good.contains("tank") && !not_good.contains("oven"),
        "{not_good}"
    );
    let board = grafana::file(&asked).text;
    assert!(
        board.contains("module!~\\\"oven\\\""),
        "offline modules of the overview"
    );
}

#[test]
fn a_command_from_node_red_is_waited_for_longer_than_a_reading() {
    let mut asked_twice = format!("{SITE}{MQTT}[outlet.other]\ntype = \"mqtt\"\n");
    asked_twice += "base = \"other\"\n";
    let found = site("plant", &asked_twice);
    let mut asked = Asked::about((Lang::En, "nodered"), &found, url(NEAR).unwrap());
    // Which of the outlets is meant is not asked.
    asked.is_http = true;
    let flow: Vec<Value> = serde_json::from_str(&nodered::file(&asked).unwrap().text).unwrap();
    let of = |words: &str| {
        let has = |node: &&Value| {
            node["func"]
                .as_str()
                .is_some_and(|code| code.contains(words))
        };
        flow.iter().filter(has).count()
    };
    assert_eq!(of("msg.requestTimeout = 1900;"), 1);
    assert_eq!(of("msg.requestTimeout = 15000;"), 1);
}

#[test]
fn of_outlets_that_fit_the_best_one_is_taken_and_of_two_none() {
    let both = read(&form(&format!("{MQTT}{MODBUS}"), NEAR, |asked| {
        ha::file(asked).unwrap()
    }));
    assert!(both["mqtt"].is_object(), "MQTT goes before Modbus");
    let refused = |outlets: &str| {
        let found = site("plant", &format!("{SITE}{outlets}"));
        let asked = Asked::about((Lang::En, "ha"), &found, url(NEAR).unwrap());
        ha::file(&asked).unwrap_err().code().name()
    };
    assert_eq!(refused(""), "E0838");
    assert_eq!(refused(&format!("{MQTT}enabled = false\n")), "E0838");
    let second = "[outlet.other]\ntype = \"mqtt\"\nbase = \"other\"\n";
    assert_eq!(refused(&format!("{MQTT}{second}")), "E0839");
}

#[test]
fn only_what_may_be_switched_unasked_has_buttons() {
    let buttons = |outlets: &str| -> Vec<String> {
        let file = form(outlets, NEAR, |asked| nodered::file(asked).unwrap());
        let flow: Vec<Value> = serde_json::from_str(&file.text).unwrap();
        let buttons = flow.iter().filter(|node| node["type"] == "inject");
        let names = buttons.filter_map(|node| node["name"].as_str());
        names
            .filter(|name| name.starts_with('k'))
            .map(str::to_owned)
            .collect()
    };
    for outlets in ["", MQTT] {
        let names = buttons(outlets);
        assert!(names.contains(&"k1 ON".to_owned()), "{names:?}");
        let guarded = |name: &&String| ["k3 ", "k4 "].iter().any(|label| name.starts_with(label));
        assert_eq!(names.iter().find(guarded), None);
        // Of the oven; the tank has one of this label that requires no confirmation.
        assert_eq!(names.iter().filter(|name| *name == "k2 ON").count(), 1);
    }
    let few = "[outlet.home]\ntype = \"mqtt\"\nwrite = [\"oven.k1\"]\n";
    assert_eq!(buttons(few), ["k1 ON", "k1 OFF"]);
}

/// Every node is there once, and every wire ends at one.
#[test]
fn a_flow_is_whole() {
    for outlets in ["", MQTT] {
        let file = form(outlets, FAR, |asked| nodered::file(asked).unwrap());
        let flow: Vec<Value> = serde_json::from_str(&file.text).unwrap();
        let ids: Vec<&str> = flow
            .iter()
            .map(|node| node["id"].as_str().unwrap())
            .collect();
        let mut once = ids.clone();
        once.sort_unstable();
        once.dedup();
        assert_eq!(once.len(), ids.len());
        for node in &flow {
            let wires = node["wires"].as_array().into_iter().flatten();
            let ends = wires.flat_map(|output| output.as_array().unwrap());
            let scope = node["scope"].as_array().into_iter().flatten();
            let refers = ["z", "broker", "tls"].map(|key| &node[key]);
            let tab = node["type"] != "mqtt-broker";
            for end in ends.chain(scope).chain(refers.into_iter().filter(|_| tab)) {
                let is_one = end.as_str().is_none_or(|end| ids.contains(&end));
                assert!(is_one, "{node}");
            }
            if let Some(labels) = node["outputLabels"].as_array() {
                assert_eq!(node["outputs"], labels.len());
                assert_eq!(node["wires"].as_array().unwrap().len(), labels.len());
            }
        }
    }
}

/// Everything that comes over HTTP is only for those with a token, which stands in a file.
#[test]
fn a_token_is_in_a_file_and_a_certificate_is_trusted() {
    let config = read(&form("", FAR, prometheus::file));
    let job = &config["scrape_configs"][0];
    assert_eq!(job["authorization"]["credentials_file"], "railbus.token");
    assert_eq!(job["tls_config"]["ca_file"], "railbus.pem");
    assert_eq!(job["static_configs"][0]["targets"][0], "gate.example:7485");
    assert!(read(&form("", NEAR, prometheus::file))["scrape_configs"][0]["tls_config"].is_null());
    let file = form("", FAR, telegraf::file);
    let told: toml::Table = toml::from_str(&file.text).unwrap();
    for (input, token) in [("http", "token_file"), ("prometheus", "bearer_token")] {
        let input = &told["inputs"][input][0];
        assert_eq!(input[token].as_str(), Some("/etc/telegraf/railbus.token"));
        assert_eq!(input["tls_ca"].as_str(), Some("/etc/telegraf/railbus.pem"));
    }
    assert!(file.notes[0].contains("railbus token create telegraf --role viewer"));
}

/// No value is taken that is not good, and every one has the time at which it was read.
#[test]
fn telegraf_takes_only_good_values() {
    let told: toml::Table = toml::from_str(&form("", NEAR, telegraf::file).text).unwrap();
    let objects = told["inputs"]["http"][0]["json_v2"][0]["object"]
        .as_array()
        .unwrap();
    let mut types = std::collections::BTreeMap::new();
    for object in objects {
        let keys = object["included_keys"].as_array().unwrap();
        if !keys.contains(&"value".into()) {
            assert_eq!(keys, &["quality".into()]);
            continue;
        }
        let path = object["path"].as_str().unwrap();
        assert!(path.ends_with("|#(quality==\"good\")#"), "{path}");
        assert_eq!(object["timestamp_key"].as_str(), Some("time"));
        let field = object["renames"]["value"].as_str().unwrap();
        let of_type = object["fields"]["value"].as_str().unwrap();
        assert_eq!(*types.entry(field).or_insert(of_type), of_type, "{field}");
    }
    assert_eq!(types.len(), 2);
}

#[test]
fn names_are_in_the_language_of_the_user() {
    let found = site("plant", SITE);
    for (lang, name) in [(Lang::En, "k1 Fan"), (Lang::Zh, "k1 风扇")] {
        let asked = Asked::about((lang, "grafana"), &found, url(NEAR).unwrap());
        let board: Value = serde_json::from_str(&grafana::file(&asked).text).unwrap();
        let panels = board["panels"].as_array().unwrap();
        let shown = panels.iter().flat_map(|panel| {
            let overrides = panel["fieldConfig"]["overrides"].as_array();
            overrides
                .into_iter()
                .flatten()
                .map(|one| &one["properties"][0]["value"])
        });
        assert!(shown.into_iter().any(|shown| shown == name), "{name}");
        assert!(
            panels
                .iter()
                .all(|panel| panel["title"].as_str().is_some_and(|t| !t.is_empty()))
        );
    }
}

#[test]
fn panels_do_not_overlap() {
    let board: Value = serde_json::from_str(&form("", NEAR, grafana::file).text).unwrap();
    let panels = board["panels"].as_array().unwrap();
    let place =
        |panel: &Value| ["x", "y", "w", "h"].map(|key| panel["gridPos"][key].as_u64().unwrap());
    for (nth, panel) in panels.iter().enumerate() {
        let [x, y, w, h] = place(panel);
        assert!(x + w <= 24, "{panel}");
        for other in &panels[..nth] {
            let [a, b, c, d] = place(other);
            let apart = x + w <= a || a + c <= x || y + h <= b || b + d <= y;
            assert!(apart, "{panel} {other}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever a site, a module, a point or a unit is called, a reader finds it again.
    #[test]
    fn every_name_stays_what_it_is(
        site_name in "[^/\\p{Cc}]{1,12}",
        name in "\\PC{1,12}",
        unit in "\\PC{1,8}",
    ) {
        let quoted = |text: &str| serde_json::to_string(text).unwrap();
        let text = SITE
            .replace("address = 3", &format!("address = 3\nname = {}", quoted(&name)))
            .replace("{ en = \"Fan\", zh = \"风扇\" }", &quoted(&name))
            .replace("\"℃\"", &quoted(&unit));
        // What a configuration does not take has no name here.
        let Ok(config) = Config::parse(&format!("{text}{MQTT}{MODBUS}")) else {
            return Ok(());
        };
        prop_assume!(!matches!(site_name.as_str(), "." | ".."));
        let path = PathBuf::from(format!("/etc/{site_name}/railbus.toml"));
        let found = FoundConfig { path, config };
        let asked = Asked::about((Lang::Zh, "ha"), &found, url(NEAR).unwrap());
        let is_in = |value: &Value, wanted: &str| {
            let mut left = vec![value];
            while let Some(value) = left.pop() {
                match value {
                    Value::String(text) if text.contains(wanted) => return true,
                    Value::Array(items) => left.extend(items),
                    Value::Object(keys) => left.extend(keys.values()),
                    _ => {}
                }
            }
            false
        };
        let home = read(&ha::file(&asked).unwrap());
        prop_assert!(is_in(&home, &name));
        prop_assert!(is_in(&read(&prometheus::file(&asked)), &site_name));
        let rules = read(&prometheus::rules(&asked));
        prop_assert_eq!(rules["groups"][0]["rules"].as_array().unwrap().len(), 8);
        let flow: Value = serde_json::from_str(&nodered::file(&asked).unwrap().text).unwrap();
        prop_assert!(is_in(&flow, &name) && is_in(&flow, &site_name));
        let board: Value = serde_json::from_str(&grafana::file(&asked).text).unwrap();
        prop_assert!(is_in(&board, &name) && is_in(&board, &site_name));
        let told: toml::Table = toml::from_str(&telegraf::file(&asked).text).unwrap();
        let tags = &told["inputs"]["http"][0]["tags"];
        prop_assert_eq!(tags["site"].as_str(), Some(&*site_name));
    }
}
