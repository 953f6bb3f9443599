//! The settings of every outlet at a broker, as they stand in the form.

use crate::northbound::kind::{Field, Pair, Shape};

/// The longest path of a file.
const PATH_MAX: usize = 1_024;

pub(crate) const HOST: Field = Field::new("host", ["Broker", "代理地址"], Shape::Text(253))
    .with_hint([
        "Name or address; 127.0.0.1 if left empty",
        "主机名或地址；留空为 127.0.0.1",
    ]);

pub(crate) const PORT: Field = Field::new("port", ["Port", "端口"], Shape::Number(0, 65_535, 0))
    .with_hint([
        "0 for the usual one: 1883, with TLS 8883",
        "0 表示默认端口：1883，使用 TLS 时为 8883",
    ]);

pub(crate) const TLS: Field = Field::new(
    "tls",
    ["Encryption (TLS)", "加密（TLS）"],
    Shape::Choice(TLS_WORDS),
);

pub(crate) const CA: Field = Field::new(
    "ca",
    ["Authority of the broker", "代理的 CA 证书"],
    Shape::Text(PATH_MAX),
)
.with_hint([
    "File with certificates in PEM on this machine; the authorities of this machine if \
             left empty",
    "本机上的 PEM 证书文件；留空则使用本机信任的 CA",
]);

pub(crate) const CERT: Field = Field::new(
    "cert",
    ["Own certificate", "客户端证书"],
    Shape::Text(PATH_MAX),
)
.with_hint([
    "File in PEM, only if the broker asks for one",
    "PEM 文件，仅在代理要求客户端证书时填写",
]);

pub(crate) const KEY: Field = Field::new(
    "key",
    ["Its private key", "客户端私钥"],
    Shape::Text(PATH_MAX),
)
.with_hint(["File in PEM", "PEM 文件"]);

pub(crate) const USERNAME: Field =
    Field::new("username", ["User name", "用户名"], Shape::Text(256));

pub(crate) const PASSWORD: Field =
    Field::new("password", ["Password", "密码"], Shape::Secret(1, 256)).with_hint([
        "Leave empty to keep. It is never shown again.",
        "留空则不变。保存后不再显示。",
    ]);

pub(crate) const CLIENT_ID: Field =
    Field::new("client_id", ["Client ID", "客户端 ID"], Shape::Text(128)).with_hint([
        "railbus-SITE-NAME if left empty. Every client of a broker has its own",
        "留空为 railbus-站点-名称。同一代理上的客户端 ID 不可重复",
    ]);

pub(crate) const VERSION: Field =
    Field::new("version", ["Version", "协议版本"], Shape::Choice(VERSIONS));

const TLS_WORDS: &[(&str, Pair)] = &[
    (
        "auto",
        ["Unless the broker is on this machine", "代理不在本机时使用"],
    ),
    ("on", ["Always", "始终使用"]),
    (
        "off",
        ["Never: others can read along", "不使用（数据可被他人读取）"],
    ),
];

const VERSIONS: &[(&str, Pair)] = &[
    ("auto", ["5, otherwise 3.1.1", "优先 5，否则 3.1.1"]),
    ("5", ["5", "5"]),
    ("3.1.1", ["3.1.1", "3.1.1"]),
];
