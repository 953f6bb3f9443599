//! Modbus RTU on a serial port: a PLC that is an RTU master reads and switches every module as a
//! unit, whatever it speaks on its own line.
//!
//! Reads are answered from what is known, and only while that is good. Writes are commands of the
//! site. An RTU master waits for one answer at a time, so a write that takes longer is acknowledged
//! and goes on; the registers about its unit say how it ended.
//!
//! - What it shares with other kinds that serve Modbus, as units and their answers: `modbus`.
//! - Its settings: `settings`.
//! - Which of the bytes on the line are frames: `framing`; which of them are our own: `echo`.
//! - The slave, without I/O: `slave`. The port, and when it is opened again: `server`.

mod echo;
mod framing;
#[cfg(test)]
mod served;
mod server;
mod settings;
mod slave;
#[cfg(test)]
mod tests;

use super::kind::{Field, OutletKind, Pair, Shape};
use super::modbus::{fields, table};

/// Modbus RTU, as a slave.
pub(super) static KIND: OutletKind = OutletKind {
    notes: NOTES,
    map: Some(table::MAP),
    check: |_, settings, config| settings::check(settings, config),
    may_lead: settings::may_lead,
    ..OutletKind::new(
        "modbus_rtu",
        WORDS,
        FIELDS,
        |outlet, _| Box::pin(server::run(outlet)),
        |outlet| Box::pin(server::test(outlet)),
    )
};

const WORDS: (Pair, Pair) = (
    ["Modbus RTU slave", "Modbus RTU 从站"],
    [
        "A PLC reads and switches every module over a serial port, as a Modbus RTU master does, \
         whatever protocol the module speaks.",
        "PLC 作为 Modbus RTU 主站，通过串口读取和操作每个模块，与模块自身的协议无关。",
    ],
);

const NOTES: &[Pair] = &[
    [
        "The port needs wires of its own: the PLC is the master there, and railbus is the master \
         of its lines. The unit number is the module's address. Modules that speak Modbus RTU keep \
         the coils and registers of their datasheets; others have outputs as coils from 0, inputs \
         as discrete inputs from 0, and analog values as input registers from 0.",
        "该端口须单独接线：此处 PLC 为主站，而 railbus 是自己总线的主站。单元号即模块地址。使用 Modbus RTU 的模块\
         保持说明书中的线圈和寄存器；其他模块的输出为从 0 开始的线圈，输入为从 0 开始的离散输入，模拟量为从 0 开始的\
         输入寄存器。",
    ],
    [
        "A value that is not known is never sent: exception 0B says that the module does not \
         answer or its value is too old. Addresses without a module get no answer, and broadcasts \
         switch nothing. A write that takes longer than the answer may is answered with exception \
         05: it goes on, and input registers 68 to 71 of its unit say how it ended.",
        "未知的值绝不发送：异常码 0B 表示模块无应答或数值已过期。没有模块的地址不应答，广播不会操作任何输出。写操作未能在\
         应答时限内结束时返回异常码 05：命令仍在执行，结果见该单元的输入寄存器 68 至 71。",
    ],
];

const FIELDS: &[Field] = &[
    Field::new("port", ["Serial port", "串口"], Shape::Text(256))
        .required()
        .with_hint([
            "Such as /dev/serial/by-id/…; not one of a line",
            "如 /dev/serial/by-id/…；不能是总线所用的端口",
        ]),
    Field::new(
        "baud",
        ["Baud rate", "波特率"],
        Shape::Number(1_200, 115_200, 9_600),
    ),
    Field::new("format", ["Format", "格式"], Shape::Choice(FORMATS)),
    fields::WRITE,
    fields::MODULES,
    fields::UNITS,
    fields::MAP,
    fields::WITHIN,
    Field::new(
        "reply_within_ms",
        ["Answer a write within (ms)", "写操作的应答时限（毫秒）"],
        Shape::Number(50, 10_000, 400),
    )
    .with_hint([
        "Less than the master waits; a write that takes longer is acknowledged and goes on",
        "应小于主站的超时时间；未结束的写操作先返回“已接受”，然后继续执行",
    ]),
];

const FORMATS: &[(&str, Pair)] = &[
    ("8N1", ["8N1", "8N1"]),
    ("8E1", ["8E1", "8E1"]),
    ("8O1", ["8O1", "8O1"]),
    ("8N2", ["8N2", "8N2"]),
];
