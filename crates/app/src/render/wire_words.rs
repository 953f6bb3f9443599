//! Protocol terms in the user's language. The core speaks only English, and so do logs and JSON.

use crate::texts::AppText;
use railbus_api::types::Lost;
use railbus_wire::Malformed;
use railbus_wire::rtu::Exception;
use railbus_words::Lang;

/// A Modbus exception, such as `02 illegal data address`.
pub fn exception(lang: Lang, why: Exception) -> String {
    let text = match why.0 {
        1 => "功能码非法",
        2 => "数据地址非法",
        3 => "数据值非法",
        4 => "设备故障",
        5 => "已确认，仍在处理",
        6 => "设备忙",
        8 => "校验错误或存储器奇偶校验错误",
        0x0A => "网关路径不可用",
        0x0B => "网关目标无应答",
        _ => "未定义的异常码",
    };
    match lang {
        Lang::En => why.to_string(),
        Lang::Zh => format!("{:02X} {text}", why.0),
    }
}

/// Why a reply is not valid, by the core's words for it; other words are left unchanged.
pub fn malformed(lang: Lang, why: &str) -> String {
    let known = MALFORMED.iter().find(|known| known.to_string() == why);
    match (lang, known) {
        (Lang::Zh, Some(why)) => in_chinese(*why).to_owned(),
        _ => why.to_owned(),
    }
}

/// The results of the last requests to a module without valid replies.
pub fn lost(lang: Lang, lost: &Lost) -> String {
    let why = malformed(lang, lost.why.as_deref().unwrap_or_default());
    let values: &[(&str, &dyn std::fmt::Display)] = &[
        ("attempts", &lost.attempts),
        ("garbled", &lost.garbled),
        ("bytes", &lost.rx_bytes),
        ("why", &why),
    ];
    lang.fill(AppText::Lost, values)
}

/// All of them: an addition to the match below must be added here, too.
const MALFORMED: [Malformed; 9] = [
    Malformed::Start,
    Malformed::Address,
    Malformed::Function,
    Malformed::Length,
    Malformed::Checksum,
    Malformed::Echo,
    Malformed::Syntax,
    Malformed::Value,
    Malformed::End,
];

const fn in_chinese(why: Malformed) -> &'static str {
    match why {
        Malformed::Start => "报文开头不符",
        Malformed::Address => "是其他模块的地址",
        Malformed::Function => "是其他功能",
        Malformed::Length => "不完整，或数据个数与所问不符",
        Malformed::Checksum => "校验错误",
        Malformed::Echo => "所确认的与命令不符",
        Malformed::Syntax => "出现了不该有的字符",
        Malformed::Value => "数值超出范围",
        Malformed::End => "报文末尾缺少结束符",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_core_says_is_said_in_chinese() {
        let why = Malformed::Address.to_string();
        assert_eq!(malformed(Lang::Zh, &why), "是其他模块的地址");
        assert_eq!(malformed(Lang::En, &why), why);
        assert_eq!(malformed(Lang::Zh, "?AA"), "?AA");
        assert_eq!(exception(Lang::Zh, Exception(2)), "02 数据地址非法");
        assert_eq!(exception(Lang::En, Exception(2)), "02 illegal data address");
    }
}
