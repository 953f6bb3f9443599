//! Node-RED: a flow of its own nodes, with an output for every point.
//!
//! A module is a `function` node that says each change of its points at the output of that point,
//! and `null` while a value is not known. Over MQTT it has the topics of the module, over HTTP it
//! asks for all points again and again. Outputs that may be switched have a button each way.

use super::File;
use super::asked::{Asked, CERTIFICATE, id};
use super::quote::quoted;
use super::texts::ExportText;
use railbus_app::failure::Failure;
use railbus_gateway::offered::{MqttOffer, OfferWay, can_be_wired, shown};
use railbus_site::config::ModuleConfig;
use serde_json::{Value, json};

/// How often values are asked for over HTTP, in seconds.
const EVERY_S: u64 = 2;
/// How long an answer is waited for, in milliseconds; without a limit Node-RED waits for two
/// minutes. That of a reading not until the next one begins: it would be taken for a newer one. A
/// command is sent within 5 s or not at all, and its answer says what became of it.
const READ_MAX_MS: u64 = 1_900;
const SET_MAX_MS: u64 = 15_000;
/// How often the flow checks that health messages still come over MQTT, in seconds.
const CHECK_S: u64 = 2;
/// After this many of their periods without one, railbus counts as gone.
const PERIODS_MAX: u64 = 3;
/// Where the token is: a variable of the flow.
const TOKEN: &str = "RAILBUS_TOKEN";

/// The columns of the flow, and the height of a row.
const COLUMNS: [i64; 4] = [140, 380, 620, 860];
const ROW: i64 = 50;

/// A flow that is being laid out.
struct Flow {
    site: String,
    tab: String,
    nodes: Vec<Value>,
    /// Where the next row is.
    y: i64,
}

impl Flow {
    fn new(site: &str, tab: &Value) -> Flow {
        let mut flow = Flow {
            site: site.to_owned(),
            tab: id(site, "tab"),
            nodes: Vec::new(),
            y: ROW,
        };
        let mut tab = tab.clone();
        tab["id"] = flow.tab.clone().into();
        flow.nodes.push(tab);
        flow
    }

    /// The id of a node, by what it is.
    fn id(&self, what: &str) -> String {
        id(&self.site, what)
    }

    /// Adds a node to the row; its wires are the nodes at each of its outputs.
    fn add(&mut self, what: &str, column: usize, node: Value, wires: &[Vec<String>]) -> String {
        let (id, mut node) = (self.id(what), node);
        node["id"] = id.clone().into();
        node["z"] = self.tab.clone().into();
        node["x"] = COLUMNS[column].into();
        node["y"] = self.y.into();
        node["wires"] = wires.into();
        self.nodes.push(node);
        id
    }

    /// Adds what is no part of the drawing.
    fn configure(&mut self, what: &str, mut node: Value) -> String {
        let id = self.id(what);
        node["id"] = id.clone().into();
        self.nodes.push(node);
        id
    }

    fn rows(&mut self, count: usize) {
        self.y += ROW * i64::try_from(count).unwrap_or(1);
    }
}

/// Half of the height of a node with an output for each of these: it stands in the middle.
fn half(points: &[Wired<'_>]) -> i64 {
    7 * i64::try_from(points.len()).unwrap_or_default()
}

/// A point in the flow.
struct Wired<'a> {
    label: String,
    called: Option<&'a str>,
    /// Where it is switched.
    set: Option<String>,
}

/// A file to import.
pub(super) fn file(asked: &Asked<'_>) -> Result<File, Failure> {
    let fits = |way: &OfferWay| matches!(way, OfferWay::Mqtt(_)).then_some(0);
    let offer = match asked.is_http {
        true => None,
        false => asked.offer(fits)?,
    };
    let (flow, notes) = match offer.map(|offer| &offer.way) {
        Some(OfferWay::Mqtt(mqtt)) => over_mqtt(asked, mqtt),
        _ => over_http(asked),
    };
    // Objects of texts and numbers are always valid JSON.
    let text = serde_json::to_string_pretty(&flow.nodes).unwrap_or_default();
    Ok(File {
        text: text + "\n",
        notes,
    })
}

