//! Settings that several kinds have.

use crate::northbound::kind::{Field, Pair, Shape};
use railbus_site::config::change::Keys;
use railbus_site::{WITHIN_MAX, WITHIN_MIN};

/// How long a command may wait, in ms, if nothing else is said.
const WITHIN_USUAL: i64 = 5_000;

/// How long a command may wait, in ms.
pub(crate) fn within_ms(settings: &Keys) -> u64 {
    let said = settings.get("within_ms").and_then(|value| value.as_i64());
    said.unwrap_or(WITHIN_USUAL).unsigned_abs()
}

/// Who may connect.
pub(crate) const ALLOW: Field =
    Field::new("allow", ["Allowed clients", "允许连接的机器"], Shape::Texts).with_hint([
        "Addresses or networks such as 192.168.1.0/24, separated by commas. Required if other \
         machines are to connect: Modbus TCP has no password",
        "地址或网络（如 192.168.1.0/24），用逗号分隔。供其他机器访问时必填：Modbus TCP 没有密码",
    ]);

/// What may be switched.
pub(crate) const WRITE: Field = Field::new(
    "write",
    ["Outputs that may be switched", "允许操作的输出"],
    Shape::Points,
)
.with_hint([
    "Outputs such as oven.k1, oven or *; read only if left empty",
    "输出，如 oven.k1、oven 或 *；留空则只读",
]);

/// Which modules are units; all if it is left out.
pub(crate) const MODULES: Field = Field::new("modules", ["Modules", "模块"], Shape::Modules);

/// Which module is which unit, where its address does not say it.
pub(crate) const UNITS: Field = Field::new("units", ["Unit numbers", "单元号"], Shape::Texts)
    .with_hint([
        "Only for modules whose address is not their unit number: pump=4, oven=5",
        "仅用于单元号不同于地址的模块：pump=4, oven=5",
    ]);

/// Which coils and registers units have.
pub(crate) const MAP: Field = Field::new(
    "map",
    ["Coils and registers", "线圈与寄存器"],
    Shape::Choice(MAPS),
);

/// How long a command may take until it is sent.
pub(crate) const WITHIN: Field = Field::new(
    "within_ms",
    [
        "A command must be sent within (ms)",
        "命令须在此时间内发出（毫秒）",
    ],
    Shape::Number(millis(WITHIN_MIN), millis(WITHIN_MAX), WITHIN_USUAL),
);

const MAPS: &[(&str, Pair)] = &[
    (
        "own",
        [
            "As in the datasheet, where the module speaks Modbus RTU",
            "模块使用 Modbus RTU 时按其说明书",
        ],
    ),
    ("uniform", ["The same for all modules", "所有模块相同"]),
];

const fn millis(time: railbus_wire::Micros) -> i64 {
    (time.0 / 1_000) as i64
}
