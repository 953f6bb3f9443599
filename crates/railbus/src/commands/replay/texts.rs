//! What `replay` says.

crate::texts::texts! {
    ReplayText;

    ReplayAbout {
        en: "Plays a capture file again: its modules, or its host.",
        zh: "重放抓包文件：充当其中的模块或上位机。",
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
        en: "The capture file; of several lines the first one is played",
        zh: "抓包文件；有多条总线时取第一条",
    }
    AsModule {
        en: "Answers requests as they were answered then, byte by byte and in the same time",
        zh: "按记录应答请求，字节和时间均相同",
    }
    AsHost {
        en: "Sends the requests again and compares the replies; reads only",
        zh: "重发请求并比较应答；仅读取",
    }
    Speed { en: "So many times as fast; 1 if not said", zh: "倍速；默认 1" }
    Loop { en: "Begins anew at the end", zh: "结束后从头开始" }
    Count { en: "Ends after so many requests answered", zh: "应答若干请求后结束" }
    Writes {
        en: "As host: sends also what switches outputs; wants --yes",
        zh: "作上位机：也发送控制输出的请求；需加 --yes",
    }
    Yes { en: "Does not ask about writes", zh: "写入不再询问" }
    Confirm {
        en: "The word \"broadcast\" sends also what is for all modules, \"config\" what they keep",
        zh: "输入 broadcast 才发送广播，输入 config 才更改模块设置",
    }
    ExitCode {
        en: "Exits with 10 where a reply is another than recorded",
        zh: "应答与记录不同时退出码为 10",
    }
    Answering {
        en: "{count} different requests are answered on {port}",
        zh: "在 {port} 上应答 {count} 种请求",
    }
    Silent { en: "silence", zh: "无应答" }
    Same { en: "same: {then}", zh: "相同：{then}" }
    Differs { en: "differs: {now}, recorded {then}", zh: "不同：{now}，记录为 {then}" }
    NowSilent { en: "differs: silence, recorded {then}", zh: "不同：无应答，记录为 {then}" }
    Skipped {
        en: "not sent: no read, not known, or another protocol's command, too",
        zh: "未发送：不是读取、未知，或同时是其他协议的命令",
    }
    Summary {
        en: "{same} the same, {differ} different, {skipped} not sent",
        zh: "{same} 个相同，{differ} 个不同，{skipped} 个未发送",
    }
    TooLong { en: "more than 100000 requests in the file", zh: "文件中的请求超过 100000 个" }
    NothingToPlay { en: "no request in the file", zh: "文件中没有请求" }
    NeedsYesWrites {
        en: "not sent: --writes switches outputs as they were switched then",
        zh: "未发送：--writes 会按记录控制输出",
    }
}
