//! Reasons in the user's language. They arrive as English text: from our own parsers, from the
//! system, and from the libraries that parse TOML and JSON. Known ones are translated to Chinese;
//! the rest is left as it is, and marked as original text.

use crate::Lang;
use std::borrow::Cow;
use std::io;

/// A reason for the user: one without a known translation is marked as original text. A single word
/// is a name, or an identifier: it is left as it is.
pub fn told(lang: Lang, reason: &str) -> String {
    if lang == Lang::En || !reason.is_ascii() && of_system(reason).is_none() {
        return reason.to_owned();
    }
    match of_error(reason) {
        Some(told) => told,
        None if !reason.contains(' ') => reason.to_owned(),
        None => of_table(reason).unwrap_or_else(|| format!("原文：{reason}")),
    }
}

/// The same for a word that is not a name.
pub fn word(lang: Lang, word: &str) -> String {
    let known = of_table(word).filter(|_| lang == Lang::Zh);
    known.unwrap_or_else(|| word.to_owned())
}

/// Translates the system's errors and those of the JSON parser, which may stand among names and
/// commands: everything else is left as it is.
pub fn error(lang: Lang, reason: &str) -> String {
    let known = of_error(reason).filter(|_| lang == Lang::Zh);
    known.unwrap_or_else(|| reason.to_owned())
}

fn of_error(reason: &str) -> Option<String> {
    match placed(reason) {
        Some((words, line, column)) => {
            let told = of_table(words)?;
            Some(format!("{told}（第 {line} 行第 {column} 列）"))
        }
        None => of_system(reason),
    }
}

/// `… at line 3 column 7`, the usual end of a JSON error.
fn placed(reason: &str) -> Option<(&str, usize, usize)> {
    let (words, place) = reason.rsplit_once(" at line ")?;
    let (line, column) = place.split_once(" column ")?;
    Some((words, line.parse().ok()?, column.parse().ok()?))
}

/// The system's message, after any prefix: a path, mostly.
fn of_system(reason: &str) -> Option<String> {
    let Some((_, number)) = reason.rsplit_once(" (os error ") else {
        let known = KINDS.iter().find(|(kind, _)| kind.to_string() == reason);
        return known.map(|(_, zh)| (*zh).to_owned());
    };
    let number = number.strip_suffix(')')?.parse().ok()?;
    let error = io::Error::from_raw_os_error(number);
    let zh = match number {
        5 => "读写出错",
        6 | 19 => "设备不存在",
        _ => KINDS.iter().find(|(kind, _)| *kind == error.kind())?.1,
    };
    let before = reason.strip_suffix(&error.to_string())?;
    Some(format!("{before}{zh}（os error {number}）"))
}

/// Translates by the first matching row. The text in a gap may be such a phrase, too.
fn of_table(reason: &str) -> Option<String> {
    REASONS.iter().find_map(|[en, zh]| {
        let gaps = gaps(en, reason)?;
        let mut told = (*zh).to_owned();
        for (name, words) in gaps {
            let words = match words.contains(' ') || name == "wanted" {
                true => of_table(words).map_or(Cow::Borrowed(words), Cow::Owned),
                false => Cow::Borrowed(words),
            };
            told = told.replace(&format!("{{{name}}}"), &words);
        }
        Some(told)
    })
}

/// The text in the gaps of a pattern, if it matches the whole text. A gap is never empty.
fn gaps<'p, 't>(pattern: &'p str, text: &'t str) -> Option<Vec<(&'p str, &'t str)>> {
    let Some((before, rest)) = pattern.split_once('{') else {
        return (pattern == text).then(Vec::new);
    };
    let (name, after) = rest.split_once('}')?;
    let text = text.strip_prefix(before)?;
    let next = after.split('{').next().unwrap_or_default();
    let ends = match next.is_empty() {
        true => vec![text.len()],
        false => text.match_indices(next).map(|(at, _)| at).collect(),
    };
    ends.into_iter().filter(|end| *end > 0).find_map(|end| {
        let (words, left) = text.split_at_checked(end)?;
        let mut found = gaps(after, left)?;
        found.insert(0, (name, words));
        Some(found)
    })
}

