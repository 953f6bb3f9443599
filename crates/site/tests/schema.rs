//! The published schema of a configuration says what the reader does.

use jsonschema::Validator;
use railbus_device::Family;
use railbus_site::Config;
use railbus_site::config::{Invalid, SCHEMA, TABLES};
use railbus_wire::Protocol;
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use toml::de::{DeTable, DeValue};

/// Something of everything.
const ALL: &str = r#"
[ports]
allow = ["tcp:10.0.0.*:4001"]

[webhooks]
allow = ["127.0.0.1:1880"]

[line.main]
name = { zh = "一号线" }
port = "/dev/serial/by-id/usb-FTDI_FT232R_A10KZP45-if00-port0"
baud = 19200
format = "8E1"
echo = "off"
sim = { pty = "/tmp/main", tcp = "127.0.0.1:4001", faults = "noise 1e-4" }

[module.pump]
line = "main"
model = "eda9060a"
address = 0x01
protocol = "ascii"
baud = 9600
format = "8N1"
checksum = true
gap = "5ms"
poll = "200ms"
max_age = "1.5s"
identify = false
settings = { do3.mode = "pulse" }

[module.pump.point]
do0 = { name = { en = "Pump 1", zh = "一号水泵" }, locked = true }
do1 = { name = "Pump 2", interlock = ["oven.k1"], on_offline = "off" }
do2 = { confirm = "hold", max_on = "10m", min_off = "5s", on_exit = "off", on_return = "hold" }

[module.oven]
line = "main"
model = "erc8"
name = { en = "Oven", zh = "烘箱" }
area = "Hall 2"
address = 3
poll = "never"

[module.tank]
line = "main"
model = "emd2a2q"
address = 5
range = { low = 0, high = 4.5, unit = "m", decimals = 2 }
point.ai2 = { hidden = true, range = { signal = "4-20mA", low = 0, high = 16, unit = "bar" } }
sim = { power = "on", inputs = { ai1 = { from = 1.2, to = 8.8, every = "4m" }, ai2 = 3 } }

[module.yard]
line = "main"
model = "r55"
address = 4
baud = 9600
format = "8N1"
outputs = 8
layout = "outputs"
invert_on_off = true

[group.night]
name = { en = "Night", zh = "夜间" }
members = ["oven.k1", "yard.k1"]

[scene.evening]
steps = [{ set = "yard.k1", to = true }, { wait = "500ms" }, { set = "oven.k2", to = false }]

[rule.full]
name = "Full"
when = { point = "tank.ai1", above = 4.2, hysteresis = 0.2, unit = "m" }
for = "30s"
then = [
    { set = "yard.k1", to = true },
    { pulse = "pump.do1", width = "2s" },
    { notify = "The tank is full" },
]

[rule.morning]
when = { time = "06:30", days = ["mon", "fri"] }
then = [{ pulse = "yard.k2", width = "500ms" }]
armed = true

[rule.lost]
when = { module_offline = "pump" }
for = "5m"
then = [{ notify = "The pump does not answer" }]

[webhook.alerts]
url = "https://hooks.example.com:8443/railbus?x=1"
events = ["alarm", "module"]
severity = "warning"
lines = ["main"]
modules = ["oven"]
enabled = false

[history]
keep = "90d"
max_bytes = "2GB"

[audit]
required = true

[sim]
seed = 7
speed = 1.5
"#;

fn schema() -> Value {
    serde_json::from_str(SCHEMA).unwrap()
}

fn validator() -> Validator {
    jsonschema::validator_for(&schema()).unwrap()
}

fn as_json(table: &DeTable<'_>) -> Value {
    let pairs = table.iter().map(|(key, value)| {
        let value = value_as_json(value.get_ref());
        (key.get_ref().to_string(), value)
    });
    Value::Object(pairs.collect::<Map<_, _>>())
}

fn value_as_json(value: &DeValue<'_>) -> Value {
    match value {
        DeValue::String(text) => json!(text),
        DeValue::Integer(number) => {
            json!(i64::from_str_radix(number.as_str(), number.radix()).unwrap())
        }
        DeValue::Float(number) => json!(number.as_str().parse::<f64>().unwrap()),
        DeValue::Boolean(truth) => json!(truth),
        DeValue::Array(items) => items
            .iter()
            .map(|item| value_as_json(item.get_ref()))
            .collect(),
        DeValue::Table(table) => as_json(table),
        DeValue::Datetime(_) => Value::Null,
    }
}

fn objections(text: &str) -> Vec<String> {
    let table = DeTable::parse(text).unwrap();
    let value = as_json(table.get_ref());
    let validator = validator();
    let errors = validator.iter_errors(&value);
    errors
        .map(|error| format!("{}: {error}", error.instance_path()))
        .collect()
}

#[test]
fn the_schema_has_the_keys_that_the_reader_knows() {
    let schema = schema();
    assert!(jsonschema::meta::is_valid(&schema));
    for (name, keys) in TABLES {
        let table = match name {
            "" => &schema,
            name => &schema["$defs"][name],
        };
        let told: BTreeSet<&str> = table["properties"]
            .as_object()
            .unwrap_or_else(|| panic!("{name}"))
            .keys()
            .map(String::as_str)
            .collect();
        assert_eq!(told, keys.iter().copied().collect(), "[{name}]");
        // What else an outlet has is up to its kind, which the gateway knows.
        let is_open = name == "outlet";
        assert_eq!(table["additionalProperties"], is_open, "[{name}]");
    }
}

