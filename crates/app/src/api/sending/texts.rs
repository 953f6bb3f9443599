//! What a raw frame may do, in words.

use railbus_words::texts;

texts! {
    pub(crate) SendText;

    Whoever { en: "whoever has address {address}", zh: "地址为 {address} 的模块" }
    MaySwitch {
        en: "It may switch outputs: {modules}.",
        zh: "可能动作输出：{modules}。",
    }
    MayKeep {
        en: "It changes stored settings of a module ({modules}), such as its address or speed: \
            railbus may no longer find it, and this can't be undone. The module's settings page \
            does the same, and can undo it.",
        zh: "会更改模块保存的设置（{modules}），例如地址或波特率：railbus 可能再也找不到该模块，\
            且无法撤销。在模块的“设置”页更改则可撤销。",
    }
    MayAll {
        en: "All {protocol} modules on the line obey it at once, and none of them replies: \
            {modules}.",
        zh: "总线上所有使用 {protocol} 协议的模块都会立即执行，且均不应答：{modules}。",
    }
    Stowaway {
        en: "It contains a complete {protocol} command: a module with that protocol would obey \
            it, even if it is not in the configuration.",
        zh: "其中含有完整的 {protocol} 命令：如果总线上有未列入配置的此类模块，会执行该命令。",
    }
    Overrides {
        en: "It bypasses the configured restrictions of {point}: {rules}.",
        zh: "会绕过配置对 {point} 的限制：{rules}。",
    }
    Comma { en: ", ", zh: "、" }
    Locked { en: "locked", zh: "锁定" }
    Confirm { en: "confirmation required", zh: "需要确认" }
    Interlock { en: "interlock", zh: "与其他输出互锁" }
    MaxOn { en: "maximum on time", zh: "最长接通时间" }
    MinOff { en: "minimum off time", zh: "最短断开时间" }
}
