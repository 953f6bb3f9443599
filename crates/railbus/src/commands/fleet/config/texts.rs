//! The texts of the configurations of far sites.

railbus_words::texts! {
    pub(crate) SiteConfigText;

    About {
        en: "Show how far the configuration of a site is, or give it another one: it tries that \
            for two minutes, and takes it back unless it works as before. Integrations, \
            history, audit, ports and webhooks are the site's own, and stay as they are there.",
        zh: "查看站点的配置，或用 FILE 下发新配置：站点试用两分钟，异常则恢复原配置；其中不含 \
            history、audit、ports、webhooks 和集成，它们由站点自己设置。",
    }
    Examples {
        en: "  railbus fleet config plant7
  railbus fleet config plant7 --text > plant7.toml
  railbus fleet config plant7 plant7.toml
  railbus fleet config plant7 plant7.toml --replace 1a2b3c4d",
        zh: "  railbus fleet config plant7
  railbus fleet config plant7 --text > plant7.toml
  railbus fleet config plant7 plant7.toml
  railbus fleet config plant7 plant7.toml --replace 1a2b3c4d",
    }
    File {
        en: "What its file is to say, without what is its own; - for standard input",
        zh: "要下发的配置文件，不含站点自己设置的部分；- 表示标准输入",
    }
    Now { en: "Print what the site has now", zh: "输出站点当前的配置" }
    Newest { en: "Print what the centre gave it last", zh: "输出中心最近一次下发的配置" }
    Replace {
        en: "Replace what the site has if this is its hash, also if the centre did not make it; \
            8 digits are enough",
        zh: "站点现有配置的哈希为此值时将其替换；前 8 位即可",
    }
    HashNote {
        en: "to replace this text: railbus fleet config {site} FILE --replace {hash}",
        zh: "替换此配置：railbus fleet config {site} 文件 --replace {hash}",
    }
    BadHash { en: "a hash has 8 to 64 of 0-9 and a-f", zh: "哈希为 8 到 64 位 0-9 和 a-f" }
    RowHash { en: "hash", zh: "哈希" }
    NoWait { en: "Don't wait for what becomes of it", zh: "不等待结果" }
    NoneWanted {
        en: "the centre has given {site} no configuration so far",
        zh: "中心尚未向 {site} 下发过配置",
    }
    RowGiven { en: "given", zh: "最近下发" }
    Given { en: "version {version} by {user}, {at}", zh: "版本 {version}，{user}，{at}" }
    NoneGiven { en: "none so far", zh: "尚未下发" }
    RowState { en: "state", zh: "状态" }
    RowKept { en: "kept", zh: "已保留" }
    RowHeard { en: "heard", zh: "最近心跳" }
    RowWhy { en: "why", zh: "原因" }
    Version { en: "version {version}", zh: "版本 {version}" }
    Unmanaged { en: "the centre has given it none", zh: "中心尚未下发过配置" }
    Current { en: "version {version} is kept", zh: "版本 {version} 已保留" }
    Pending { en: "version {version} waits", zh: "版本 {version} 等待中" }
    Trying {
        en: "version {version} is being tried ({seconds} s)",
        zh: "版本 {version} 试用中（{seconds} 秒）",
    }
    Refused { en: "version {version} was refused", zh: "版本 {version} 被站点拒绝" }
    RolledBack {
        en: "version {version} was taken back",
        zh: "版本 {version} 已撤回，恢复了先前的配置",
    }
    LocalChange {
        en: "changed at the site since version {version} was kept",
        zh: "版本 {version} 保留后，配置在站点本地更改过",
    }
    Interrupted {
        en: "changed at the site while version {version} was tried",
        zh: "试用版本 {version} 期间，配置在站点本地更改过",
    }
    OtherPhase { en: "not known to this version of railbus", zh: "本版本 railbus 无法识别" }
    TakesNone { en: "takes no configuration from the centre", zh: "不接受中心下发的配置" }
    NotHeard { en: "not known: it is not online", zh: "未知：站点不在线" }
    NotTheCentres {
        en: "what it has was not made by the centre",
        zh: "站点现有配置不是由中心下发的",
    }
    Kept { en: "{site} keeps version {version}", zh: "{site} 已保留版本 {version}" }
    Sent { en: "version {version} was given to {site}", zh: "已向 {site} 下发版本 {version}" }
    TriedNow {
        en: "{site} tries version {version} for {seconds} s; Ctrl-C leaves it to go on",
        zh: "{site} 正在试用版本 {version}，共 {seconds} 秒；Ctrl-C 只结束等待",
    }
    Waits {
        en: "version {version} waits at {site}: {why}",
        zh: "版本 {version} 在 {site} 等待：{why}",
    }
    NotBegun {
        en: "{site} has version {version}, and has not begun to try it yet",
        zh: "{site} 已收到版本 {version}，尚未开始试用",
    }
    Away {
        en: "{site} is away: it tries version {version} when it comes",
        zh: "{site} 不在线：上线后试用版本 {version}",
    }
    Gone { en: "{site} is away now; waiting for it", zh: "{site} 暂时不在线，等待其恢复" }
    GoesOn {
        en: "it may go on: railbus fleet config {site} shows it",
        zh: "可能仍在进行：用 railbus fleet config {site} 查看",
    }
    Overtaken {
        en: "version {version} was followed by version {newer}",
        zh: "版本 {version} 之后又下发了版本 {newer}",
    }
    Key {
        en: "Print the public key by which sites know a configuration of this centre, config_key \
            of their integration; a fleet that has none gets one.",
        zh: "输出站点用于验证中心配置的公钥，即其集成的 config_key；站群尚无密钥时生成。",
    }
    KeyMade {
        en: "the key is new: the centre signs with it from now on, and tells it to invited sites \
            once it is started again",
        zh: "已生成新密钥：中心今后用它签名；重启中心后，会将公钥告知受邀站点",
    }
}
