//! OPC UA: lines, modules and points as the nodes of a server, with accounts and certificates.
//!
//! The server itself is a crate of its own, `railbus_opcua`: it brings many others.
//!
//! - Its settings: `settings`. Who clients are: `users`.
//! - Which connections it gets: `server`, and how their bytes go there: `relay`. What may be asked
//!   without encryption: `plain`.

mod plain;
mod relay;
mod server;
mod settings;
#[cfg(test)]
mod tests;
mod users;

use super::kind::{Field, OutletKind, Pair, Shape};
use super::modbus::fields::WITHIN;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

/// OPC UA, as a server.
pub(super) static KIND: OutletKind = OutletKind {
    notes: NOTES,
    has_clients: true,
    check: |_, settings, _| settings::check(settings),
    ..OutletKind::new(
        "opcua",
        WORDS,
        FIELDS,
        |outlet, _| Box::pin(server::run(outlet)),
        |outlet| Box::pin(server::test(outlet)),
    )
};

const WORDS: (Pair, Pair) = (
    ["OPC UA server", "OPC UA 服务器"],
    [
        "SCADA and MES read and switch every point as a node, with quality and time, and the true \
         end of each write.",
        "SCADA 和 MES 将每个点位作为节点读取和操作，附带质量与时间；每次写入都返回真实的执行结果。",
    ],
);

const NOTES: &[Pair] = &[
    [
        "Clients sign in with a user of railbus and its password, or with any name and a token as \
         the password. What they may switch is what that account may.",
        "客户端使用 railbus 的用户名和密码登录，或使用任意用户名并以令牌作为密码。可操作的点位由该账户的权限决定。",
    ],
    [
        "A client's certificate must be trusted first. Let it connect once: it is refused, and its \
         thumbprint is shown here. Compare it with the one the client shows, and add it to the \
         trusted certificates. Programs on this machine can also connect without security.",
        "客户端证书须先受信任。请让客户端连接一次：连接会被拒绝，其指纹显示在此处。与客户端显示的指纹核对后，将其加入受信任的证书。\
         本机程序也可使用无安全策略的连接。",
    ],
];

/// Where it listens if nothing else is said.
const LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 4_840);

const FIELDS: &[Field] = &[
    Field::new("listen", ["Listen at", "监听地址"], Shape::Text(64)).with_hint([
        "Address and port; 127.0.0.1:4840 if left empty. 0.0.0.0:4840 for other machines",
        "地址和端口；留空为 127.0.0.1:4840。供其他机器访问时填 0.0.0.0:4840",
    ]),
    Field::new("host", ["Host name", "主机名"], Shape::Text(253)).with_hint([
        "Name or address by which clients reach this machine; its own name if left empty",
        "客户端访问本机所用的名称或地址；留空则使用本机名称",
    ]),
    Field::new("allow", ["Allowed clients", "允许连接的机器"], Shape::Texts).with_hint([
        "Addresses or networks such as 192.168.1.0/24, separated by commas; all if left empty",
        "地址或网络（如 192.168.1.0/24），用逗号分隔；留空则不限制",
    ]),
    Field::new(
        "trusted",
        ["Trusted certificates", "受信任的证书"],
        Shape::Texts,
    )
    .with_hint([
        "Thumbprints (SHA-1) of clients' certificates, separated by commas",
        "客户端证书的指纹（SHA-1），用逗号分隔",
    ]),
    Field::new(
        "anonymous",
        ["Read without signing in", "允许匿名读取"],
        Shape::Flag,
    )
    .with_hint([
        "Clients that do not sign in may read everything, and switch nothing",
        "未登录的客户端可读取全部内容，但不能操作",
    ]),
    Field::new(
        "language",
        ["Language of names", "名称的语言"],
        Shape::Choice(LANGUAGES),
    ),
    Field::new("modules", ["Modules", "模块"], Shape::Modules),
    WITHIN,
];

const LANGUAGES: &[(&str, Pair)] = &[
    ("en", ["English", "英文"]),
    ("zh", ["Simplified Chinese", "简体中文"]),
];
