//! A fleet: the site is one of many behind a centre, over NATS. Every change goes there in its
//! order, also those of an outage.
//!
//! - Its settings: `settings`. How servers are reached: `connection`. What drives it: `driver`.
//!   What the centre asks: `asked`. How it gets its key: `join`, `files`. The configuration that
//!   it wants here: `managed`, `trial_files`.
//! - What is said and when is decided by [`railbus_fleet::uplink`], which has no I/O.

mod asked;
mod connection;
mod driver;
mod files;
mod join;
mod managed;
mod settings;
mod trial_files;

use super::kind::{Field, OutletKind, Pair, Shape, WRITE};

/// The way to the centre of a fleet.
pub(super) static KIND: OutletKind = OutletKind {
    notes: NOTES,
    check: settings::check,
    join: Some(|invited| Box::pin(join::join(invited))),
    recover: trial_files::recover_all,
    ..OutletKind::new(
        "fleet",
        WORDS,
        FIELDS,
        |outlet, _| Box::pin(driver::run(outlet)),
        |outlet| Box::pin(driver::test(outlet)),
    )
};

const WORDS: (Pair, Pair) = (
    ["Fleet", "站群"],
    [
        "Reports to the centre of a fleet of sites, over NATS servers. Every change is kept on the \
         disk for some days.",
        "通过 NATS 服务器向站群中心上报。每次变化先存盘，并保留数日。",
    ],
);

const NOTES: &[Pair] = &[
    [
        "The centre can read what a viewer of this site can, and switch the outputs that are named \
         here. It can change nothing else, unless its key is here.",
        "中心可以读取本站查看者能看到的内容，并操作此处列出的输出；除非在此填写了它的密钥，否则不能修改其他内容。",
    ],
    [
        "The name of the site is in its credentials, and the servers let it say nothing for \
         another site. It connects to them; nothing connects to this machine.",
        "站点名称写在凭据中，服务器不允许它以其他站点的名义发送任何内容。连接由本机发起，无需开放端口。",
    ],
    [
        "Of two machines with the same credentials only one has a session with the centre.",
        "两台机器使用同一凭据时，只有一台与中心建立会话。",
    ],
];

/// The longest path of a file.
const PATH_MAX: usize = 1_024;
/// The longest key, in bytes.
const KEY_MAX: usize = 64;

const FIELDS: &[Field] = &[
    Field::new("servers", ["Servers", "服务器"], Shape::Texts)
        .with_hint([
            "HOST or HOST:PORT each, as railbus fleet init had them",
            "每项为 主机 或 主机:端口，与 railbus fleet init 时一致",
        ])
        .required(),
    Field::new(
        "credentials",
        ["Credentials", "凭据"],
        Shape::Text(PATH_MAX),
    )
    .with_hint([
        "File on this machine, made by railbus fleet creds, or here by railbus fleet join",
        "本机上的文件，由 railbus fleet creds 生成，或由 railbus fleet join 在本机生成",
    ])
    .required(),
    Field::new(
        "ca",
        ["Authority of the servers", "服务器的 CA 证书"],
        Shape::Text(PATH_MAX),
    )
    .with_hint([
        "File ca.pem of the fleet on this machine; the authorities of this machine if left empty",
        "本机上该站群的 ca.pem 文件；留空则使用本机信任的 CA",
    ]),
    WRITE,
    Field::new(
        settings::CONFIG_KEY,
        ["Key for configurations", "配置签名密钥"],
        Shape::Text(KEY_MAX),
    )
    .with_hint([
        "As railbus fleet config-key DIR shows it at the centre, which then may say the lines, \
         modules, groups, scenes and rules of this site: also which module is what write names. \
         None if left empty",
        "填写中心 railbus fleet config-key 文件夹 显示的密钥后，中心可下发本站的总线、模块、分组、场景和规则，\
         包括 write 所列名称对应哪个模块；留空则不接受",
    ]),
    Field::new(
        "replay_days",
        ["Keep changes (days)", "变化保留天数"],
        Shape::Number(1, 90, 7),
    )
    .with_hint([
        "Until the servers have them, and afterwards in case they lose them",
        "送达之前保留；送达之后仍保留，以防服务器丢失",
    ]),
];
