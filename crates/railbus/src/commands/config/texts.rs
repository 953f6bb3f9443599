//! What the commands of the group say.

use crate::texts::texts;

texts! {
    ConfigText;

    About {
        en: "Shows and changes what modules keep: address, baud, pulses and more.",
        zh: "查看和更改模块保存的设置：地址、波特率、脉冲等。",
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
        en: "The folder of the journal; .railbus beside the configuration if not said",
        zh: "更改日志所在文件夹；默认为配置旁的 .railbus",
    }
    Module { en: "The module", zh: "模块" }
    Modules { en: "The modules; all if none is named", zh: "模块；不写则为全部" }
    Settings { en: "The settings, as config show names them", zh: "设置名，与 config show 所列一致" }
    Pairs {
        en: "address=9, baud=19200, checksum=on, do3.mode=pulse …",
        zh: "address=9、baud=19200、checksum=on、do3.mode=pulse 等",
    }
    Number { en: "The change; the last one if not said", zh: "更改编号；默认为最后一次" }
    DryRun { en: "Shows the frames and writes nothing", zh: "只显示帧，不写入" }
    Yes { en: "Does not ask", zh: "不再询问" }

    ShowAbout { en: "Shows the settings that modules keep now.", zh: "显示模块当前保存的设置。" }
    ShowExamples {
        en: "  railbus config show pump\n  railbus -l /dev/ttyUSB0 -m erc8 -a 3 config show",
        zh: "  railbus config show pump\n  railbus -l /dev/ttyUSB0 -m erc8 -a 3 config show",
    }
    GetAbout { en: "Reads single settings of a module.", zh: "读取模块的单项设置。" }
    GetExamples {
        en: "  railbus config get pump baud -o value",
        zh: "  railbus config get pump baud -o value",
    }
    SetAbout {
        en: "Changes settings of a module: shows them, asks, writes, reads back.",
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
    LogAbout { en: "Shows the journal of changes.", zh: "显示更改日志。" }
    LogExamples {
        en: "  railbus config log\n  railbus config log -o json",
        zh: "  railbus config log\n  railbus config log -o json",
    }
    UndoAbout { en: "Writes the old values of a change back.", zh: "写回某次更改前的原值。" }
    UndoExamples {
        en: "  railbus config undo\n  railbus config undo 14",
        zh: "  railbus config undo\n  railbus config undo 14",
    }
    RecoverAbout {
        en: "Finds a module whose change was cut short, or that has moved. It only reads.",
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
        en: "Writes everything readable of the modules into a file.",
        zh: "将模块所有可读设置写入文件。",
    }
    BackupExamples {
        en: "  railbus config backup -O site.json\n  railbus config backup pump",
        zh: "  railbus config backup -O site.json\n  railbus config backup pump",
    }
    BackupTo {
        en: "The file; stdout if not said. An older one is kept as FILE.1",
        zh: "文件；默认为标准输出。旧文件保留为 FILE.1",
    }
    BackupFile { en: "A file that config backup wrote", zh: "config backup 写成的文件" }
    BackedUp { en: "{count} modules backed up into {file}", zh: "已将 {count} 个模块备份到 {file}" }
    OtherSite { en: "Takes a backup of another site, too", zh: "也接受其他站点的备份" }
    RestoreAbout {
        en: "Writes a backup back, also to a new module at its factory address.",
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
    RestoreMap { en: "What the backup calls OLD is NEW here", zh: "备份中的 OLD 在此为 NEW" }
    DiffAbout { en: "Compares modules with a backup of them.", zh: "比较模块与其备份。" }
    DiffExamples {
        en: "  railbus config diff site.json\n  railbus config diff site.json pump --exit-code",
        zh: "  railbus config diff site.json\n  railbus config diff site.json pump --exit-code",
    }
    ExitCode { en: "Exits with 10 where something differs", zh: "有差异时退出码为 10" }
    NoDifference { en: "nothing differs", zh: "没有差异" }
    HeadBackup { en: "backup", zh: "备份" }
    HeadNow { en: "now", zh: "当前" }

    PlanAbout {
        en: "Compares the modules with what the configuration wants of them.",
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
        en: "Gives the modules the settings that the configuration wants.",
        zh: "按配置设置各模块。",
    }
    ApplyExamples {
        en: "  railbus plan\n  railbus apply --yes -O report.json\n  railbus apply --only pump",
        zh: "  railbus plan\n  railbus apply --yes -O report.json\n  railbus apply --only pump",
    }
    ApplyOnly { en: "Only this module; may be repeated", zh: "只处理该模块；可重复" }
    ApplyReport { en: "Writes what was done into this file, as JSON", zh: "将执行结果以 JSON 写入该文件" }

    CalibrateAbout {
        en: "Calibrates an EMD-2A2Q step by step: zero, then span.",
        zh: "逐步校准 EMD-2A2Q：先校零，再校满。",
    }
    CalibrateExamples {
        en: "  railbus config calibrate tank\n  railbus config calibrate tank --voltage 4.00V",
        zh: "  railbus config calibrate tank\n  railbus config calibrate tank --voltage 4.00V",
    }
    CalibrateVoltage {
        en: "The voltage of the span step; 5.00V if not said",
        zh: "校满电压；默认为 5.00V",
    }
    Before { en: "before", zh: "之前" }
    AfterZero { en: "after zero", zh: "校零后" }
    AfterSpan { en: "after span", zh: "校满后" }
    FactoryAbout {
        en: "Brings an EMD-2A2Q back to its factory settings: address 1, 9600 8N1.",
        zh: "将 EMD-2A2Q 恢复出厂设置：地址 1，9600 8N1。",
    }
    FactoryExamples {
        en: "  railbus config factory tank",
        zh: "  railbus config factory tank",
    }
    FactoryWarning {
        en: "{module} loses its calibration, which can't be brought back, and goes \
            to address 1, 9600 8N1",
        zh: "{module} 将失去校准且无法找回，并回到地址 1、9600 8N1",
    }

    HeadModule { en: "module", zh: "模块" }
    HeadSetting { en: "setting", zh: "设置" }
    HeadValue { en: "value", zh: "值" }
    HeadRange { en: "possible", zh: "可选" }
    HeadNote { en: "note", zh: "说明" }
    HeadChange { en: "change", zh: "更改" }
    HeadTime { en: "time", zh: "时间" }
    HeadWhat { en: "what", zh: "内容" }
    HeadState { en: "state", zh: "状态" }

    NoteWritten { en: "kept in EEPROM; acts after the reply", zh: "存于 EEPROM；应答后生效" }
    NoteAtPowerUp {
        en: "kept in EEPROM; written only within 10 s of power-up, DIP switch at 0",
        zh: "存于 EEPROM；仅在上电 10 秒内、拨码为 0 时可写",
    }
    NoteMaker { en: "only by the maker's software", zh: "只能用厂家软件更改" }
    NoteInit {
        en: "by the INIT* pin: open is ascii, to ground is lc02",
        zh: "由 INIT* 引脚决定：悬空为 ascii，接地为 lc02",
    }
    NoteInAscii { en: "only while the module speaks ascii", zh: "仅在模块使用 ascii 协议时可改" }
    NoteFixed { en: "the family has no other", zh: "该系列仅此一种" }

    Reading { en: "reading the module at {place} …", zh: "正在读取模块（{place}）…" }
    Vacancy { en: "making sure that nobody is at {address} …", zh: "正在确认地址 {address} 空闲 …" }
    Writing { en: "writing, step {step} of {steps} …", zh: "正在写入，第 {step} 步，共 {steps} 步 …" }
    Looking { en: "looking for it at {place} …", zh: "正在查找（{place}）…" }
    PowerCycle {
        en: "switch the board off and on now … {left} s left (Ctrl-C stops)",
        zh: "请立即将该板断电再上电 … 剩余 {left} 秒（Ctrl-C 停止）",
    }
    Calibrating { en: "the module calibrates …", zh: "模块正在校准 …" }
    ZeroReady {
        en: "readings {first} and {second}. Disconnect all analog inputs, then: zero them? [y/N]",
        zh: "当前读数 {first} 和 {second}。请断开所有模拟量输入，然后：校零？[y/N]",
    }
    SpanReady {
        en: "readings {first} and {second}. Connect {voltage} to all analog inputs, \
            then: calibrate? [y/N]",
        zh: "当前读数 {first} 和 {second}。请将 {voltage} 接到所有模拟量输入，然后：校准？[y/N]",
    }
    WithChecksum { en: "checksum", zh: "带校验和" }
    GoOn { en: "Go on? [y/N]", zh: "继续？[y/N]" }
    Frame { en: "frame  {frame}", zh: "帧  {frame}" }
    Writes { en: "EEPROM writes: {count}", zh: "EEPROM 写入次数：{count}" }
    NothingWritten { en: "nothing written", zh: "未写入任何内容" }
    TwoSpeeds {
        en: "after this, {count} other modules on line \"{line}\" stay as they \
            are, and each poll of \"{module}\" costs two changes of speed",
        zh: "此后总线 \"{line}\" 上另有 {count} 个模块保持原设置，每次轮询 \"{module}\" 需切换两次波特率",
    }
    TwoChecksums {
        en: "{count} other ASCII modules keep the other checksum state; it should \
            be the same on the whole line",
        zh: "另有 {count} 个 ASCII 模块的校验和状态不同；整条总线应保持一致",
    }
    Reserved { en: "Modbus reserves the addresses 248 to 255", zh: "Modbus 保留地址 248 至 255" }
    Address85 {
        en: "requests to address 85 (55h) begin like those to the 0x55 boards of this line",
        zh: "发往地址 85（55h）的请求与本总线 0x55 板的帧头相同",
    }
    BoardNeedsPower {
        en: "the board takes it only within 10 s of power-up: you will be asked \
            to switch it off and on; its DIP switch must be at 0",
        zh: "该板仅在上电 10 秒内接受：届时请按提示断电再上电；拨码开关须为 0",
    }
    Written {
        en: "{module}  written, found at {place}, read back equal  journal #{number}",
        zh: "{module}  已写入，位于 {place}，回读一致  日志 #{number}",
    }
    Same {
        en: "{module}  keeps that already, at {place}: nothing written",
        zh: "{module}  已是如此（{place}）：未写入",
    }
    Filed { en: "{file} says so now", zh: "{file} 已更新" }
    NoFile { en: "the module is heard at {place} from now on", zh: "此后模块位于 {place}" }
    WriteByHand {
        en: "write into [module.{module}] that it is at {place}",
        zh: "请在 [module.{module}] 中写明其位于 {place}",
    }
    NotThere { en: "the module is not in it, or not on a line of its own", zh: "其中没有该模块" }
    OpenBefore {
        en: "the end of change #{number} of this module is not known: railbus config recover",
        zh: "该模块的更改 #{number} 结果未知：railbus config recover",
    }
    Borrowed {
        en: "the daemon leaves line \"{line}\" to this command meanwhile",
        zh: "守护进程暂时让出总线 \"{line}\"",
    }
    Daemon {
        en: "a daemon (railbus serve) keeps its lines to itself: stop it for as \
            long as settings are changed",
        zh: "守护进程 (railbus serve) 独占总线：更改设置期间请先停止它",
    }

    CallsItself { en: "it calls itself {name}", zh: "它自称 {name}" }
    NotAsModel { en: "it does not answer as that model does", zh: "其应答与该型号不符" }
    TakenBy { en: "at {place} in {protocol}: {module}", zh: "位于 {place}，协议 {protocol}：{module}" }
    TakenGarbled { en: "the reply was no good one: there may be two", zh: "应答不完整：可能有两个模块" }
    ReadsOtherwise { en: "it acknowledged, and reads back otherwise", zh: "已应答，但回读不一致" }
    NotAcknowledged { en: "nobody acknowledged it", zh: "未得到应答" }

    StateDone { en: "done", zh: "完成" }
    StateIntent { en: "cut short: railbus config recover", zh: "中断：railbus config recover" }
    StatePending { en: "perhaps at the next power-up", zh: "可能下次上电时生效" }
    StateUnchanged { en: "not taken, unchanged", zh: "未接受，未改变" }
    StateRolledBack { en: "taken back", zh: "已恢复原值" }
    StateElsewhere { en: "keeps neither the old nor all of the new values", zh: "既非原值也非全部新值" }
    StateLost { en: "not found: railbus config recover", zh: "找不到：railbus config recover" }
    StateUntold { en: "not known: the module does not tell", zh: "未知：模块不提供该信息" }
    Unread { en: "{count} torn lines were passed over", zh: "跳过 {count} 行不完整记录" }
    NothingOpen { en: "no change is open: nothing to recover", zh: "没有未完成的更改：无需恢复" }
    NobodyAt {
        en: "no module of the configuration has address {addr}; two modules there: switch one of \
            them off, or connect one at a time; then railbus scan --add, and \
            railbus config set MODULE address=FREE",
        zh: "配置中没有地址为 {addr} 的模块；若该地址上有两个模块：请关闭其中一个，或逐个接入；\
            然后执行 railbus scan --add 和 railbus config set 模块 address=空闲地址",
    }
    RecoveredNew { en: "found; the change was carried out", zh: "已找到；更改已完成" }
    RecoveredOld { en: "found; the change was not carried out", zh: "已找到；更改未执行" }
    InPlace { en: "found in its place", zh: "在原位找到" }
    FoundElsewhere { en: "found in another place", zh: "在其他位置找到" }
    PartBoards {
        en: "to part two boards: take one off the line; railbus config set {module} \
            address=FREE, and switch the other off and on when asked; then connect the \
            first again, it is alone at {address}",
        zh: "分开两块板：将其中一块从总线断开；执行 railbus config set {module} address=空闲地址，\
            按提示将另一块断电再上电；然后接回第一块，地址 {address} 上只剩它",
    }
    PartByPin {
        en: "to part two: ground INIT* of one of them, which then speaks lc02 and \
            leaves the other alone at {address}; railbus config set {module} address=FREE; \
            then open INIT* again",
        zh: "分开两个模块：将其中一个的 INIT* 接地，它改用 lc02，地址 {address} \
            上只剩另一个；执行 railbus config set {module} address=空闲地址；然后断开 \
            INIT*",
    }
    PartByPlug {
        en: "to part two: unplug one of them; railbus config set {module} address=FREE; \
            then plug it in again, it is alone at {address}",
        zh: "分开两个模块：拔下其中一个；执行 railbus config set {module} address=空闲地址；然后重新插上，地址 {address} 上只剩它",
    }
}
