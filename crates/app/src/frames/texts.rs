//! The texts about frames.

railbus_words::texts! {
    pub(crate) FrameText;

    NoReplyIn { en: "no reply in {time} ms", zh: "{time} 毫秒内无应答" }
    NoProtocol { en: "{count} bytes, no protocol fits", zh: "{count} 字节，没有协议能接受" }
    Late { en: ", late", zh: "，迟到" }
    OrElse { en: "; or {protocol}: {meaning}", zh: "；或 {protocol}：{meaning}" }
    BareException {
        en: "refused: exception {code}, sent without CRC",
        zh: "被拒绝：异常码 {code}，未带 CRC",
    }
    UnknownCommand { en: "unknown command", zh: "未知命令" }
    UnknownFunction { en: "unknown function {code}h", zh: "未知功能码 {code}h" }
    WrongChecksum { en: "wrong checksum {is}, should be {should}", zh: "校验和 {is} 错误，应为 {should}" }
    NoChecksum { en: "no checksum, although the request had one", zh: "缺少请求所带的校验和" }
    CutShort { en: "incomplete, {count} bytes", zh: "仅 {count} 字节，不完整" }
    NotAsAsked { en: "does not match the request", zh: "与请求不符的应答" }
}
