//! Configurations that are valid but unwise.

use super::{FindingKind, finding};

/// All of them, by code.
pub(super) const TABLE: &[FindingKind] = &[
    finding(
        "L001",
        [
            "a Modbus address equal to the first byte of another protocol's frames",
            "Modbus 地址与另一协议报文的首字节相同",
        ],
        [
            "85 (55h) or 34 (22h) beside 0x55 boards, 76 (4Ch) or 108 (6Ch) beside LC-02, \
            36 (24h) and other signs beside ASCII modules",
            "0x55 板旁的 85、34，LC-02 旁的 76 (4Ch)、108 (6Ch)，ASCII 模块旁的 36 (24h) 等",
        ],
        [
            "give the Modbus module another address",
            "为该 Modbus 模块更换地址",
        ],
    ),
    finding(
        "L002",
        ["an address that Modbus reserves", "Modbus 保留的地址"],
        [
            "248 to 255: some modules accept them, some masters do not poll them",
            "248 至 255：部分模块可用，部分主站不会访问",
        ],
        ["use 1 to 247", "使用 1 至 247"],
    ),
    finding(
        "L003",
        [
            "address 0 is the Modbus broadcast address",
            "地址 0 在 Modbus 中为广播",
        ],
        [
            "once switched to Modbus, the module could not be reached",
            "切换到 Modbus 后将无法访问该模块",
        ],
        ["use 1 to 247", "使用 1 至 247"],
    ),
    finding(
        "L010",
        [
            "the polls need more time than the line has",
            "轮询所需时间超过总线能力",
        ],
        [
            "too many modules, a slow line or poll = too short",
            "模块过多、波特率过低或 poll 过短",
        ],
        [
            "a longer poll, a higher speed, or two lines",
            "加大 poll、提高波特率，或分为两条总线",
        ],
    ),
    finding(
        "L011",
        [
            "values of the module become stale between two reads",
            "两次读取之间数值已过期",
        ],
        [
            "one polling cycle takes longer than max_age",
            "轮询一圈的时间超过 max_age",
        ],
        [
            "a longer max_age, a higher speed, or two lines",
            "加大 max_age、提高波特率，或分为两条总线",
        ],
    ),
    finding(
        "L012",
        [
            "modules at different speeds on one line",
            "同一总线上波特率不同",
        ],
        [
            "each poll of the others needs two speed changes, and is noise to the rest",
            "每次轮询都要切换两次波特率，且对其他模块是噪声",
        ],
        [
            "set all modules of the line to one speed",
            "使同一总线的模块波特率一致",
        ],
    ),
    finding(
        "L013",
        [
            "modules with different character formats on one line",
            "同一总线上字符格式不同",
        ],
        [
            "each poll of the others needs two format changes",
            "每次轮询都要切换两次格式",
        ],
        [
            "set all modules of the line to one format",
            "使同一总线的模块格式一致",
        ],
    ),
    finding(
        "L014",
        [
            "ASCII modules with and without checksum on one line",
            "同一总线上有带与不带校验和的 ASCII 模块",
        ],
        [
            "after a lost byte, a frame for one kind may be valid for the other",
            "丢失字节后，一类的报文可能被另一类接受",
        ],
        ["enable the checksum on all of them", "为全部模块启用校验和"],
    ),
    finding(
        "L020",
        ["the port name can change", "端口名会改变"],
        [
            "ttyUSB0 is the adapter plugged in first",
            "ttyUSB0 是最先插入的设备",
        ],
        [
            "use the stable name, see railbus ls ports",
            "改用固定名称，见 railbus ls ports",
        ],
    ),
];
