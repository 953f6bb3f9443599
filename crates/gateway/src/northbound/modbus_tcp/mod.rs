//! Modbus TCP: every module is a unit that any master can read and switch, whatever it speaks on
//! its line.
//!
//! Reads are answered from what is known, and only while that is good. Writes are commands of the
//! site, and are answered with their true end.
//!
//! - What it shares with other kinds that serve Modbus, as units and their answers: `modbus`.
//! - Its settings: `settings`; what they offer other programs: `offered`.
//! - One connection, without I/O: `conn`. Sockets and limits: `server`; with or without TLS:
//!   `stream`.
//! - Over TLS, who a client is and what it may switch: `security` and `roles`.

mod conn;
mod offered;
mod roles;
#[cfg(test)]
mod secured;
mod security;
#[cfg(test)]
mod served;
mod server;
mod settings;
mod stream;
#[cfg(test)]
mod tests;

use super::kind::{DemoOutlet, Field, OutletKind, Pair, Shape};
use super::modbus::{fields, table};
use super::network;
use super::outlet::Outlet;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

/// Modbus TCP, as a server.
pub(super) static KIND: OutletKind = OutletKind {
    notes: NOTES,
    map: Some(table::MAP),
    offer: |_, settings, _, config| offered::offer(settings, config),
    demo: Some(DemoOutlet {
        name: "modbus",
        listen: LISTEN,
        about: [
            "read only, each module is a unit",
            "只读，每个模块为一个单元",
        ],
    }),
    has_clients: true,
    check: |_, settings, config| settings::check(settings, config),
    ..OutletKind::new(
        "modbus_tcp",
        WORDS,
        FIELDS,
        |outlet, _| Box::pin(server::run(outlet)),
        |outlet| Box::pin(server::test(outlet)),
    )
};

const WORDS: (Pair, Pair) = (
    ["Modbus TCP server", "Modbus TCP 服务器"],
    [
        "SCADA systems and PLCs read and switch every module as a Modbus unit, whatever protocol \
         the module speaks.",
        "SCADA 和 PLC 可将每个模块作为一个 Modbus 单元读取和操作，与模块自身的协议无关。",
    ],
);

const NOTES: &[Pair] = &[
    [
        "The unit number is the module's address. Modules that speak Modbus RTU keep the coils and \
         registers of their datasheets; others have outputs as coils from 0, inputs as discrete \
         inputs from 0, and analog values as input registers from 0. Addresses count from 0.",
        "单元号即模块地址。使用 Modbus RTU 的模块保持说明书中的线圈和寄存器；其他模块的输出为从 0 开始的线圈，\
         输入为从 0 开始的离散输入，模拟量为从 0 开始的输入寄存器。地址从 0 开始。",
    ],
    [
        "A value that is not known is never sent: exception 0B says that the module does not \
         answer or its value is too old, 0A that there is no such unit or its line is not \
         available. A write is answered when it has ended. To a write, 0B means that it may have \
         acted: read before you repeat it.",
        "未知的值绝不发送：异常码 0B 表示模块无应答或数值已过期，0A 表示没有该单元或总线不可用。写操作结束后才应答；\
         对写操作，异常码 0B 表示可能已动作：先读取，再决定是否重试。",
    ],
];

/// Where it listens if nothing else is said.
const LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 1_502);

const FIELDS: &[Field] = &[
    Field::new("listen", ["Listen at", "监听地址"], Shape::Text(64)).with_hint([
        "Address and port; 127.0.0.1:1502 if left empty. 0.0.0.0:1502 for other machines; ports \
         below 1024 need a permission",
        "地址和端口；留空为 127.0.0.1:1502。供其他机器访问时填 0.0.0.0:1502；1024 以下的端口需要权限",
    ]),
    Field::new("allow", ["Allowed clients", "允许连接的机器"], Shape::Texts).with_hint([
        "Addresses or networks such as 192.168.1.0/24, separated by commas. Required if other \
         machines are to connect without TLS: Modbus TCP has no password",
        "地址或网络（如 192.168.1.0/24），用逗号分隔。供其他机器访问且未用 TLS 时必填：Modbus TCP 没有密码",
    ]),
    Field::new("write", ["Outputs that may be switched", "允许操作的输出"], Shape::Points).with_hint([
        "Outputs such as oven.k1, oven or *; read only if left empty. With TLS, roles say it",
        "输出，如 oven.k1、oven 或 *；留空则只读。使用 TLS 时由角色决定",
    ]),
    Field::new("tls_cert", ["TLS certificate", "TLS 证书"], Shape::Text(256)).with_hint([
        "File with the certificate of this gateway and its chain, in PEM. With it, and the two \
         files below, it speaks only TLS, usually on port 802. Files are read when it starts",
        "本网关的证书及证书链文件（PEM）。与下面两个文件一起设置后只使用 TLS，常用端口为 802。文件在启动时读取",
    ]),
    Field::new("tls_key", ["TLS key", "TLS 私钥"], Shape::Text(256)).with_hint([
        "File with the private key of the certificate, in PEM",
        "证书的私钥文件（PEM）",
    ]),
    Field::new("client_ca", ["Authority of clients", "客户端证书的签发机构"], Shape::Text(256))
        .with_hint([
            "File with the certificates of the authorities that issue the clients' certificates; \
             others can't connect",
            "签发客户端证书的 CA 证书文件；没有此类证书的客户端无法连接",
        ]),
    Field::new("roles", ["Roles", "角色"], Shape::Texts).with_hint([
        "What the role in a client's certificate may switch: operator=pump.*, operator=oven.k1. \
         All others only read",
        "客户端证书中的角色可操作的输出：operator=pump.*, operator=oven.k1。其他客户端只读",
    ]),
    fields::MODULES,
    fields::UNITS,
    fields::MAP,
    fields::WITHIN
    .with_hint([
        "The client should wait at least 2 s longer for its answer",
        "客户端等待应答的时间应至少再长 2 秒",
    ]),
];

impl Outlet {
    /// Where it listens.
    fn listen(&self) -> SocketAddr {
        let listen = network::listen(&self.settings.borrow(), LISTEN);
        // Nothing else passes the check of a configuration.
        listen.unwrap_or(LISTEN)
    }
}
