//! Rights, differences, and ends that are no faults: exit codes from 9 on.

use super::{Code, codes};

codes! {
    Forbidden = "E0901" {
        title: ["the daemon does not take this from there", "守护进程不接受来自该处的请求"],
        likely: ["a request from another machine or page", "请求来自其他机器或网页"],
        next: ["ask on the daemon's own machine", "请在守护进程所在机器上操作"],
    }
    NotLoopback = "E0903" {
        title: ["will not listen beyond this machine without TLS and a user",
            "没有 TLS 和用户时不向其他机器开放"],
        likely: ["--listen names an address that others can reach", "--listen 的地址可被其他机器访问"],
        next: ["use 127.0.0.1 and a tunnel such as ssh -L", "使用 127.0.0.1，并通过 ssh -L 等隧道访问"],
    }
    PointRight = "E0906" {
        title: ["this point is none of those that you may switch", "您无权操作该点"],
        likely: ["the user or the token is limited to some points", "该用户或令牌只限于部分点"],
        next: ["ask an administrator: railbus user list", "请联系管理员：railbus user list"],
    }
    Differs = "E1001" {
        title: ["differences were found", "发现差异"],
        likely: ["the modules' settings are not those wanted", "模块设置与期望不同"],
        next: ["look at the list of differences", "查看差异列表"],
    }
    RepliesDiffer = "E1080" {
        title: ["replies are other than recorded", "应答与记录不同"],
        likely: ["inputs changed since · another module or firmware", "输入已变化 · 模块或固件不同"],
        next: ["railbus replay FILE --as-host -o ndjson", "railbus replay 文件 --as-host -o ndjson"],
    }
    Partial = "E1101" {
        title: ["some of several targets failed", "多个目标中部分失败"],
        likely: ["see each of them", "见各目标的说明"],
        next: ["railbus ls", "railbus ls"],
    }
    ScanTimeUp = "E1170" {
        title: ["the time was up before all were asked", "时间已到，扫描未完成"],
        likely: ["--max-time is shorter than the scan", "--max-time 短于扫描所需时间"],
        next: ["railbus scan --resume, with the same options", "railbus scan --resume，选项相同"],
    }
    Interrupted = "E13001" {
        title: ["interrupted", "已中断"],
        likely: ["Ctrl-C", "按下了 Ctrl-C"],
        next: ["railbus get --fresh     shows how the outputs are",
            "railbus get --fresh     查看输出状态"],
    }
}
