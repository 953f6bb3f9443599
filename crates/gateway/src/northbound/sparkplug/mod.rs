//! Sparkplug B 3.0: the site as an edge node, its modules as devices, in MQTT 5 and 3.1.1.
//!
//! - Its settings: `settings`. Its topics: `topics`. Its payloads: `payload`.
//! - A module as a device: `device`. What changed while nobody was told: `backlog`. Whether the
//!   primary host is there: `host`. The numbers of births: `kept`.
//! - What is published and when, and which commands are carried out, without I/O: `node`.
//! - What drives it all: `driver`. How the broker is reached: [`super::broker`].

mod backlog;
mod device;
mod driver;
mod host;
mod kept;
mod node;
mod payload;
#[cfg(test)]
mod requirements;
mod settings;
mod topics;

use super::broker::fields;
use super::kind::{Field, OutletKind, Pair, Shape, WRITE};

/// Sparkplug, as an edge node.
pub(super) static KIND: OutletKind = OutletKind {
    notes: NOTES,
    check: settings::check,
    ..OutletKind::new(
        "sparkplug",
        WORDS,
        FIELDS,
        |outlet, _| Box::pin(driver::run(outlet)),
        |outlet| Box::pin(driver::test(outlet)),
    )
};

const WORDS: (Pair, Pair) = (
    ["Sparkplug B", "Sparkplug B"],
    [
        "The site as an edge node, every module as a device: births, data with quality, deaths, \
         and commands that are answered with their true end.",
        "把站点作为边缘节点，每个模块作为设备：发布上线、带质量的数据和下线消息；每条命令都会回报真实的执行结果。",
    ],
);

const NOTES: &[Pair] = &[
    [
        "Each module is a device under the edge node, each point a metric. A module that does not \
         answer is dead (DDEATH) until it is heard again. Quality is 500 for a value that is too \
         old, and 0 where there is none.",
        "每个模块是边缘节点下的一个设备，每个点位是一个指标。模块无应答时发布 DDEATH，恢复应答后重新上线。\
         Quality 为 500 表示值已过期，0 表示无值。",
    ],
    [
        "A DCMD to an output is answered with a DDATA: the metric as it is afterwards, and Last \
         Command/End, which is readback, reply, sent, unknown or failed. The clock of the host may \
         differ from that of this machine by 5 s at most.",
        "对输出的 DCMD 以 DDATA 应答：包含执行后的实际状态和 Last Command/End（readback、reply、sent、unknown \
         或 failed）。主机与本机的时钟相差不得超过 5 秒。",
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
    Field::new("group", ["Group ID", "组 ID"], Shape::Text(64))
        .with_hint(["railbus if left empty", "留空为 railbus"]),
    Field::new("node", ["Edge node ID", "边缘节点 ID"], Shape::Text(64)).with_hint([
        "The name of the site if left empty. Every edge node of a group has its own",
        "留空则使用站点名称。同一组内的边缘节点 ID 不可重复",
    ]),
    Field::new(
        "primary_host",
        ["Primary host", "主要主机应用（Primary Host）"],
        Shape::Text(64),
    )
    .with_hint([
        "Its host ID: nothing is told while it is away. None if left empty",
        "填写其主机 ID；该主机离线期间不发布数据。留空则不等待",
    ]),
    WRITE,
    Field::new(
        "replay_days",
        [
            "Keep changes while nobody is told (days)",
            "断线续传：变化保留天数",
        ],
        Shape::Number(0, 90, 0),
    )
    .with_hint([
        "While the broker or the primary host is away, changes stay on the disk and come \
         afterwards as historical metrics. 0 for the newest values only",
        "代理或主要主机离线期间，变化先存盘，恢复后以历史指标补发。0 表示只发布最新值",
    ]),
    Field::new("modules", ["Modules", "模块"], Shape::Modules),
];
