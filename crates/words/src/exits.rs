//! The exit codes: one table, whose meanings never change.

use crate::Lang;

/// An exit code.
#[derive(Clone, Copy, Debug)]
pub struct Exit {
    /// The process's exit status.
    pub code: u8,
    /// Its name in the table of exit codes.
    pub name: &'static str,
    meaning: [&'static str; 2],
}

impl Exit {
    /// When it is used.
    #[must_use]
    pub const fn meaning(&self, lang: Lang) -> &'static str {
        lang.of(self.meaning)
    }
}

const fn exit(code: u8, name: &'static str, en: &'static str, zh: &'static str) -> Exit {
    Exit {
        code,
        name,
        meaning: [en, zh],
    }
}

/// All of them.
pub const EXITS: &[Exit] = &[
    exit(
        0,
        "ok",
        "done, and read back where asked",
        "完成；需要时已回读确认",
    ),
    exit(1, "error", "anything not below", "以下未列出的错误"),
    exit(2, "usage", "wrong arguments", "参数有误"),
    exit(
        3,
        "no_reply",
        "no reply within the time limit",
        "限定时间内无应答",
    ),
    exit(4, "refused", "refused by the module", "模块拒绝"),
    exit(
        5,
        "garbled",
        "a reply came with a wrong checksum, form or address",
        "应答的校验和、格式或地址有误",
    ),
    exit(
        6,
        "not_verified",
        "acknowledged, but reads back differently",
        "已应答，但回读不一致",
    ),
    exit(
        7,
        "port",
        "the line can't be opened: missing, no right, busy",
        "无法打开总线：不存在、无权限或被占用",
    ),
    exit(
        8,
        "config",
        "the configuration or a value is invalid",
        "配置或值无效",
    ),
    exit(
        9,
        "auth",
        "the daemon refused the caller",
        "守护进程拒绝访问",
    ),
    exit(
        10,
        "differs",
        "differences found (--exit-code)",
        "发现差异（--exit-code）",
    ),
    exit(
        11,
        "partial",
        "some of several targets failed",
        "多个目标中部分失败",
    ),
    exit(
        12,
        "timeout",
        "the points did not get the values waited for in time",
        "等待的点位未按时达到指定的值",
    ),
    exit(130, "interrupted", "Ctrl-C", "被 Ctrl-C 中断"),
];
