//! The texts of findings beyond the table of their codes.

railbus_words::texts! {
    pub FindingText;

    SystemGood { en: "clock {date}, locale {locale}", zh: "时钟 {date}，语言环境 {locale}" }
    Answers { en: "online on {line}: {modules} ({count})", zh: "{line} 上 {count} 个模块应答：{modules}" }
    Met { en: "{at}; {lost}", zh: "{at}；{lost}" }
    NotAsked { en: "not asked yet: {modules}", zh: "尚未询问：{modules}" }
    LastGood { en: "{at}, last good {time}", zh: "{at}，最近有效 {time}" }
    ConfigGood {
        en: "{file}: valid; estimated load {loads}",
        zh: "{file}：有效；估计负载 {loads}",
    }
    LineUp { en: "{line} is open (daemon)", zh: "{line} 已打开（守护进程）" }
    LineOpening {
        en: "{line} is still being opened (daemon): nothing is known of it yet",
        zh: "{line} 正在打开（守护进程）：尚无其状态",
    }
}
