//! The texts of `railbus config`.

use railbus_words::texts;

texts! {
    pub(crate) ConfigText;

    About {
        en: "Show and change module settings: address, baud, pulses and more.",
        zh: "查看和更改模块的设置：地址、波特率、点动等。",
    }
    Examples {
        en: "  railbus config show pump\n\
            \x20\x20railbus config set pump address=9 baud=19200\n\
            \x20\x20railbus config log",
        zh: "  railbus config show pump\n\
            \x20\x20railbus config set pump address=9 baud=19200\n\
            \x20\x20railbus config log",
    }
    StateFlag {
        en: "Folder of the journal; default .railbus beside the configuration",
        zh: "更改日志所在文件夹；默认为配置旁的 .railbus",
    }
    Module { en: "The module", zh: "模块" }
    Modules { en: "The modules; default all", zh: "模块；不写则为全部" }
    Settings { en: "The settings, as config show names them", zh: "设置名，与 config show 所列一致" }
    Pairs {
        en: "address=9, baud=19200, checksum=on, do3.mode=pulse …",
        zh: "address=9、baud=19200、checksum=on、do3.mode=pulse 等",
    }
    Number { en: "Change number; default the last one", zh: "更改编号；默认为最后一次" }
    DryRun { en: "Show the frames, write nothing", zh: "只显示报文，不写入" }
    Yes { en: "Do not ask", zh: "不再询问" }

    ShowAbout { en: "Show the current settings of modules.", zh: "显示模块当前保存的设置。" }
    ShowExamples {
        en: "  railbus config show pump\n  railbus -l /dev/ttyUSB0 -m erc8 -a 3 config show",
        zh: "  railbus config show pump\n  railbus -l /dev/ttyUSB0 -m erc8 -a 3 config show",
    }
    GetAbout { en: "Read single settings of a module.", zh: "读取模块的单项设置。" }
    GetExamples {
        en: "  railbus config get pump baud -o value",
        zh: "  railbus config get pump baud -o value",
    }
    SetAbout {
        en: "Change settings of a module: show, ask, write, read back.",
        zh: "更改模块设置：显示差异、询问、写入、回读。",
    }
    SetExamples {
        en: "  railbus config set pump address=9 baud=19200\n\
            \x20\x20railbus config set pump do3.mode=pulse pulse_width=0.7s\n\
            \x20\x20railbus config set -l main checksum=on\n\
            \x20\x20railbus -l /dev/ttyUSB0 -m erc8 -a 1 config set erc8 address=3",
        zh: "  railbus config set pump address=9 baud=19200\n\
            \x20\x20railbus config set pump do3.mode=pulse pulse_width=0.7s\n\
            \x20\x20railbus config set -l main checksum=on\n\
            \x20\x20railbus -l /dev/ttyUSB0 -m erc8 -a 1 config set erc8 address=3",
    }
    LogAbout { en: "Show the journal of changes.", zh: "显示更改日志。" }
    LogExamples {
        en: "  railbus config log\n  railbus config log -o json",
        zh: "  railbus config log\n  railbus config log -o json",
    }
    UndoAbout { en: "Undo a change: write the old values back.", zh: "写回某次更改前的原值。" }
    UndoExamples {
        en: "  railbus config undo\n  railbus config undo 14",
        zh: "  railbus config undo\n  railbus config undo 14",
    }
    RecoverAbout {
        en: "Find a module whose change was interrupted, or that has moved. Read-only.",
        zh: "查找更改中断或不在原位的模块，只读取。",
    }
    RecoverExamples {
        en: "  railbus config recover\n\
            \x20\x20railbus config recover pump\n\
            \x20\x20railbus config recover --addr 7",
        zh: "  railbus config recover\n\
            \x20\x20railbus config recover pump\n\
            \x20\x20railbus config recover --addr 7",
    }
    RecoverAddr {
        en: "The modules that the configuration has at this address",
        zh: "配置中位于该地址的模块",
    }

    BackupAbout {
        en: "Save all readable settings of the modules to a file.",
        zh: "将模块所有可读设置写入文件。",
    }
    BackupExamples {
        en: "  railbus config backup -O site.json\n  railbus config backup pump",
        zh: "  railbus config backup -O site.json\n  railbus config backup pump",
    }
    BackupTo {
        en: "File; default stdout. An older one is kept as FILE.1",
        zh: "文件；默认为标准输出。旧文件保留为 FILE.1",
    }
    BackupFile { en: "A file that config backup wrote", zh: "config backup 写成的文件" }
    BackedUp { en: "backed up to {file}; modules: {count}", zh: "已将 {count} 个模块备份到 {file}" }
    OtherSite { en: "Accept a backup of another site", zh: "也接受其他站点的备份" }
    RestoreAbout {
        en: "Restore a backup, also to a new module at its factory address.",
        zh: "写回备份；新模块在出厂地址处查找。",
    }
    RestoreExamples {
        en: "  railbus config restore site.json -n\n\
            \x20\x20railbus config restore site.json --module pump\n\
            \x20\x20railbus config restore site.json --map pump=pump2",
        zh: "  railbus config restore site.json -n\n\
            \x20\x20railbus config restore site.json --module pump\n\
            \x20\x20railbus config restore site.json --map pump=pump2",
    }
    RestoreModule { en: "Only this module; may be repeated", zh: "只恢复该模块；可重复" }
    RestoreMap { en: "The backup's module OLD is called NEW here", zh: "备份中的 OLD 在此为 NEW" }
    DiffAbout { en: "Compare modules with their backup.", zh: "比较模块与其备份。" }
    DiffExamples {
        en: "  railbus config diff site.json\n  railbus config diff site.json pump --exit-code",
        zh: "  railbus config diff site.json\n  railbus config diff site.json pump --exit-code",
    }
    ExitCode { en: "Exit with 10 if something differs", zh: "有差异时退出码为 10" }
    NoDifference { en: "no differences", zh: "没有差异" }
    HeadBackup { en: "BACKUP", zh: "备份" }
    HeadNow { en: "NOW", zh: "当前" }

    PlanAbout {
        en: "Compare the modules with the configuration.",
        zh: "比较模块的设置与配置的要求。",
    }
    PlanExamples {
        en: "  railbus plan\n  railbus plan --exit-code -o json",
        zh: "  railbus plan\n  railbus plan --exit-code -o json",
    }
    PlanMissing { en: "not found on line {line} ({place})", zh: "在总线 {line} 上找不到（{place}）" }
    PlanSum {
        en: "{change} to change, {missing} missing, {same} unchanged, {unclear} unclear",
        zh: "待更改 {change}，缺失 {missing}，不变 {same}，不明 {unclear}",
    }
    ApplyAbout {
        en: "Write the settings of the configuration to the modules.",
        zh: "按配置设置各模块。",
    }
    ApplyExamples {
        en: "  railbus plan\n  railbus apply --yes -O report.json\n  railbus apply --only pump",
        zh: "  railbus plan\n  railbus apply --yes -O report.json\n  railbus apply --only pump",
    }
    ApplyOnly { en: "Only this module; may be repeated", zh: "只处理该模块；可重复" }
    ApplyReport { en: "Write the result to this file as JSON", zh: "将执行结果以 JSON 写入该文件" }

    CalibrateAbout {
        en: "Calibrate an EMD-2A2Q step by step: zero, then span.",
        zh: "逐步校准 EMD-2A2Q：先校零，再校满。",
    }
    CalibrateExamples {
        en: "  railbus config calibrate tank\n  railbus config calibrate tank --voltage 4.00V",
        zh: "  railbus config calibrate tank\n  railbus config calibrate tank --voltage 4.00V",
    }
    CalibrateVoltage {
        en: "Voltage of the span step; default 5.00V",
        zh: "校满电压；默认为 5.00V",
    }
    Before { en: "BEFORE", zh: "之前" }
    AfterZero { en: "AFTER ZERO", zh: "校零后" }
    AfterSpan { en: "AFTER SPAN", zh: "校满后" }
    FactoryAbout {
        en: "Reset an EMD-2A2Q to factory settings: address 1, 9600 8N1.",
        zh: "将 EMD-2A2Q 恢复出厂设置：地址 1，9600 8N1。",
    }
    FactoryExamples {
        en: "  railbus config factory tank",
        zh: "  railbus config factory tank",
    }
    FactoryWarning {
        en: "{module} loses its calibration, permanently, and goes \
            to address 1, 9600 8N1",
        zh: "{module} 将失去校准且无法找回，并回到地址 1、9600 8N1",
    }

    HeadModule { en: "MODULE", zh: "模块" }
    HeadSetting { en: "SETTING", zh: "设置" }
    HeadValue { en: "VALUE", zh: "值" }
    HeadRange { en: "ALLOWED", zh: "可选" }
    HeadNote { en: "NOTE", zh: "说明" }
    HeadChange { en: "CHANGE", zh: "更改" }
    HeadTime { en: "TIME", zh: "时间" }
    HeadWhat { en: "WHAT", zh: "内容" }
    HeadState { en: "STATE", zh: "状态" }

    Reading { en: "reading the module at {place} …", zh: "正在读取模块（{place}）…" }
    Vacancy { en: "checking that {address} is free …", zh: "正在确认地址 {address} 空闲 …" }
    Writing { en: "writing, step {step} of {steps} …", zh: "正在写入，第 {step} 步，共 {steps} 步 …" }
    Looking { en: "looking for it at {place} …", zh: "正在查找（{place}）…" }
    PowerCycle {
        en: "power-cycle the board now … {left} s left (Ctrl-C stops)",
        zh: "请立即将该板断电再上电 … 剩余 {left} 秒（Ctrl-C 停止）",
    }
    Calibrating { en: "the module is calibrating …", zh: "模块正在校准 …" }
    ZeroReady {
        en: "readings {first} and {second}. Disconnect all analog inputs. Zero now? [y/N]",
        zh: "当前读数 {first} 和 {second}。请断开所有模拟量输入。现在校零？[y/N]",
    }
    SpanReady {
        en: "readings {first} and {second}. Connect {voltage} to all analog inputs. \
            Calibrate now? [y/N]",
        zh: "当前读数 {first} 和 {second}。请将 {voltage} 接到所有模拟量输入。现在校准？[y/N]",
    }
    GoOn { en: "Continue? [y/N]", zh: "继续？[y/N]" }
    Frame { en: "frame  {frame}", zh: "报文  {frame}" }
    Writes { en: "EEPROM writes: {count}", zh: "EEPROM 写入次数：{count}" }
    Written {
        en: "{module}  written and verified at {place}  journal #{number}",
        zh: "{module}  已写入并回读一致（{place}）  日志 #{number}",
    }
    Same {
        en: "{module}  unchanged, at {place}: nothing written",
        zh: "{module}  无需更改（{place}）：未写入",
    }
    Filed { en: "updated {file}", zh: "已更新 {file}" }
    NoFile { en: "the module is now at {place}", zh: "此后模块位于 {place}" }
    NotThere { en: "the module is not in it, or is written in another form", zh: "其中没有该模块" }
    OpenBefore {
        en: "the result of change #{number} of this module is unknown: railbus config recover",
        zh: "该模块的更改 #{number} 结果未知：railbus config recover",
    }
    Borrowed {
        en: "polling of line \"{line}\" pauses during this command",
        zh: "命令执行期间暂停轮询总线 \"{line}\"",
    }
    Daemon {
        en: "a daemon (railbus serve) owns its lines: stop it while \
            settings are changed",
        zh: "守护进程 (railbus serve) 独占总线：更改设置期间请先停止它",
    }
    Unread { en: "incomplete journal lines skipped: {count}", zh: "跳过 {count} 行不完整记录" }
    NothingOpen { en: "no unfinished change: nothing to recover", zh: "没有未完成的更改：无需恢复" }
    NobodyAt {
        en: "no module of the configuration has address {addr}; if two modules are there, \
            switch one \
            of them off, or connect one at a time; then railbus scan --add, and \
            railbus config set MODULE address=FREE",
        zh: "配置中没有地址为 {addr} 的模块；若该地址上有两个模块：请关闭其中一个，或逐个接入；\
            然后执行 railbus scan --add 和 railbus config set 模块 address=空闲地址",
    }
    RecoveredNew { en: "found; the change is complete", zh: "已找到；更改已完成" }
    RecoveredOld { en: "found; the change was not made", zh: "已找到；更改未执行" }
    InPlace { en: "found at its address", zh: "在配置的地址找到" }
    FoundElsewhere { en: "found at another address", zh: "在其他位置找到" }
}
