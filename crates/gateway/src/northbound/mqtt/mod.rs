//! MQTT: values, their quality and what happens are published at a broker, and commands come from
//! there, in MQTT 5 and 3.1.1.
//!
//! - Its settings: `settings`. Its topics: `topics`. What a payload orders: `orders`.
//! - Every change in its order, also those of an outage: `replay`.
//! - What the broker keeps of the site: `told`; the file with its topics: `kept`. What Home
//!   Assistant is told of the modules: `discovery`.
//! - What is published and when, and which commands are carried out, without I/O: `node`. How a
//!   command ended: `ends`. In which order they begin: `turns`.
//! - What it offers, by its settings alone: `offered`.
//! - What drives it all: `driver`. How the broker is reached: [`super::broker`].

mod discovery;
mod driver;
mod ends;
mod kept;
mod node;
mod offered;
mod orders;
mod replay;
mod settings;
mod told;
mod topics;
mod turns;

use super::broker::fields;
use super::kind::{EVENTS, Field, OutletKind, Pair, Shape, WRITE};
use super::offered::OfferWay;

/// MQTT, as a client.
pub(super) static KIND: OutletKind = OutletKind {
    notes: NOTES,
    check: settings::check,
    offer: |name, settings, site, config| {
        let offer = offered::offer(name, settings, site, config);
        Some(OfferWay::Mqtt(offer))
    },
    ..OutletKind::new(
        "mqtt",
        WORDS,
        FIELDS,
        |outlet, events| Box::pin(driver::run(outlet, events)),
        |outlet| Box::pin(driver::test(outlet)),
    )
};

const WORDS: (Pair, Pair) = (
    ["MQTT", "MQTT"],
    [
        "Publishes every value with its quality at an MQTT broker, and takes commands from there. \
         Each command is answered with its true end.",
        "向 MQTT 代理发布每个点位的值及其质量，并从代理接收命令；每条命令都会回报真实的执行结果。",
    ],
);

const NOTES: &[Pair] = &[
    [
        "Topics begin with railbus/SITE/. MODULE/LABEL/state is ON, OFF, a number, or None while \
         the value is not known; MODULE/LABEL/attr has the quality; MODULE/availability is online \
         or offline. bridge/state is offline as soon as railbus is gone.",
        "主题以 railbus/站点/ 开头。模块/点位/state 为 ON、OFF、数值，值未知时为 None；模块/点位/attr 为质量；\
         模块/availability 为 online 或 offline。railbus 离线时 bridge/state 变为 offline。",
    ],
    [
        "Commands go to MODULE/LABEL/set: ON, OFF, TOGGLE, PULSE or PULSE 500, not retained. The \
         end is published at MODULE/LABEL/result. Whoever may publish these topics at the broker \
         can switch the outputs named here.",
        "命令发布到 模块/点位/set：ON、OFF、TOGGLE、PULSE 或 PULSE 500，不可设置保留标志。执行结果发布在 \
         模块/点位/result。凡可在代理上发布这些主题者，均可操作此处列出的输出。",
    ],
];

const FIELDS: &[Field] = &[
    fields::HOST,
    fields::PORT,
    fields::TLS,
    fields::CA,
    fields::CERT,
    fields::KEY,
    fields::USERNAME,
    fields::PASSWORD,
    fields::CLIENT_ID,
    fields::VERSION,
    Field::new("base", ["Topics begin with", "主题前缀"], Shape::Text(128))
        .with_hint(["railbus if left empty", "留空为 railbus"]),
    Field::new(
        "site",
        ["Name of the site in topics", "主题中的站点名"],
        Shape::Text(64),
    )
    .with_hint(["The name of the site if left empty", "留空则使用站点名称"]),
    WRITE,
    Field::new(
        "replay_days",
        [
            "Keep changes while the broker is away (days)",
            "断线续传：变化保留天数",
        ],
        Shape::Number(0, 90, 0),
    )
    .with_hint([
        "Every change stays on the disk until the broker has it, and comes in its order at batch. \
         0 for the newest values only",
        "每次变化先存盘，代理确认后才删除，并按顺序发布到 batch 主题。0 表示只发布最新值",
    ]),
    Field::new("modules", ["Modules", "模块"], Shape::Modules),
    Field::new(
        "discovery",
        ["Home Assistant discovery", "Home Assistant 自动发现"],
        Shape::Choice(DISCOVERY),
    )
    .with_hint([
        "Home Assistant then shows every module as a device. Outputs named above become switches",
        "启用后，Home Assistant 会把每个模块显示为一个设备；上面允许操作的输出显示为开关",
    ]),
    Field::new(
        "discovery_prefix",
        ["Topics of discovery begin with", "自动发现的主题前缀"],
        Shape::Text(128),
    )
    .with_hint(["homeassistant if left empty", "留空为 homeassistant"]),
    Field::new(
        "discovery_names",
        ["Names in Home Assistant", "Home Assistant 中的名称"],
        Shape::Choice(NAMES),
    )
    .with_hint([
        "Where a module or point has a name in both languages",
        "适用于同时有中英文名称的模块和点位",
    ]),
    Field::new(
        "events",
        ["Event types (none = all)", "事件类型；不选表示全部"],
        Shape::Choices(EVENTS),
    ),
];

const DISCOVERY: &[(&str, Pair)] = &[
    ("off", ["Off", "关闭"]),
    (
        "device",
        ["One message for each module", "每个模块一条消息"],
    ),
    (
        "component",
        [
            "One for each entity: before 2024.11, openHAB",
            "每个实体一条消息：2024.11 之前的版本、openHAB",
        ],
    ),
];

const NAMES: &[(&str, Pair)] = &[("en", ["English", "英文"]), ("zh", ["Chinese", "中文"])];
