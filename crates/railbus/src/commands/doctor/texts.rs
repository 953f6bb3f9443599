//! The texts of `railbus doctor` besides the table of findings.

railbus_words::texts! {
    pub(crate) DoctorText;

    About {
        en: "Diagnose port, line, modules, configuration, daemon and fleet.",
        zh: "诊断端口、总线、模块、配置、守护进程和站群的问题。",
    }
    Examples {
        en: "  railbus doctor
  railbus doctor -l /dev/ttyUSB0     one port, without a configuration
  railbus doctor D105 --fix          show the commands, then ask",
        zh: "  railbus doctor
  railbus doctor -l /dev/ttyUSB0     只看一个端口，无需配置
  railbus doctor D105 --fix          先显示要执行的命令并询问",
    }
    Code { en: "Only this finding, such as D204 or L012", zh: "只看某一项，如 D204 或 L012" }
    Fix {
        en: "Show the commands that fix it, and run them after confirmation",
        zh: "显示修复命令，确认后执行",
    }
    Yes { en: "Run them without asking", zh: "不询问，直接执行" }

    System { en: "system", zh: "系统" }
    Port { en: "port", zh: "端口" }
    Line { en: "line", zh: "总线" }
    Modules { en: "modules", zh: "模块" }
    Config { en: "config", zh: "配置" }
    Daemon { en: "daemon", zh: "守护进程" }
    Fleet { en: "fleet", zh: "站群" }
    FixLabel { en: "fix:", zh: "处理：" }
    NoDaemon {
        en: "not running; commands open the line themselves",
        zh: "未运行；命令会自行打开总线",
    }
    DaemonRuns { en: "running for {site}, {socket}", zh: "正在运行，配置：{site}，{socket}" }

    FleetGood {
        en: "{socket}: sites online: {sites}, all values current",
        zh: "{socket}：{sites} 个站点在线，数值均为最新",
    }
    FleetEmpty { en: "{socket}: no site has connected yet", zh: "{socket}：尚无站点连接" }
    SiteWith { en: "{site} ({what})", zh: "{site}（{what}）" }
    MoreSites { en: " and {count} more", zh: "，另有 {count} 个" }

    Summary { en: "errors: {errors}, warnings: {warnings}", zh: "错误：{errors}，警告：{warnings}" }
    Unhealthy { en: "the doctor found errors: {errors}", zh: "诊断发现 {errors} 个错误" }
    WouldRun { en: "Fixes:", zh: "修复命令：" }
    Ask { en: "Run them? [y/N]", zh: "执行吗？[y/N]" }
    NothingRun { en: "no command was run", zh: "未执行任何命令" }
    NothingToFix { en: "no automatic fix", zh: "没有可自动修复的问题" }
    NobodyToAsk {
        en: "not run: confirmation needed, but there is no terminal",
        zh: "未执行：没有可供询问的终端",
    }
    Done { en: "done: {command}", zh: "已执行：{command}" }
}
