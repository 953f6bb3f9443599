//! The texts of `replay`.

railbus_words::texts! {
    pub(crate) ReplayText;

    ReplayAbout {
        en: "Replay a capture file, as its modules or as its host.",
        zh: "重放抓包文件：充当其中的模块或主站。",
    }
    ReplayExamples {
        en: "  railbus replay night.pcapng --as-module -l pty:/tmp/v0
  railbus replay night.pcapng --as-host -l main --exit-code
  railbus replay night.pcapng --as-host -l main --writes --yes",
        zh: "  railbus replay night.pcapng --as-module -l pty:/tmp/v0
  railbus replay night.pcapng --as-host -l main --exit-code
  railbus replay night.pcapng --as-host -l main --writes --yes",
    }
    File {
        en: "Capture file; of several lines the first one is used",
        zh: "抓包文件；有多条总线时取第一条",
    }
    AsModule {
        en: "Reply as recorded, with the same bytes and timing",
        zh: "按记录应答请求，字节和时间均相同",
    }
    AsHost {
        en: "Send the requests again and compare the replies; reads only",
        zh: "重发请求并比较应答；仅读取",
    }
    Speed { en: "Speed factor; default 1", zh: "倍速；默认 1" }
    Loop { en: "Start again at the end", zh: "结束后从头开始" }
    Count { en: "Stop after this many replies", zh: "应答若干请求后结束" }
    Writes {
        en: "As host: also replay writes (requires --yes)",
        zh: "作主站：也发送控制输出的请求；需加 --yes",
    }
    Yes { en: "Do not ask about writes", zh: "写入不再询问" }
    Confirm {
        en: "broadcast also sends broadcasts, config also changes settings",
        zh: "输入 broadcast 才发送广播，输入 config 才更改模块设置",
    }
    ExitCode {
        en: "Exit with 10 if a reply differs from the recording",
        zh: "应答与记录不同时退出码为 10",
    }
    Answering {
        en: "replying on {port}; different requests: {count}",
        zh: "在 {port} 上应答 {count} 种请求",
    }
    Silent { en: "silence", zh: "无应答" }
    Same { en: "same: {then}", zh: "相同：{then}" }
    Differs { en: "differs: {now}, recorded {then}", zh: "不同：{now}，记录为 {then}" }
    NowSilent { en: "differs: silence, recorded {then}", zh: "不同：无应答，记录为 {then}" }
    Skipped {
        en: "not sent: not a read, unknown, or also a command of another protocol",
        zh: "未发送：不是读取、未知，或同时是其他协议的命令",
    }
    Summary {
        en: "same: {same}, different: {differ}, not sent: {skipped}",
        zh: "{same} 个相同，{differ} 个不同，{skipped} 个未发送",
    }
    TooLong { en: "more than 100000 requests in the file", zh: "文件中的请求超过 100000 个" }
    NothingToPlay { en: "no request in the file", zh: "文件中没有请求" }
    NeedsYesWrites {
        en: "not sent: --writes switches outputs as recorded",
        zh: "未发送：--writes 会按记录控制输出",
    }
}
