//! The problems of a configuration, in words.

use railbus_device::SetupError;
use railbus_host::NameError;
use railbus_site::config::{FAULTS, FaultError, Invalid};
use railbus_words::Lang;
use railbus_words::reasons;

/// One problem in a few words.
pub fn reason(lang: Lang, kind: &Invalid) -> String {
    let both = |en: String, zh: String| match lang {
        Lang::En => en,
        Lang::Zh => zh,
    };
    let fixed = |both: [&'static str; 2]| lang.of(both).to_owned();
    match kind {
        Invalid::Syntax(words) => {
            let words = reasons::told(lang, words);
            both(
                format!("not valid TOML: {words}"),
                format!("不是 TOML：{words}"),
            )
        }
        Invalid::UnknownKey(Some(meant)) => both(
            format!("unknown key; did you mean \"{meant}\"?"),
            format!("未知的键；是否应为 \"{meant}\"？"),
        ),
        Invalid::UnknownKey(None) => fixed(["unknown key", "未知的键"]),
        Invalid::MissingKey(key) => {
            both(format!("\"{key}\" is missing"), format!("缺少 \"{key}\""))
        }
        Invalid::WrongType(wanted) => {
            let wanted = reasons::word(lang, wanted);
            both(format!("must be: {wanted}"), format!("类型应为：{wanted}"))
        }
        Invalid::NotOneOf(choices) => {
            let choices = choices.join(", ");
            both(
                format!("must be one of: {choices}"),
                format!("应为其中之一：{choices}"),
            )
        }
        Invalid::OutOfRange(low, high) => both(
            format!("must be from {low} to {high}"),
            format!("应在 {low} 到 {high} 之间"),
        ),
        Invalid::BadName => fixed([
            "names are 1 to 32 of a-z, 0-9 and _",
            "名称须由 1 到 32 个 a-z、0-9 或 _ 组成",
        ]),
        Invalid::BadDuration => fixed([
            "not a length of time with its unit, such as \"200ms\"",
            "须为带单位的时间，如 \"200ms\"",
        ]),
        Invalid::BadRange => fixed([
            "must be \"0-10V\", \"0-20mA\" or { low, high, unit }",
            "应为 \"0-10V\"、\"0-20mA\" 或 { low, high, unit }",
        ]),
        Invalid::BadPort(why) => fixed(port(*why)),
        Invalid::PortTaken(other) => both(
            format!("line \"{other}\" is plugged in here already"),
            format!("总线 \"{other}\" 已使用此端口"),
        ),
        Invalid::NoSuchLine => fixed(["there is no such line", "没有此总线"]),
        Invalid::NoSuchModule => fixed(["there is no such module", "没有此模块"]),
        Invalid::NoSuchPoint => fixed(["the module has no such point", "该模块没有此点位"]),
        Invalid::NoSuchSetting(known) => {
            let known = known.join(", ");
            both(
                format!(
                    "the module has no such setting here; it has: {known}; address, baud, \
                        format and checksum stand in the module's own table"
                ),
                format!(
                    "该模块在此没有这项设置；可用：{known}；address、baud、format、checksum 写在模块自身的表中"
                ),
            )
        }
        Invalid::BadSetting(possible) => both(
            format!("the setting can be: {possible}"),
            format!("该设置可为：{possible}"),
        ),
        Invalid::NoSuchPath => fixed([
            "there is no such point; write MODULE.POINT, as \"oven.k1\"",
            "没有此点位；应写为 模块.点位，如 \"oven.k1\"",
        ]),
        Invalid::NotAnOutput => fixed(["only outputs are allowed here", "仅适用于输出点"]),
        Invalid::InterlockSelf => fixed([
            "an output can't interlock with itself",
            "输出不能与自身互锁",
        ]),
        Invalid::NamedTwice => fixed(["it is listed twice", "重复列出"]),
        Invalid::TooMany(most) => both(
            format!("more than {most} of them"),
            format!("多于 {most} 个"),
        ),
        Invalid::TooLong(longest) => {
            let seconds = longest.0 / 1_000_000;
            both(
                format!("must be more than nothing, and {seconds} s at most"),
                format!("应大于 0，且不超过 {seconds} 秒"),
            )
        }
        Invalid::BadStep => fixed([
            "a step is { set = \"oven.k1\", to = true } or { wait = \"2s\" }",
            "步骤应为 { set = \"oven.k1\", to = true } 或 { wait = \"2s\" }",
        ]),
        Invalid::BadCondition => fixed([
            "a condition is { point, is }, { point, above } or { point, below }, { time } \
             without \"for\", { module_offline } or { line_offline }",
            "条件应为 { point, is }、{ point, above } 或 { point, below }、不带 \"for\" 的 \
             { time }、{ module_offline } 或 { line_offline }",
        ]),
        Invalid::BadTime => fixed([
            "a time of day is written as \"06:30\"",
            "时刻应写为 \"06:30\"",
        ]),
        Invalid::BadAction => fixed([
            "a rule does { set, to }, { pulse, width } or { notify }, one at least",
            "规则的动作应为 { set, to }、{ pulse, width } 或 { notify }，至少一项",
        ]),
        Invalid::BadText(most) => both(
            format!("a text has 1 to {most} characters"),
            format!("文字应为 1 到 {most} 个字符"),
        ),
        Invalid::NeedsPerson => fixed([
            "a person has to confirm this output, a rule can't",
            "此输出须由人确认，规则不能操作",
        ]),
        Invalid::OtherUnit(unit) => both(
            format!("the unit of the point is \"{unit}\""),
            format!("该点位的单位是 \"{unit}\""),
        ),
        Invalid::BadUrl => fixed([
            "write http://HOST[:PORT]/… or https://…, without a name and a password",
            "应写为 http://主机[:端口]/… 或 https://…，不含用户名和密码",
        ]),
        Invalid::BadListen => fixed([
            "write an address and a port, such as 127.0.0.1:1502",
            "应写地址和端口，如 127.0.0.1:1502",
        ]),
        Invalid::BadNetwork => fixed([
            "write a network such as 192.168.1.0/24, or an address",
            "应写网络（如 192.168.1.0/24）或地址",
        ]),
        Invalid::BadTopic => fixed([
            "write a word without spaces, +, # and $, other than STATE; / divides the levels of a \
             prefix",
            "应写不含空格、+、# 和 $ 的词，且不可为 STATE；前缀的各级用 / 分隔",
        ]),
        Invalid::TopicsTaken(other) => both(
            format!(
                "\"{other}\" has the same topics at the same broker: write another name here, or \
                 another prefix"
            ),
            format!("\"{other}\" 已在同一代理上使用相同的主题：请改用其他名称或前缀"),
        ),
        Invalid::BadUnit => fixed([
            "write a module and its unit, 1 to 247: \"pump=4\"",
            "应写模块名称和单元号（1 至 247），如 \"pump=4\"",
        ]),
        Invalid::NeedsUnit(module) => both(
            format!(
                "the address of \"{module}\" can't be a unit number: add \"{module}=N\" to \
                 units, N from 1 to 247"
            ),
            format!(
                "\"{module}\" 的地址不能作为单元号：请在 units 中加上 \"{module}=N\"，N 为 1 至 247"
            ),
        ),
        Invalid::UnitTaken(unit, [first, second]) => both(
            format!(
                "\"{first}\" and \"{second}\" are both unit {unit}: give one of them another \
                 number, such as \"{second}=N\""
            ),
            format!(
                "\"{first}\" 与 \"{second}\" 的单元号都是 {unit}：请为其中一个另指定单元号，如 \"{second}=N\""
            ),
        ),
        Invalid::Unguarded => fixed([
            "other machines could connect without a password: name those that may in \"allow\"",
            "其他机器无需密码即可连接：请在 \"allow\" 中写明允许哪些机器",
        ]),
        Invalid::BadRole => fixed([
            "write a role and the outputs that it may switch: \"operator=pump.*\"",
            "应写角色和允许其操作的输出，如 \"operator=pump.*\"",
        ]),
        Invalid::BadThumbprint => fixed([
            "write the SHA-1 thumbprint of the certificate: 40 hexadecimal digits",
            "应写证书的 SHA-1 指纹：40 位十六进制数字",
        ]),
        Invalid::BadServers => fixed([
            "not the servers of a fleet: HOST or HOST:PORT is wanted",
            "不是站群的服务器：应为 主机 或 主机:端口",
        ]),
        Invalid::BadConfigKey => fixed([
            "not the key of a centre: V and 55 letters and digits, as railbus fleet config-key \
             DIR shows it there",
            "不是中心的密钥：应为 V 开头的 56 位字母和数字，可在中心用 railbus fleet config-key 文件夹 查看",
        ]),
        Invalid::ManagedBy(other) => both(
            format!("\"{other}\" takes the configuration from its centre: only one can"),
            format!("\"{other}\" 已从其中心接受配置：只能有一个"),
        ),
        Invalid::RolesOnly => fixed([
            "with TLS the role of a client says what it may switch: use \"roles\" instead",
            "使用 TLS 时，客户端的角色决定其可操作的输出：请改用 \"roles\"",
        ]),
        Invalid::NotAnInput => fixed([
            "this is no input; only inputs are moved from outside",
            "不是输入点；只能从外部改变输入",
        ]),
        Invalid::Setup(why) => setup(lang, *why),
        Invalid::BadFault(why) => fault(lang, why),
        Invalid::AddressTaken(other) => both(
            format!("module \"{other}\" has this address already"),
            format!("模块 \"{other}\" 已使用此地址"),
        ),
        _ => kind.code().to_owned(),
    }
}

/// Why this is not a fault that can be simulated.
pub fn fault(lang: Lang, why: &FaultError) -> String {
    let [en, zh] = match why {
        FaultError::Unknown(word) => {
            let names = FAULTS.map(|(name, _)| name).join(", ");
            [
                format!("there is no fault \"{word}\", but {names}"),
                format!("没有故障 \"{word}\"，可用：{names}"),
            ]
        }
        FaultError::Form(form) => [format!("write {form}"), format!("应写为 {form}")],
        FaultError::LinesOnly(name) => [
            format!("\"{name}\" is a fault of lines, not of modules"),
            format!("\"{name}\" 是总线的故障，不能用于模块"),
        ],
        FaultError::ModulesOnly(name) => [
            format!("\"{name}\" is a fault of modules, not of lines"),
            format!("\"{name}\" 是模块的故障，不能用于总线"),
        ],
        FaultError::Uncounted(name) => [
            format!("\"{name}\" can't be over after so many replies; say how long"),
            format!("\"{name}\" 不能按应答次数结束，请写持续时间"),
        ],
        FaultError::TooMany(most) => [
            format!("more than {most} faults"),
            format!("故障多于 {most} 个"),
        ],
    };
    match lang {
        Lang::En => en,
        Lang::Zh => zh,
    }
}

const fn port(why: NameError) -> [&'static str; 2] {
    match why {
        NameError::Form => [
            "write /dev/…, tcp:HOST:PORT, mbtcp:HOST[:PORT] or pty:/PATH",
            "应写为 /dev/…、tcp:主机:端口、mbtcp:主机[:端口] 或 pty:/路径",
        ],
        NameError::Path => [
            "after pty: comes a path that begins with /",
            "pty: 之后应为以 / 开头的路径",
        ],
        NameError::Host => [
            "write HOST:PORT, an IPv6 address in brackets",
            "应写为 主机:端口，IPv6 地址加方括号",
        ],
        NameError::Port => [
            "the TCP port is a number from 1 to 65535",
            "TCP 端口应为 1 到 65535 的数字",
        ],
    }
}

/// Why a module can't be configured like this.
pub fn setup(lang: Lang, why: SetupError) -> String {
    match (lang, why) {
        (Lang::En, why) => why.to_string(),
        (Lang::Zh, SetupError::Address(low, high)) => format!("该型号的地址应为 {low} 到 {high}"),
        (Lang::Zh, SetupError::Protocol) => "该型号不支持此协议".to_owned(),
        (Lang::Zh, SetupError::Baud) => "该型号没有此波特率".to_owned(),
        (Lang::Zh, SetupError::Character) => "该型号没有此校验方式".to_owned(),
        (Lang::Zh, SetupError::Channels) => "该型号没有这么多通道".to_owned(),
        (Lang::Zh, SetupError::Checksum) => "只有 ASCII 协议有校验和开关".to_owned(),
        (Lang::Zh, SetupError::Family) => "此固件用于其他型号".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_site::Config;

    /// Typical mistakes in the configuration file, run through its real parser.
    #[test]
    fn no_slip_in_toml_is_told_in_english() {
        let mut wrong = Vec::new();
        for (slip, wanted) in [
            ("[line.main", "表头未闭合，应为 `]`"),
            ("a = ", "缺少值，或值有误（文字须加引号）"),
            ("a = hello", "缺少值，或值有误（文字须加引号）"),
            ("a = \"x", "字符串未闭合"),
            ("a = 1 2", "缺少值，或值有误（文字须加引号）"),
            ("a = 1\na = 2", "键重复"),
            ("a", "只有键，缺少 `=` 和值"),
            ("a == 1", "多余的 `=`"),
            ("a = [1, 2", "列表未闭合，应为 `]`"),
            ("a = [1 2]", "缺少值，或值有误（文字须加引号）"),
            ("a = { b = 1", "花括号未闭合，应为 `}`"),
            ("a = 01", "数字不能以 0 开头"),
            ("泵 = 1", "键名中有不允许的字符"),
        ] {
            let problems = Config::parse(slip).expect_err(slip);
            let reason = reason(Lang::Zh, &problems[0].kind);
            if !reason.contains(wanted) || reason.contains("原文") {
                wrong.push(format!("{slip:?}: {reason}"));
            }
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
    }
}