/// The meanings of the system's errors.
const KINDS: &[(io::ErrorKind, &str)] = &[
    (io::ErrorKind::NotFound, "找不到文件或目录"),
    (io::ErrorKind::PermissionDenied, "权限不足"),
    (io::ErrorKind::AlreadyExists, "已存在"),
    (io::ErrorKind::ResourceBusy, "设备或资源忙"),
    (io::ErrorKind::StorageFull, "磁盘已满"),
    (io::ErrorKind::QuotaExceeded, "超出磁盘配额"),
    (io::ErrorKind::ReadOnlyFilesystem, "文件系统只读"),
    (io::ErrorKind::FileTooLarge, "文件过大"),
    (io::ErrorKind::IsADirectory, "是目录，不是文件"),
    (io::ErrorKind::NotADirectory, "路径中有一级不是目录"),
    (io::ErrorKind::DirectoryNotEmpty, "目录不为空"),
    (io::ErrorKind::ConnectionRefused, "连接被拒绝"),
    (io::ErrorKind::ConnectionReset, "连接被对方重置"),
    (io::ErrorKind::ConnectionAborted, "连接中断"),
    (io::ErrorKind::NotConnected, "未连接"),
    (io::ErrorKind::BrokenPipe, "管道已断开"),
    (io::ErrorKind::HostUnreachable, "主机不可达"),
    (io::ErrorKind::NetworkUnreachable, "网络不可达"),
    (io::ErrorKind::TimedOut, "超时"),
    (io::ErrorKind::AddrInUse, "地址已被占用"),
    (io::ErrorKind::AddrNotAvailable, "本机没有此地址"),
    (io::ErrorKind::InvalidInput, "参数无效"),
    (io::ErrorKind::InvalidData, "数据无效"),
    (io::ErrorKind::UnexpectedEof, "数据意外结束"),
    (io::ErrorKind::Unsupported, "系统不支持"),
];