fn over_mqtt(asked: &Asked<'_>, offer: &MqttOffer) -> (Flow, Vec<String>) {
    let lang = asked.lang;
    let mut flow = Flow::new(
        &asked.site,
        &json!({
            "type": "tab",
            "label": format!("railbus {}", asked.site),
            "disabled": false,
            "info": lang.get(ExportText::NodeRedMqtt),
        }),
    );
    let tls = offer.is_tls.then(|| tls(&mut flow, ""));
    let host = asked.reached(&offer.host);
    let mut broker = json!({
        "type": "mqtt-broker", "name": format!("{host}:{}", offer.port),
        "broker": host, "port": offer.port.to_string(), "clientid": "", "autoConnect": true,
        "usetls": offer.is_tls, "protocolVersion": "4", "keepalive": "10", "cleansession": true,
    });
    if let Some(tls) = tls {
        broker["tls"] = tls.into();
    }
    let broker = flow.configure("broker", broker);
    let of_module = |module: &str| id(&asked.site, &format!("{module}.values"));
    let modules: Vec<String> = offer
        .modules
        .iter()
        .map(|one| of_module(&one.module))
        .collect();
    let listen = |topic: &str| {
        json!({
            "type": "mqtt in", "name": topic, "topic": topic, "qos": "1", "datatype": "utf8",
            "broker": broker, "nl": false, "rap": true, "rh": 0, "inputs": 0,
        })
    };
    let all = std::slice::from_ref(&modules);
    let bridge = flow.add("bridge", 0, listen(&offer.bridge), all);
    flow.rows(1);
    // A broker that is gone can't say so.
    let status = json!({ "type": "status", "name": "", "scope": [bridge] });
    flow.add("status", 0, status, all);
    flow.rows(1);
    // Nor does railbus, if the broker had gone first: its retained `online` stays.
    flow.add("health", 0, listen(&offer.health), all);
    flow.rows(1);
    let clock = json!({
        "type": "inject", "name": "", "props": [], "repeat": CHECK_S.to_string(), "crontab": "",
        "once": false, "topic": "",
    });
    flow.add("clock", 0, clock, all);
    flow.rows(2);
    for one in &offer.modules {
        let Some(module) = asked.config.modules.get(&one.module) else {
            continue;
        };
        let points: Vec<Wired<'_>> = one
            .points
            .iter()
            .map(|point| Wired {
                called: asked.point_name(module, point.point),
                label: point.label.clone(),
                set: point.set.clone(),
            })
            .collect();
        let code = constant("bridge", &offer.bridge)
            + &constant("health", &offer.health)
            + &format!(
                "const aliveMs = {};\n",
                PERIODS_MAX * 1_000 * offer.health_every_s
            )
            + &constant("availability", &one.availability)
            + &constant("states", &one.states)
            + MQTT_VALUES;
        let values = of_module(&one.module);
        flow.y += half(&points);
        flow.add(
            &format!("{}.states", one.module),
            0,
            listen(&one.states),
            &[vec![values.clone()]],
        );
        values_of(asked, &mut flow, (&one.module, module), (&points, &code));
        flow.rows(1);
        let there = listen(&one.availability);
        flow.add(
            &format!("{}.availability", one.module),
            0,
            there,
            &[vec![values]],
        );
        flow.rows(1);
        flow.y += half(&points);
        for point in &points {
            let Some(topic) = &point.set else {
                continue;
            };
            let path = format!("{}.{}", one.module, point.label);
            let to = flow.id(&format!("{path}.set"));
            for word in ["ON", "OFF"] {
                let node = json!({
                    "type": "inject", "name": format!("{} {word}", point.label),
                    "props": [{ "p": "payload" }], "payload": word, "payloadType": "str",
                    "topic": "", "repeat": "", "crontab": "", "once": false,
                });
                flow.add(&format!("{path}.{word}"), 1, node, &[vec![to.clone()]]);
                flow.rows(1);
            }
            flow.y -= 2 * ROW;
            let node = json!({
                "type": "mqtt out", "name": topic, "topic": topic, "qos": "1", "retain": "false",
                "broker": broker,
            });
            flow.add(&format!("{path}.set"), 2, node, &[]);
            flow.rows(2);
        }
        flow.rows(1);
    }
    (flow, vec![lang.get(ExportText::NodeRedUser).to_owned()])
}

