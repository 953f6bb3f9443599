//! The texts of findings beyond the table of their codes.

railbus_words::texts! {
    pub FindingText;

    SystemGood { en: "clock {date}, locale {locale}", zh: "时钟 {date}，语言环境 {locale}" }
    Answers { en: "online on {line}: {modules} ({count})", zh: "{line} 上 {count} 个模块应答：{modules}" }
    Met { en: "{at}; {lost}", zh: "{at}；{lost}" }
    NotAsked { en: "not asked yet: {modules}", zh: "尚未读取：{modules}" }
    LastGood { en: "{at}, last good {time}", zh: "{at}，最近有效 {time}" }
    ConfigGood {
        en: "{file}: valid; estimated load {loads}",
        zh: "{file}：有效；估计负载 {loads}",
    }
    LineUp { en: "{line} is open (daemon)", zh: "{line} 已打开（守护进程）" }
    LineOpening {
        en: "{line} is still being opened (daemon): nothing is known of it yet",
        zh: "{line} 正在打开（守护进程）：状态未知",
    }
    PortGood { en: "{port} opens, {settings}", zh: "{port} 可以打开，{settings}" }
    LineQuiet { en: "{line}: no data in {time}", zh: "{line} {time}内无数据" }
    LineHeard {
        en: "{line}: {count} bytes in {time}: {bytes}",
        zh: "{line}，{time}内 {count} 字节：{bytes}",
    }
    LineFrames {
        en: "{line}: {frames} requests in {time}: {bytes}",
        zh: "{line}，{time}内 {frames} 个请求：{bytes}",
    }
    Hears {
        en: "{module} (address {address}) received {messages} frames, {errors} bad, \
             {overruns} characters lost",
        zh: "{module}（地址 {address}）收到 {messages} 条报文，损坏 {errors} 条，\
             丢失 {overruns} 个字符",
    }
    NoModules { en: "no modules on {line}", zh: "{line} 上没有模块" }
    At {
        en: "{module} (address {address}, {protocol}, {settings})",
        zh: "{module}（地址 {address}，{protocol}，{settings}）",
    }
}