/// Errors about values of the wrong kind, our own reasons, and those of the libraries, in this
/// order.
const REASONS: &[[&str; 2]] = &[
    ["number", "数字"],
    ["whole number", "整数"],
    ["table", "表"],
    ["text in quotes", "加引号的文字"],
    ["true / false", "true 或 false"],
    ["list of actions", "动作列表"],
    ["list of steps", "步骤列表"],
    ["list of points", "点位列表"],
    ["list of patterns", "通配名称列表"],
    ["list of kinds", "事件种类列表"],
    ["list of names", "名称列表"],
    // Why a line accepts no commands.
    ["opening", "正在打开"],
    ["closed", "已关闭"],
    ["gone", "端口已消失"],
    ["stuck", "数据发不出去"],
    ["busy", "正忙"],
    // Requests that can't be carried out.
    [
        "\"{key}\" is missing, or can't be read",
        "缺少 \"{key}\"，或无法识别",
    ],
    ["\"{key}\" can't be read", "\"{key}\" 无法识别"],
    ["\"rule\" is missing", "缺少 \"rule\""],
    ["\"seconds\" is 1 to 600", "\"seconds\" 应为 1 到 600"],
    [
        "\"ttl_ms\" is 200 to 3600000",
        "\"ttl_ms\" 应为 200 到 3600000",
    ],
    [
        "\"within_ms\" is 200 to 60000",
        "\"within_ms\" 应为 200 到 60000",
    ],
    [
        "\"format\" is pcapng or ndjson",
        "\"format\" 应为 pcapng 或 ndjson",
    ],
    ["\"set\" names no output", "\"set\" 中没有输出"],
    [
        "\"set\" names more than {most} outputs",
        "\"set\" 中的输出多于 {most} 个",
    ],
    ["{path} is named twice", "{path} 重复列出"],
    ["\"from\" is not before \"to\"", "\"from\" 应早于 \"to\""],
    ["\"hours\" is 1 to 168", "\"hours\" 应为 1 到 168"],
    [
        "\"since\" is at most 168 hours before \"until\"",
        "\"since\" 最多比 \"until\" 早 168 小时",
    ],
    [
        "\"point\" names 1 to 64 points",
        "\"point\" 应为 1 到 64 个点",
    ],
    [
        "\"format\" is csv or ndjson",
        "\"format\" 应为 csv 或 ndjson",
    ],
    [
        "a comment has at most 500 characters",
        "备注最多 500 个字符",
    ],
    ["expires_days is 1 to 3650", "expires_days 应为 1 到 3650"],
    ["modules: 1 to {most}", "modules 应为 1 到 {most} 个"],
    [
        "secret: {least} to {most} bytes, or null",
        "secret 应为 {least} 到 {most} 字节，或 null",
    ],
    ["{key}: a text", "{key} 应为文字"],
    ["{key}: this value can't be written", "{key} 的值无法写入"],
    ["{name}: a word or a number", "{name} 应为单词或数字"],
    [
        "name, or model and address, are needed",
        "需要名称，或型号和地址",
    ],
    ["no setting is named", "未指定设置项"],
    ["no such speed: {rate}", "没有此波特率：{rate}"],
    ["addresses: {part}", "地址无法识别：{part}"],
    ["nobody can be asked so", "按此范围没有可询问的地址"],
    [
        "a serial server sets the speed of this line",
        "此总线的波特率由串口服务器设定",
    ],
    [
        "not pairs of hexadecimal digits, or too many of them",
        "不是成对的十六进制数，或过长",
    ],
    [
        "no request of that protocol, or a wrong checksum",
        "不是该协议的请求，或校验错误",
    ],
    [
        "a module of {other} on this line would take it for a command",
        "此总线上使用 {other} 的模块会把它当作命令",
    ],
    [
        "an Idempotency-Key has 1 to 128 characters of ASCII",
        "Idempotency-Key 应为 1 到 128 个 ASCII 字符",
    ],
    [
        "this Idempotency-Key stands for another command",
        "此 Idempotency-Key 已用于另一命令",
    ],
    [
        "no such request: line {line} column {column}",
        "请求格式有误：第 {line} 行第 {column} 列",
    ],
    ["no such operation", "没有此操作"],
    ["no such topic", "没有此主题"],
    ["too many topics", "主题过多"],
    ["it asks nothing now", "此操作目前没有提问"],
    ["not with this method", "不支持此请求方法"],
    [
        "only a user who has logged in has a password",
        "只有登录的用户才有密码",
    ],
    [
        "the request comes from a page of another site",
        "请求来自其他网站的页面",
    ],
    [
        "the Host header does not name this machine",
        "Host 请求头不是本机",
    ],
    ["the simulated line has ended", "仿真总线已结束"],
    // Files and connections.
    ["no answer within 30 s", "30 秒内无应答"],
    ["HTTP status {status}", "HTTP 状态码 {status}"],
    ["it holds no PEM", "其中没有 PEM 内容"],
    ["it holds no certificate", "其中没有证书"],
    ["it holds no private key", "其中没有私钥"],
    ["it is not connected", "站点未连接"],
    ["it is not online", "站点不在线"],
    ["the answer of the site is too long", "站点的应答过长"],
    [
        "no answer yet; the centre keeps asking the site",
        "尚无应答；中心会继续询问站点",
    ],
    [
        "this Idempotency-Key stands for another command",
        "此 Idempotency-Key 已用于另一条命令",
    ],
    [
        "it is not known whether it was sent before",
        "不知道此前是否已发送",
    ],
    [
        "not sent: it could not be recorded first",
        "未发送：发送前未能记录",
    ],
    ["too many commands without a result", "尚无结果的命令过多"],
    ["the body is longer than 16 KiB", "请求正文超过 16 KiB"],
    ["the path is longer than 1 KiB", "请求路径超过 1 KiB"],
    ["it reached the site too late", "到达站点时已超时"],
    ["it was used before", "已被使用过"],
    [
        "the keys of this site were revoked since",
        "此后该站点的密钥已被吊销",
    ],
    ["the key was revoked", "密钥已被吊销"],
    ["the key is there already", "该密钥已存在"],
    ["this site has too many keys", "该站点的密钥过多"],
    [
        "it has expired, or is not of this fleet and site",
        "已过期，或不属于该站群和站点",
    ],
    ["the clock of the centre is behind", "中心的时钟过慢"],
    ["another invitation is being accepted", "正在接受另一份邀请"],
    ["this is no public key of a site", "不是站点的公钥"],
    [
        "it was asked for too often: wait ten seconds",
        "请求过于频繁：请等待十秒",
    ],
    ["the answer can't be read", "无法读取应答"],
    ["the centre has no key to sign with", "中心没有签名用的密钥"],
    ["the servers do not accept it", "服务器不接受"],
    ["it is longer than an invitation", "内容过长，不是邀请"],
    [
        "the line with the servers is missing or cut off",
        "服务器一行缺失或不完整",
    ],
    ["the certificate is missing or cut off", "证书缺失或不完整"],
    ["the key is missing or cut off", "密钥缺失或不完整"],
    ["there are no invitations for this kind", "此类集成没有邀请"],
    ["no answer in time", "未及时应答"],
    ["line {line} is not open any more", "总线 {line} 已断开"],
    [
        "module {module} does not answer any more",
        "模块 {module} 不再应答",
    ],
    ["there is no session with the centre", "与中心没有会话"],
    ["a part of the program panicked", "程序的一部分已崩溃"],
    [
        "the integration was ended while it was tried",
        "试用期间集成已停止",
    ],
    [
        "the site was restarted while it was tried",
        "试用期间站点重启",
    ],
    [
        "the configuration was changed at the site while it was tried",
        "试用期间配置在站点本地更改",
    ],
    [
        "the configuration was changed at the site",
        "配置已在站点本地更改",
    ],
    ["its signature is wrong", "签名有误"],
    ["what is recorded of it is not read yet", "尚未读取其记录"],
    ["it is of another site", "属于其他站点"],
    ["no answer", "无应答"],
    [
        "the site reported no result within a day",
        "站点一天内未给出结果",
    ],
    [
        "the site was restarted meanwhile, or has no record of it any more",
        "站点其间重启，或已无其记录",
    ],
    [
        "it is under way at the site, or may still come",
        "站点正在执行，或尚未到达",
    ],
    [
        "it was not certain that it was recorded",
        "当时不确定是否已记录",
    ],
    ["it was stopped", "已被停止"],
    [
        "it was not its turn within {n} minutes",
        "{n} 分钟内未轮到该站点",
    ],
    [
        "the process of the centre that sent them has ended",
        "负责发送的中心进程已退出",
    ],
    ["the centre lost its connection", "中心的连接已断开"],
    ["nothing within {n} s", "{n} 秒内无应答"],
    ["its answer was {n} s on the way", "应答在途 {n} 秒"],
    ["its answer is longer than {n} KiB", "应答超过 {n} KiB"],
    ["it had no answer within {n} s", "站点在 {n} 秒内未得出应答"],
    ["too many requests at a time", "同时请求过多"],
    ["an answer with status {n}", "应答状态码为 {n}"],
    [
        "an answer without its time on the way",
        "应答未给出在途时间",
    ],
    ["no server says that it took it", "没有服务器确认接受"],
    [
        "the configuration has more than 512 KiB",
        "配置超过 512 KiB",
    ],
    [
        "this is no seed of a key that signs configurations",
        "不是签署配置的密钥",
    ],
    [
        "stream did not contain valid UTF-8",
        "不是有效的 UTF-8 文本",
    ],
    // The TOML parser.
    [
        "invalid unquoted key, expected {wanted}",
        "键名中有不允许的字符",
    ],
    [
        "string values must be quoted, expected {wanted}",
        "缺少值，或值有误（文字须加引号）",
    ],
    [
        "key with no value, expected {wanted}",
        "只有键，缺少 {wanted} 和值",
    ],
    ["extra `=`, expected {wanted}", "多余的 `=`"],
    ["duplicate key", "键重复"],
    ["missing value", "缺少值"],
    ["missing value for key", "键没有值"],
    ["invalid value", "值无效"],
    ["invalid string", "字符串无效"],
    ["invalid basic string", "字符串未闭合，或其中有不允许的字符"],
    [
        "invalid literal string",
        "字符串未闭合，或其中有不允许的字符",
    ],
    [
        "invalid multi-line basic string",
        "多行字符串未闭合，或其中有不允许的字符",
    ],
    [
        "invalid multi-line literal string",
        "多行字符串未闭合，或其中有不允许的字符",
    ],
    ["invalid boolean", "应为 true 或 false"],
    ["invalid integer number", "整数无效"],
    ["invalid float", "小数无效"],
    ["invalid mantissa", "小数无效"],
    ["invalid fraction", "小数无效"],
    ["invalid date-time", "日期时间无效"],
    ["invalid key-value pair", "不是“键 = 值”"],
    ["missing opening quote", "缺少左引号"],
    ["missing escaped value", "反斜杠后缺少转义字符"],
    [
        "missing comma between array elements",
        "列表各项之间缺少逗号",
    ],
    [
        "missing comma between key-value pairs",
        "各键值之间缺少逗号",
    ],
    [
        "missing assignment between key-value pairs",
        "键和值之间缺少 `=`",
    ],
    ["extra comma in array", "列表中有多余的逗号"],
    ["extra comma in inline table", "花括号中有多余的逗号"],
    ["unclosed table", "表头未闭合"],
    ["unclosed array table", "表头未闭合"],
    ["unclosed array", "列表未闭合"],
    ["unclosed inline table", "花括号未闭合"],
    ["unexpected key or value", "此处不应有键或值"],
    ["unexpected content", "此处有多余的内容"],
    ["unexpected leading zero", "数字不能以 0 开头"],
    [
        "unexpected leading zero, expected {wanted}",
        "数字不能以 0 开头",
    ],
    ["{what}, expected {wanted}", "{what}，应为 {wanted}"],
    ["newline", "换行"],
    ["nothing", "空"],
    ["value", "值"],
    ["key", "键"],
    ["digits", "数字"],
    // The JSON parser.
    ["missing field {field}", "缺少 {field}"],
    [
        "unknown field {field}, expected {wanted}",
        "未知的 {field}，可用：{wanted}",
    ],
    [
        "unknown field {field}, there are no fields",
        "未知的 {field}",
    ],
    [
        "unknown variant {found}, expected {wanted}",
        "{found} 不可用，可用：{wanted}",
    ],
    ["duplicate field {field}", "{field} 重复"],
    [
        "invalid type: {found}, expected {wanted}",
        "类型有误：现为 {found}，应为 {wanted}",
    ],
    [
        "invalid value: {found}, expected {wanted}",
        "值有误：现为 {found}，应为 {wanted}",
    ],
    ["expected value", "此处应有值"],
    ["trailing characters", "末尾有多余的字符"],
    ["trailing comma", "末尾有多余的逗号"],
    ["key must be a string", "键须加引号"],
    ["EOF while parsing {what}", "内容不完整"],
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_are_told_in_chinese_and_what_is_not_known_is_marked() {
        let zh = |reason: &str| told(Lang::Zh, reason);
        assert_eq!(
            zh("\"set\" names more than 64 outputs"),
            "\"set\" 中的输出多于 64 个"
        );
        assert_eq!(word(Lang::Zh, "whole number"), "整数");
        assert_eq!(
            zh("/dev/x: Permission denied (os error 13)"),
            "/dev/x: 权限不足（os error 13）"
        );
        assert_eq!(zh("no storage space"), "磁盘已满");
        let missing = "missing field `name` at line 3 column 7";
        assert_eq!(zh(missing), "缺少 `name`（第 3 行第 7 列）");
        assert_eq!(zh("it went wrong"), "原文：it went wrong");
        assert_eq!(error(Lang::Zh, "oven.k1 pump.k2"), "oven.k1 pump.k2");
        assert_eq!(
            error(Lang::Zh, "/泵: No such file or directory (os error 2)"),
            "/泵: 找不到文件或目录（os error 2）"
        );
        // Data, and text that already is Chinese, need no mark.
        for same in ["?AA", "ttl_ms", "busy", "不存在 x"] {
            assert_eq!(zh(same), same);
        }
        assert_eq!(told(Lang::En, missing), missing);
    }

    /// A change of one of our own reasons requires a change of its row.
    #[test]
    fn each_reason_of_our_own_is_said_somewhere() {
        fn sources(folder: &std::path::Path, all: &mut String) {
            for entry in std::fs::read_dir(folder).expect("a folder") {
                let path = entry.expect("an entry").path();
                if path.is_dir() {
                    sources(&path, all);
                } else if !path.ends_with("words/src/reasons.rs") {
                    *all += &std::fs::read_to_string(&path).unwrap_or_default();
                }
            }
        }
        let crates = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let mut all = String::new();
        for one in std::fs::read_dir(crates).expect("the crates") {
            let source = one.expect("an entry").path().join("src");
            if source.is_dir() {
                sources(&source, &mut all);
            }
        }
        let own = REASONS
            .iter()
            .take_while(|[en, _]| !en.starts_with("stream did not"));
        for [en, _] in own {
            // The text before and after a gap.
            let parts = en.split('{').flat_map(|part| part.split('}').next_back());
            for part in parts {
                let part = part.replace('"', "\\\"");
                assert!(all.contains(part.trim()), "{en}: {part}");
            }
        }
    }

    #[test]
    fn each_row_has_the_gaps_of_its_pattern() {
        let names = |text: &str| {
            let parts = text.split('{').skip(1);
            let names = parts.filter_map(|part| part.split_once('}'));
            names
                .map(|(name, _)| name.to_owned())
                .collect::<std::collections::BTreeSet<_>>()
        };
        for [en, zh] in REASONS {
            assert!(names(zh).is_subset(&names(en)), "{en}: {zh}");
            assert!(!zh.is_ascii(), "{zh}");
        }
    }
}
