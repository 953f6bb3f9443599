//! Texts of this crate, and of those above it that share them, in both languages side by side.

railbus_words::texts! {
    pub AppText;

    Error { en: "error[{code}]: {message}", zh: "错误[{code}]：{message}" }
    Why { en: "why:", zh: "原因：" }
    Try { en: "try:", zh: "可试：" }
    Likely { en: "likely:", zh: "可能：" }
    More { en: "more:", zh: "详见：" }
    Named { en: "{title}: {name}", zh: "{title}：{name}" }
    Comma { en: ", ", zh: "，" }
    FromNobody {
        en: "no reply from module \"{module}\" ({at})",
        zh: "模块 \"{module}\" 无应答（{at}）",
    }
    RefusedBy { en: "module \"{module}\" refused ({at})", zh: "模块 \"{module}\" 拒绝执行（{at}）" }
    GarbledBy {
        en: "garbled reply from module \"{module}\" ({at})",
        zh: "模块 \"{module}\" 的应答损坏（{at}）",
    }
    NotVerifiedAt {
        en: "not verified: {point} was acknowledged but reads back differently",
        zh: "回读不一致：{point} 已应答，但回读的状态与命令不同",
    }
    OnlyGarbled {
        en: "no valid reply from {module}: {lost}",
        zh: "{module} 没有有效应答：{lost}",
    }
    Lost {
        en: "requests: {attempts}, garbled replies: {garbled}, bytes: {bytes} ({why})",
        zh: "请求 {attempts} 次，应答损坏 {garbled} 次，共 {bytes} 字节（{why}）",
    }
    ChannelDoubtful {
        en: "the board answers, but not for {point}: does it have that many relays? See outputs of \
            {module}",
        zh: "此板有应答，但 {point} 无响应：是否有这么多路继电器？请核对 {module} 的 outputs",
    }
    ModbusException { en: "Modbus exception {why}", zh: "Modbus 异常码 {why}" }
    AtAddress { en: "address {address}", zh: "地址 {address}" }
    OnLine { en: "line {line}", zh: "总线 {line}" }
    HeardNothing {
        en: "attempts: {attempts}; bytes received: {bytes} (silent, no noise)",
        zh: "尝试次数：{attempts}；收到 {bytes} 字节：总线静默，无干扰",
    }
    HeardHalf {
        en: "attempts: {attempts}; bytes received: {bytes} (no valid reply to this request)",
        zh: "尝试次数：{attempts}；收到 {bytes} 字节，没有对此请求的有效应答",
    }
    HeardBytes {
        en: "attempts: {attempts}; bytes received: {bytes} (not a valid reply)",
        zh: "尝试次数：{attempts}；收到 {bytes} 字节，不是有效应答",
    }
    AnswersAs {
        en: "the module reports {found}; the configuration says {model}",
        zh: "模块报告的型号为 {found}，配置中为 {model}",
    }
    HeldBy { en: "held by {holder}", zh: "占用者：{holder}" }
    OfGroup { en: "the port belongs to the group {group}", zh: "端口属于用户组 {group}" }
    DidYouMean { en: "did you mean {name}?", zh: "是否指 {name}？" }
    Known { en: "known: {names}", zh: "已知：{names}" }
    MayHaveActed {
        en: "the command may still have taken effect; look before repeating",
        zh: "命令可能已生效，重复前请先查看实际状态",
    }
    On { en: "on", zh: "接通" }
    Off { en: "off", zh: "断开" }
    Good { en: "good", zh: "有效" }
    Stale { en: "stale", zh: "过期" }
    Bad { en: "bad", zh: "无效" }
    OfflineValue { en: "offline", zh: "离线" }
    NeverRead { en: "never read", zh: "从未读到" }
    LineAbsent { en: "port missing", zh: "端口不存在" }
    LineBusy { en: "port in use by another program", zh: "端口被其他程序占用" }
    LineLent { en: "line busy (settings being changed)", zh: "总线忙（正在更改设置）" }
    LineShut { en: "line closed", zh: "总线已关闭" }
    Online { en: "online", zh: "在线" }
    Offline { en: "offline", zh: "离线" }
    Unheard { en: "not heard yet", zh: "尚未应答" }
    OtherModel { en: "other model", zh: "型号不符" }
    ReadBack { en: "read back", zh: "已回读" }
    Acknowledged { en: "acknowledged", zh: "已应答" }
    SentOnly { en: "sent (this command has no reply)", zh: "已发送（此命令无应答）" }
    TheDemo { en: "the demo", zh: "演示站点" }
    CantServe { en: "can't serve the line", zh: "无法提供总线服务" }
    NoLink { en: "can't make the link {path} to the PTY", zh: "无法创建指向 PTY 的链接 {path}" }
    NoPty { en: "can't make a PTY", zh: "无法创建 PTY" }
    NoTcp { en: "can't listen on TCP {address}", zh: "无法监听 TCP {address}" }
    ForeignPath {
        en: "{path} exists and is not a link to a PTY; left unchanged",
        zh: "{path} 已存在且不是 PTY 链接，未作改动",
    }
}
