//! The texts of `railbus bench`.

railbus_words::texts! {
    pub(crate) BenchText;

    About {
        en: "Measure how many reads per second a line carries. Read-only.",
        zh: "测量总线每秒可完成的读取次数，只读取。",
    }
    Examples {
        en: "  railbus bench -l main --time 30s
  railbus bench -l /dev/ttyUSB0 -m erc8 -a 3",
        zh: "  railbus bench -l main --time 30s
  railbus bench -l /dev/ttyUSB0 -m erc8 -a 3",
    }
    Daemon {
        en: "the daemon of {site} has the line: stop it while you measure",
        zh: "总线由守护进程占用（配置：{site}）：测量期间请先停止它",
    }
    Time { en: "Duration; default 10s", zh: "时长；默认 10s" }
    Head {
        en: "MODULE|PROTOCOL|N|P50|P99|MAX|WIRE|BAD",
        zh: "模块|协议|次数|P50|P99|最长|线路|失败",
    }
    Summary {
        en: "{line}: {rate} reads/s, line busy {busy} %; {theory}/s at {settings} if modules \
replied at once",
        zh: "{line}：每秒读取 {rate} 次，总线占用 {busy} %；{settings} 下若模块立即应答可达每秒 {theory} 次",
    }
}