fn over_http(asked: &Asked<'_>) -> (Flow, Vec<String>) {
    let lang = asked.lang;
    let mut flow = Flow::new(
        &asked.site,
        &json!({
            "type": "tab",
            "label": format!("railbus {}", asked.site),
            "disabled": false,
            "info": lang.get(ExportText::NodeRedHttp),
            "env": [{ "name": TOKEN, "value": "", "type": "cred" }],
        }),
    );
    let api = format!("{}/api/v1/points", asked.url.origin);
    let tls = asked.url.is_tls.then(|| tls(&mut flow, CERTIFICATE));
    let request = |method: &str, url: &str| {
        let mut node = json!({
            "type": "http request", "name": "", "method": method, "url": url, "ret": "obj",
            "paytoqs": "ignore", "persist": false, "authType": "", "senderr": false, "headers": [],
        });
        if let Some(tls) = &tls {
            node["tls"] = tls.clone().into();
        }
        node
    };
    let with_token = |most_ms: u64| {
        let code = format!("msg.requestTimeout = {most_ms};\n{HTTP_TOKEN}");
        json!({
            "type": "function", "name": TOKEN, "func": code, "outputs": 1, "timeout": 0,
            "noerr": 0, "initialize": "", "finalize": "", "libs": [],
        })
    };
    let every = json!({
        "type": "inject", "name": "", "props": [], "repeat": EVERY_S.to_string(), "crontab": "",
        "once": true, "onceDelay": 0.1, "topic": "",
    });
    let modules = asked.config.modules.keys();
    let values = modules
        .map(|name| flow.id(&format!("{name}.values")))
        .collect();
    let (token, get) = (flow.id("read.token"), flow.id("read"));
    flow.add("every", 0, every, &[vec![token]]);
    flow.add("read.token", 1, with_token(READ_MAX_MS), &[vec![get]]);
    flow.add("read", 2, request("GET", &api), &[values]);
    flow.rows(2);
    let (token, put, result) = (flow.id("set.token"), flow.id("set"), flow.id("result"));
    flow.add("set.token", 1, with_token(SET_MAX_MS), &[vec![put]]);
    flow.add("set", 2, request("PUT", ""), &[vec![result]]);
    flow.add(
        "result",
        3,
        debug(lang.get(ExportText::NodeRedResult), "payload"),
        &[],
    );
    flow.rows(2);
    for (name, module) in &asked.config.modules {
        let points: Vec<Wired<'_>> = shown(module)
            .map(|(label, point)| Wired {
                called: asked.point_name(module, point),
                set: can_be_wired(module, point).then(|| format!("{api}/{name}/{label}")),
                label,
            })
            .collect();
        flow.y += half(&points);
        values_of(asked, &mut flow, (name, module), (&points, HTTP_VALUES));
        flow.rows(1);
        flow.y += half(&points);
        for point in &points {
            let Some(url) = &point.set else {
                continue;
            };
            for (word, on) in [("ON", true), ("OFF", false)] {
                let body = json!({ "value": on }).to_string();
                let node = json!({
                    "type": "inject", "name": format!("{} {word}", point.label),
                    "props": [{ "p": "payload" }, { "p": "url", "v": url, "vt": "str" }],
                    "payload": body, "payloadType": "json", "topic": "", "repeat": "",
                    "crontab": "", "once": false,
                });
                let what = format!("{name}.{}.{word}", point.label);
                flow.add(&what, 0, node, &[vec![token.clone()]]);
                flow.rows(1);
            }
        }
        flow.rows(1);
    }
    let notes = std::iter::once(asked.token("nodered", "operator", "railbus.token"))
        .chain([lang.fill(ExportText::NodeRedToken, &[("name", &TOKEN)])])
        .chain(asked.certificate(CERTIFICATE))
        .collect();
    (flow, notes)
}

