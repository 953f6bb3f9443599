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
        en: "It changes what a module keeps ({modules}), such as its address or speed: railbus may \
            no longer find it, and nothing takes this back. The settings of the module do it with \
            a way back.",
        zh: "会更改模块保存的设置（{modules}），例如地址或波特率：railbus 可能再也找不到该模块，\
            且无法撤销。在模块的“设置”页更改则可撤销。",
    }
    MayAll {
        en: "Every module on the line that speaks {protocol} obeys it at once, and none answers: \
            {modules}.",
        zh: "总线上所有使用 {protocol} 协议的模块都会立即执行，且均不应答：{modules}。",
    }
    Stowaway {
        en: "It holds a whole command of {protocol}: a module of that protocol, though not in the \
            configuration, would obey it.",
        zh: "其中含有完整的 {protocol} 命令：如果总线上有未列入配置的此类模块，会执行该命令。",
    }
    Overrides {
        en: "It goes past what the configuration says of {point}: {rules}.",
        zh: "会越过配置对 {point} 的规定：{rules}。",
    }
    Comma { en: ", ", zh: "、" }
    Locked { en: "locked", zh: "锁定" }
    Confirm { en: "to be confirmed", zh: "需要确认" }
    Interlock { en: "excludes other outputs", zh: "与其他输出互锁" }
    MaxOn { en: "may be on for so long only", zh: "最长接通时间" }
    MinOff { en: "must stay off for a while", zh: "最短断开时间" }
}