#[test]
fn the_schema_has_the_choices_that_the_reader_has() {
    let defs = schema()["$defs"].clone();
    let names = |value: &Value| -> BTreeSet<String> {
        let all = value["enum"].as_array().unwrap().iter();
        all.map(|name| name.as_str().map_or(name.to_string(), str::to_owned))
            .collect()
    };
    let models = Family::ALL.map(|family| family.name().to_owned());
    assert_eq!(names(&defs["module"]["properties"]["model"]), models.into());
    let protocols = Protocol::ALL.map(|protocol| protocol.name().to_owned());
    assert_eq!(
        names(&defs["module"]["properties"]["protocol"]),
        protocols.into()
    );

    // Of everything else the reader says itself what it could have been.
    let line = "[line.a]\nport = \"/dev/a\"\n";
    let module = format!("{line}[module.m]\nline = \"a\"\nmodel = \"erc8\"\naddress = 1\n");
    let point = format!("{module}[module.m.point]\n");
    let sim = format!("{module}[module.m.sim]\n");
    let hook = "[webhook.h]\nurl = \"http://a\"\n";
    let module_sim = |key: &str| defs["module_sim"]["properties"][key].clone();
    let cases = [
        (format!("{line}baud = 1"), defs["baud"].clone()),
        (format!("{line}format = \"?\""), defs["format"].clone()),
        (
            format!("{line}echo = \"?\""),
            defs["line"]["properties"]["echo"].clone(),
        ),
        (
            format!("{module}layout = \"?\""),
            defs["module"]["properties"]["layout"].clone(),
        ),
        (
            format!("{point}k1.on_exit = \"?\""),
            defs["point"]["properties"]["on_exit"].clone(),
        ),
        (format!("{sim}power = \"?\""), module_sim("power")),
        (
            format!("{sim}init_sampled = \"?\""),
            module_sim("init_sampled"),
        ),
        (format!("{sim}applies = \"?\""), module_sim("applies")),
        (
            format!("{hook}severity = \"?\""),
            defs["webhook"]["properties"]["severity"].clone(),
        ),
        (
            format!("{hook}events = [\"?\"]"),
            defs["webhook"]["properties"]["events"]["items"].clone(),
        ),
    ];
    for (text, told) in cases {
        let problems = Config::parse(&text).unwrap_err();
        let choices = problems.iter().find_map(|problem| match &problem.kind {
            Invalid::NotOneOf(choices) => Some(choices.iter().map(ToString::to_string).collect()),
            _ => None,
        });
        assert_eq!(choices, Some(names(&told)), "{text}");
        assert!(!objections(&text).is_empty(), "{text}");
    }
}

#[test]
fn what_the_reader_takes_the_schema_takes() {
    assert_eq!(Config::parse(ALL).map(|_| ()), Ok(()));
    assert_eq!(objections(ALL), [""; 0]);
    let demo = include_str!("../../plant/src/demo.toml").replace("PORT", "/tmp/line");
    assert_eq!(objections(&demo), [""; 0]);
    let modules = include_str!("../../railbus/tests/cli/modules.toml");
    assert_eq!(objections(modules), [""; 0]);
    let guide = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/guide/en/src");
    let mut count = 0;
    for page in std::fs::read_dir(guide).unwrap() {
        let text = std::fs::read_to_string(page.unwrap().path()).unwrap();
        for block in text.split("```toml").skip(1) {
            let block = block.split("```").next().unwrap_or_default();
            let block = block.split_once('\n').unwrap_or_default().1;
            if Config::parse(block).is_ok() {
                assert_eq!(objections(block), [""; 0], "{block}");
                count += 1;
            }
        }
    }
    assert!(count > 0, "the guide shows configurations");
}

#[test]
fn what_is_wrong_to_the_reader_is_wrong_to_the_schema() {
    for (right, wrong) in [
        ("baud = 19200", "baud = 19201"),
        ("echo = \"off\"", "ehco = \"off\""),
        ("[module.oven]", "[module.Oven]"),
        ("address = 3", "address = 256"),
        ("max_age = \"1.5s\"", "max_age = \"1.5\""),
        ("identify = false", "identify = \"no\""),
        ("locked = true", "locked = \"yes\""),
        ("confirm = \"hold\"", "confirm = \"ask\""),
        ("interlock = [\"oven.k1\"]", "interlock = \"oven.k1\""),
        ("{ wait = \"500ms\" }", "{ wait = \"500ms\", to = true }"),
        ("above = 4.2", "is = true, above = 4.2"),
        ("\"06:30\"", "\"6:30\""),
        ("\"fri\"", "\"freitag\""),
        (
            "{ module_offline",
            "{ line_offline = \"main\", module_offline",
        ),
        ("{ notify = \"The tank is full\" }", "{ notify = \"\" }"),
        ("width = \"2s\" }", "width = \"2s\", to = true }"),
        ("high = 4.5, unit = \"m\", ", "high = 4.5, "),
        ("keep = \"90d\"", "keep = 90"),
        ("speed = 1.5", "speed = 0"),
        ("https://hooks", "ftp://hooks"),
        ("https://hooks", "https://me:secret@hooks"),
        ("enabled = false", "enabled = \"no\""),
    ] {
        assert!(ALL.contains(right), "{right}");
        let text = ALL.replace(right, wrong);
        assert!(Config::parse(&text).is_err(), "{wrong}");
        assert!(!objections(&text).is_empty(), "{wrong}");
    }
}
