//! A Modbus gateway to one line: masters that railbus does not know, such as a maker's tool, ask
//! the modules of a line themselves, while railbus goes on polling it.
//!
//! A read is sent to the line as it is, between two exchanges of the line's own. A write of outputs
//! is a command of the site, with all its rules, and is answered with its true end; all other
//! writes are refused.
//!
//! - What a request may do: `verdict`.
//! - Whose request is next, without I/O: `passage`. How long a unit is waited for, and when one
//!   that did not answer is asked again: `health`.
//! - Who may connect, and how many: `clients`. Bytes of a connection, and its limits: `socket`.
//!   Both know nothing of what is served.
//! - The line, the site and the clients: `server`.

mod health;
mod passage;
#[cfg(test)]
mod served;
mod server;
mod settings;
mod socket;
#[cfg(test)]
mod tests;
mod verdict;

use super::kind::{Field, OutletKind, Pair, Shape};
use super::modbus::fields;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

/// A Modbus gateway to one line.
pub(super) static KIND: OutletKind = OutletKind {
    notes: NOTES,
    has_clients: true,
    check: |_, settings, _| settings::check(settings),
    ..OutletKind::new(
        "modbus_line",
        WORDS,
        FIELDS,
        |outlet, _| Box::pin(server::run(outlet)),
        |outlet| Box::pin(server::test(outlet)),
    )
};

const WORDS: (Pair, Pair) = (
    ["Modbus gateway to a line", "Modbus 透传网关"],
    [
        "A maker's tool or a SCADA system reads all registers of the modules on one line over \
         Modbus TCP, while railbus goes on polling them.",
        "厂家软件或 SCADA 通过 Modbus TCP 读取一条总线上各模块的全部寄存器，railbus 的轮询照常进行。",
    ],
);

const NOTES: &[Pair] = &[
    [
        "Connect by Modbus TCP; the unit number is the address of the module on the line. Modules \
         that are not in the configuration can be read, too. Only Modbus RTU is passed on.",
        "用 Modbus TCP 连接，单元号即模块在总线上的地址。未写入配置的模块也可读取。只转发 Modbus RTU。",
    ],
    [
        "Reads are passed on as they are. A coil that is an output of a module is switched as a \
         command, if it is named above. Exception 01: railbus does not let this request through. \
         0B: the module does not answer; to a write it means that it may have acted. 0A: the line \
         is not available.",
        "读请求原样转发。写线圈时，如果该线圈是模块的输出且已列入允许操作的输出，则作为命令执行。异常码 01：railbus \
         不放行该请求；0B：模块无应答，对写操作表示可能已动作；0A：总线不可用。",
    ],
    [
        "Settings of modules can't be changed this way: use the page of the module.",
        "不能通过这里更改模块的设置，请在模块页面上更改。",
    ],
];

/// Where it listens if nothing else is said.
const LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 1_503);

const FIELDS: &[Field] = &[
    Field::new("line", ["Line", "总线"], Shape::Line).required(),
    Field::new("listen", ["Listen at", "监听地址"], Shape::Text(64)).with_hint([
        "Address and port; 127.0.0.1:1503 if left empty. 0.0.0.0:1503 for other machines; ports \
         below 1024 need a permission",
        "地址和端口；留空为 127.0.0.1:1503。供其他机器访问时填 0.0.0.0:1503；1024 以下的端口需要权限",
    ]),
    fields::ALLOW,
    fields::WRITE,
];