/// The node that says the values of a module, and what shows them.
fn values_of(
    asked: &Asked<'_>,
    flow: &mut Flow,
    (name, module): (&str, &ModuleConfig),
    (points, code): (&[Wired<'_>], &str),
) {
    let labels: Vec<&str> = points.iter().map(|point| &*point.label).collect();
    let labels = format!("const labels = {};\n", json!(labels));
    let code = constant("module", name) + &labels + code;
    let titles: Vec<String> = points
        .iter()
        .map(|point| match point.called {
            Some(called) => format!("{} {called}", point.label),
            None => point.label.clone(),
        })
        .collect();
    let shows = flow.id(&format!("{name}.shown"));
    let node = json!({
        "type": "function", "name": asked.module_name(name, module), "func": code,
        "outputs": points.len(), "outputLabels": titles, "timeout": 0, "noerr": 0,
        "initialize": "", "finalize": "", "libs": [],
    });
    let wires = vec![vec![shows]; points.len()];
    flow.add(&format!("{name}.values"), 2, node, &wires);
    flow.add(&format!("{name}.shown"), 3, debug(name, "payload"), &[]);
}

/// A text that the code of a node has.
fn constant(name: &str, text: &str) -> String {
    format!("const {name} = {};\n", quoted(text))
}

fn debug(name: &str, shown: &str) -> Value {
    json!({
        "type": "debug", "name": name, "active": true, "tosidebar": true, "console": false,
        "tostatus": false, "complete": shown, "targetType": "msg",
    })
}

/// Whom to trust; the authorities of the machine if nothing else is said.
fn tls(flow: &mut Flow, ca: &str) -> String {
    flow.configure("tls", json!({
        "type": "tls-config", "name": "railbus", "cert": "", "key": "", "ca": ca, "certname": "",
        "keyname": "", "caname": "", "servername": "", "verifyservercert": true,
    }))
}

/// Adds the token to a request.
const HTTP_TOKEN: &str = r#"msg.headers = { Authorization: "Bearer " + env.get("RAILBUS_TOKEN") };
return msg;
"#;

/// What changed, at the output of each point; `now` is its value.
macro_rules! changes {
    () => {
        r#"const told = context.get("told") || {};
const changes = labels.map((label) => {
    const value = now(label);
    if (label in told && told[label] === value) {
        return null;
    }
    told[label] = value;
    return { topic: module + "." + label, payload: value };
});
context.set("told", told);
return changes;
"#
    };
}

/// The values of a module as its topics say them.
const MQTT_VALUES: &str = concat!(
    r#"// An output for each point: true, false, a number, or null while the value is not known.
let seen = context.get("seen") || {};
if (msg.status) {
    // What was known before the connection was lost holds no longer.
    seen = msg.status.fill === "green" ? seen : {};
} else if (msg.topic === health) {
    seen[health] = Date.now();
} else if (msg.topic) {
    seen[msg.topic] = msg.payload;
}
context.set("seen", seen);
// A broker that had gone before railbus did still has "online" retained.
const isThere = seen[bridge] === "online" && seen[availability] === "online"
    && Math.abs(Date.now() - seen[health]) < aliveMs;
const words = { ON: true, OFF: false, None: null, "": null };
const now = (label) => {
    const text = isThere ? seen[states.replace("+", label)] : undefined;
    if (text === undefined || text in words) {
        return words[text] ?? null;
    }
    const number = Number(text);
    return Number.isFinite(number) ? number : null;
};
"#,
    changes!()
);

/// The values of a module as they stand in an answer.
const HTTP_VALUES: &str = concat!(
    r#"// An output for each point: true, false, a number, or null while the value is not known.
const points = (msg.statusCode === 200 && msg.payload.points) || [];
node.status(points.length ? {} : { fill: "red", shape: "ring", text: String(msg.statusCode) });
const now = (label) => {
    const point = points.find((one) => one.module === module && one.label === label);
    return point && point.quality === "good" ? point.value : null;
};
"#,
    changes!()
);
