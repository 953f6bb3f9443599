//! The texts of all commands, in both languages side by side. Texts of a single command are in a
//! catalogue of its own, in its folder.

railbus_words::texts! {
    pub(crate) Text;

    // Headings and flags of every command.
    About {
        en: "Control RS-485 I/O modules, or simulate them.",
        zh: "控制 RS-485 输入输出模块，也可仿真这些模块。",
    }
    Examples { en: "Examples:", zh: "示例：" }
    Usage { en: "Usage: ", zh: "用法：" }
    Options { en: "Options", zh: "选项" }
    Commands { en: "Commands", zh: "命令" }
    Help { en: "Show help", zh: "显示用法" }
    Version { en: "Show version", zh: "显示版本" }
    LangFlag {
        en: "Language: en or zh; also set by RAILBUS_LANG and LANG",
        zh: "语言：en 或 zh；也可由 RAILBUS_LANG 或 LANG 设定",
    }
    Environment {
        en: "Flags of every command can also be set in the environment: RAILBUS_LINE and others.
Topics: railbus help exit-codes, addressing, units, protocols, safety",
        zh: "每个命令都有的选项也可写入环境变量：RAILBUS_LINE、RAILBUS_OUTPUT 等。
专题：railbus help exit-codes、addressing、units、protocols、safety",
    }
    Verbose { en: "Show each frame as it passes", zh: "逐条显示线路上的报文" }

    // Labels of an error.
    ExitLabel { en: "exit:", zh: "退出码：" }

    // Flags of every command.
    LineFlag {
        en: "The line: its name, or a port: /dev/…, tcp:HOST:PORT, mbtcp:HOST, pty:/PATH",
        zh: "总线：名称，或端口 /dev/… tcp:HOST:PORT mbtcp:HOST pty:/PATH",
    }
    OutputFlag {
        en: "How to print: table, json, ndjson, csv or value",
        zh: "输出格式：table、json、ndjson、csv 或 value",
    }
    ColorFlag {
        en: "When to use colours: auto (default), always or never; NO_COLOR is respected",
        zh: "何时使用颜色：auto（默认）、always 或 never；也遵守 NO_COLOR",
    }
    QuietFlag { en: "Print only errors and results", zh: "只输出错误和结果" }
    ConfigFlag {
        en: "Configuration file to use instead of railbus.toml",
        zh: "指定配置文件，代替 railbus.toml",
    }
    DirectFlag { en: "Open the line directly, not through the daemon", zh: "直接打开总线，不经守护进程" }
    ThroughDaemon { en: "through the daemon of {site}", zh: "经由守护进程，配置：{site}" }
    FarFlag {
        en: "Ask this site of a fleet, through the centre on this machine",
        zh: "经本机的站群中心，查询该站点",
    }
    SocketFlag { en: "The daemon's socket", zh: "守护进程的套接字" }
    TimeoutFlag {
        en: "How long raw and scan wait for a reply: 60ms, 1.5s",
        zh: "raw 和 scan 等待应答的时间：60ms、1.5s",
    }
    ModelFlag {
        en: "Without a configuration: the model, see railbus ls models",
        zh: "无配置时：型号，见 railbus ls models",
    }
    AddressFlag { en: "Without a configuration: the address, 10 or 0Ah", zh: "无配置时：地址，10 或 0Ah" }
    ProtocolFlag {
        en: "Without a configuration: rtu, ascii, lc02 or r55",
        zh: "无配置时：rtu、ascii、lc02 或 r55",
    }
    BaudFlag { en: "Without a configuration: the baud rate, default 9600", zh: "无配置时：波特率，默认 9600" }
    FormatFlag {
        en: "Without a configuration: 8N1 (default), 8E1, 8O1 or 8N2",
        zh: "无配置时：8N1（默认）、8E1、8O1 或 8N2",
    }
    ChecksumFlag {
        en: "Without a configuration: the module's ASCII frames carry a checksum",
        zh: "无配置时：模块的 ASCII 报文带校验和",
    }

    AllBoards {
        en: "Switch every 0x55 board of the line on or off at once; with --confirm broadcast",
        zh: "同时接通或断开总线上所有 0x55 板；须加 --confirm broadcast",
    }
    Confirm {
        en: "Required for broadcasts: --confirm broadcast",
        zh: "广播时必须写：--confirm broadcast",
    }

    // Why values or modules are not as wanted.
    StaleModules {
        en: "not read recently, values out of date: {modules}",
        zh: "数据过期，近期未读取：{modules}",
    }
    LastGood { en: "{state}, last good {time}", zh: "{state}，最后有效 {time}" }
    SilentModules { en: "no reply from: {modules}", zh: "无应答：{modules}" }
    SomeFailed { en: "{failed} of {count} targets failed", zh: "{count} 个目标中 {failed} 个失败" }
    NoBytes { en: "\"{text}\" is not hexadecimal bytes", zh: "\"{text}\" 不是十六进制字节" }
    FromEnvironment {
        en: "set in the environment: {variable}={value}",
        zh: "来自环境变量：{variable}={value}",
    }
    NoSuchCode { en: "there is no code \"{name}\"", zh: "没有代码 \"{name}\"" }
    BadOrder {
        en: "\"{word}\" gives no state; use on, off or toggle",
        zh: "\"{word}\" 未给出状态；请用 on、off 或 toggle",
    }

    // States.
    ReadThenSet { en: "read, then set", zh: "先读后写" }
    Old { en: "{age} old", zh: "{age}前" }
    PulseMode { en: "pulse mode {width}", zh: "点动 {width}" }
    LockedWord { en: "locked", zh: "已锁定" }
    PortOpening { en: "opening", zh: "正在打开" }
    PortUp { en: "open", zh: "已打开" }
    PortAbsent { en: "port missing", zh: "端口不存在" }
    PortBusy { en: "busy", zh: "被占用" }
    PortClosed { en: "closed", zh: "已关闭" }
    Targets {
        en: "Modules and points: pump, pump.do0, '*.di*'",
        zh: "模块和点位：pump、pump.do0、'*.di*'",
    }
    AllTargets {
        en: "Modules and points: pump, pump.do0, '*.di*'; default all",
        zh: "模块和点位：pump、pump.do0、'*.di*'；省略则为全部",
    }

    // ls
    LsAbout {
        en: "List modules, points, lines and more. Bits are in terminal order, first one first.",
        zh: "列出模块、点位、总线等。各位按端子顺序排列，首个在前。",
    }
    LsExamples {
        en: "  railbus ls                 the modules and their states
  railbus ls points pump     the points of a module
  railbus ls points -o json  every point with its value
  railbus ls ports           the serial ports of this machine
  railbus ls -s plant7       the modules of a site of a fleet",
        zh: "  railbus ls                 模块及其状态
  railbus ls points pump     某个模块的点位
  railbus ls points -o json  所有点位及其值
  railbus ls ports           本机串口
  railbus ls -s plant7       站群中某站点的模块",
    }
    LsWhat {
        en: "modules (default), points, lines, groups, models or ports",
        zh: "modules（默认）、points、lines、groups、models 或 ports",
    }
    NotFar {
        en: "{what} do not depend on the site: leave out -s",
        zh: "{what} 与站点无关，请去掉 -s",
    }
    LsModule { en: "Only the points of these modules", zh: "只列出这些模块的点位" }
    LsModulesHead {
        en: "MODULE|NAME|LINE|ADDR|PROTOCOL|MODEL|STATE|RTT|ERRORS 1h|OUTPUTS|INPUTS",
        zh: "模块|名称|总线|地址|协议|型号|状态|响应时间|1 小时错误|输出|输入",
    }
    LsGroupsHead { en: "GROUP|NAME|FRAMES|MEMBERS", zh: "分组|名称|报文数|成员" }
    LsLinesHead { en: "LINE|NAME|PORT|SETTINGS|STATE|MODULES", zh: "总线|名称|端口|参数|状态|模块" }
    LsModelsHead {
        en: "MODEL|TITLE|OUTPUTS|INPUTS|ANALOGS|ADDRESSES|PROTOCOLS|BAUD",
        zh: "型号|名称|输出|输入|模拟量|地址|协议|波特率",
    }
    LsPortsHead {
        en: "PORT|DRIVER|LATENCY|HELD BY|PLUGGED IN|STABLE NAME",
        zh: "端口|驱动|延迟|占用者|已插入|固定名称",
    }
    Late { en: "({late} late)", zh: "（{late} 次迟到）" }

    // get
    GetAbout { en: "Read points.", zh: "读取点位的值。" }
    GetExamples {
        en: "  railbus get pump                   all points of a module
  railbus get tank.ai1 -o value      the bare value
  railbus get '*.di*' -o csv         all inputs
  railbus get -s plant7 pump         the same at a site of a fleet",
        zh: "  railbus get pump                   一个模块的所有点位
  railbus get tank.ai1 -o value      只输出值
  railbus get '*.di*' -o csv         所有输入
  railbus get -s plant7 pump         站群中某站点的点位",
    }
    GetFresh { en: "Read from the module now, not from the daemon's cache", zh: "重新读取总线，不用守护进程的缓存" }
    LastKnown {
        en: "With -o value: show the last known value instead of ? where none is good",
        zh: "与 -o value 合用：当前无有效值时显示最后已知值，而不是 ?",
    }
    GetRaw { en: "Show the registers of analog values", zh: "显示模拟量的寄存器值" }

    // set
    SetAbout { en: "Switch outputs and read them back.", zh: "操作输出并回读。" }
    SetExamples {
        en: "  railbus set pump.do0 on
  railbus set yard 1,3=on                    by the numbers at the terminals
  railbus set oven k1=on k2=off k5=toggle
  railbus set '@night' off                   a group
  railbus set oven all=off -n                only show the frames",
        zh: "  railbus set pump.do0 on
  railbus set yard 1,3=on                    按端子编号
  railbus set oven k1=on k2=off k5=toggle
  railbus set '@night' off                   配置中的分组
  railbus set oven all=off -n                只显示报文",
    }
    SetTargets {
        en: "pump.do0 on; or a module and its outputs: oven k1=on k2=off",
        zh: "pump.do0 on；或模块及其输出：oven k1=on k2=off",
    }
    DryRun { en: "Show the frames, switch nothing", zh: "只显示报文，不操作" }
    NoVerify { en: "Do not read back", zh: "不回读" }
    WouldSend { en: "would send", zh: "将发送" }

    // pulse
    PulseAbout { en: "Switch an output on for a given time.", zh: "点动：输出接通一段时间。" }
    PulseExamples {
        en: "  railbus pulse yard.k3 500ms
  railbus pulse oven.k1 2s           timed by the host: ERC-8 has no timer
  railbus pulse pump.do3             with the module's own width",
        zh: "  railbus pulse yard.k3 500ms
  railbus pulse oven.k1 2s           由上位机计时：ERC-8 没有定时器
  railbus pulse pump.do3             用模块自身的宽度",
    }
    PulsePoint { en: "The output", zh: "输出点" }
    PulseDuration {
        en: "How long: 500ms, 2s; default: the module's own width",
        zh: "时间：500ms、2s；省略则为模块自身的宽度",
    }
    PulseBy {
        en: "Who times it: auto (default), device or host",
        zh: "计时者：auto（默认）、device 或 host",
    }
    PulseOff { en: "Switch off first, on after the time", zh: "点动断开：先断开，到时再接通" }
    PulseHere {
        en: "timed by this program: if it is killed, the output stays on",
        zh: "由本程序计时：若被强行终止，输出将保持接通",
    }
    PulseReleased { en: "{path} was switched off", zh: "{path} 已断开" }
    TimedByHost { en: "timed by the host", zh: "上位机计时" }
    TimedByDevice { en: "timed by the module", zh: "模块计时" }

    // watch
    WatchAbout { en: "Show changes, one per line.", zh: "逐行显示变化。" }
    WatchExamples {
        en: "  railbus watch
  railbus watch pump '*.ai*' -o ndjson",
        zh: "  railbus watch
  railbus watch pump '*.ai*' -o ndjson",
    }
    WatchPlain { en: "One line per change, on a terminal too", zh: "终端上也逐行显示变化" }
    WatchGap { en: "changes lost (reader too slow): {count}", zh: "读取太慢，丢失 {count} 个变化" }

    // raw
    RawAbout { en: "Send a frame and show the reply.", zh: "发送一条报文并显示应答。" }
    RawExamples {
        en: "  railbus raw --crc 03 01 00 3C 00 08
  railbus raw --ascii '$01M'
  railbus raw --proto r55 55 04 10 00 00 00 00",
        zh: "  railbus raw --crc 03 01 00 3C 00 08
  railbus raw --ascii '$01M'
  railbus raw --proto r55 55 04 10 00 00 00 00",
    }
    RawHex { en: "Bytes in hexadecimal", zh: "十六进制字节" }
    RawAscii { en: "A frame of the ASCII protocol without its end", zh: "ASCII 协议的报文，不含结束符" }
    RawCrc { en: "Append the Modbus RTU CRC", zh: "添加 Modbus RTU 的 CRC" }
    RawProto { en: "Append the checksum of rtu, lc02 or r55", zh: "添加 rtu、lc02 或 r55 的校验和" }
    MeantYes {
        en: "Confirm outputs that require confirmation",
        zh: "确认执行，用于需要确认的输出",
    }
    RawYes {
        en: "Allow broadcast, settings and unknown frames",
        zh: "允许发送广播、更改设置和未知的报文",
    }
    RawOverride {
        en: "Through the daemon: override configured locks, interlocks and times",
        zh: "经守护进程时：越过配置中的锁定、互锁和时限也发送",
    }
    NotUnderstood { en: "not a reply to this", zh: "不是对此的应答" }

    // decode
    DecodeAbout { en: "Explain what bytes mean.", zh: "解释字节的含义。" }
    DecodeExamples {
        en: "  railbus decode 6C 63 01 03 22 34 0D
  railbus decode '55 01 00 03 00 04 C0 1D' --all
  railbus decode -                   one frame per line, from stdin
  railbus decode -f night.pcapng     everything captured",
        zh: "  railbus decode 6C 63 01 03 22 34 0D
  railbus decode '55 01 00 03 00 04 C0 1D' --all
  railbus decode -                   从标准输入读取，每行一条报文
  railbus decode -f night.pcapng     抓包文件中的所有报文",
    }
    DecodeHex {
        en: "The bytes in hexadecimal, or an ASCII frame such as '$016'",
        zh: "十六进制字节，或 ASCII 报文如 '$016'",
    }
    DecodeAll { en: "Show every protocol that accepts the bytes", zh: "显示所有能接受的协议" }
    NoReading { en: "{count} bytes that no protocol accepts", zh: "{count} 字节，没有协议能接受" }
    RequestWord { en: "request", zh: "请求" }
    ReplyWord { en: "reply", zh: "应答" }
    CheckLabel { en: "checksum", zh: "校验和" }
    CheckRight { en: "{is}  right", zh: "{is}  正确" }
    CheckWrong { en: "{is}  WRONG, should be {should}", zh: "{is}  错误，应为 {should}" }
    KnownLabel { en: "known", zh: "已知" }
    AlsoLabel { en: "also", zh: "另有" }
    AlsoCount { en: "other readings: {count}, see --all", zh: "{count} 种解释，见 --all" }

    // explain
    ExplainAbout { en: "Explain an error code.", zh: "解释错误代码。" }
    ExplainExamples {
        en: "  railbus explain E0301
  railbus explain exit-codes",
        zh: "  railbus explain E0301
  railbus explain exit-codes",
    }
    ExplainCode {
        en: "Code, such as E0301 or 301; default: list all",
        zh: "代码，如 E0301 或 301；省略则列出全部",
    }

    // complete
    CompleteAbout { en: "Names that fit, for completion scripts.", zh: "供补全脚本使用的候选名称。" }
    CompleteWords { en: "The words of the command line so far", zh: "命令行已有的词" }

    // version
    VersionAbout { en: "Show version and features.", zh: "显示版本和所支持的内容。" }

    // Wrong arguments.
    NoSuchCommand { en: "there is no command \"{name}\"", zh: "没有命令 \"{name}\"" }
    NoSuchArgument { en: "there is no argument \"{name}\"", zh: "没有参数 \"{name}\"" }
    BadValue {
        en: "invalid value \"{value}\" for {name}",
        zh: "\"{value}\" 不能作为 {name} 的值",
    }
    NoValue { en: "{name} needs a value", zh: "{name} 需要一个值" }
    MissingCommand { en: "a command is missing", zh: "缺少命令" }
    MissingArgument { en: "{name} is missing", zh: "缺少 {name}" }
    Conflict { en: "{name} can't be used here", zh: "此处不能使用 {name}" }
    BadArguments { en: "the arguments are wrong", zh: "参数有误" }

    // serve
    ServeAbout {
        en: "Run the daemon: it owns the lines and serves commands, programs and browsers.",
        zh: "管理各条总线，供本机的命令、程序和浏览器使用。",
    }
    ServeExamples {
        en: "  railbus serve --demo                  five simulated modules, no real hardware
  railbus serve                         railbus.toml; without one, set it up in the browser
  railbus serve --config railbus.toml   run a configuration
  railbus serve --check                 check the configuration
  curl -H 'Authorization: Bearer rb_…' http://127.0.0.1:7485/api/v1/points/pump/do0",
        zh: "  railbus serve --demo                  五个仿真模块，均非真实设备
  railbus serve                         使用 railbus.toml；没有时在浏览器中设置
  railbus serve --config railbus.toml   按配置文件运行
  railbus serve --check                 检查配置文件
  curl -H 'Authorization: Bearer rb_…' http://127.0.0.1:7485/api/v1/points/pump/do0",
    }
    ServeDemo {
        en: "Run a simulated line with five modules instead of a configuration",
        zh: "使用含五个模块的仿真总线，不读配置",
    }
    ServeListen {
        en: "Listen address, default 127.0.0.1:7485; for other machines TLS and a user are \
            required",
        zh: "监听地址，默认 127.0.0.1:7485；向其他机器开放须有 TLS 和用户",
    }
    ServeTls {
        en: "auto: create and keep a certificate, and show its fingerprint",
        zh: "auto：自动生成并保存证书，显示其指纹",
    }
    ServeTlsCert { en: "Your own certificate (PEM)", zh: "自备证书 (PEM)" }
    ServeTlsKey {
        en: "Its private key (PEM); both are reloaded when they change",
        zh: "其私钥 (PEM)；文件更改后自动重新读取",
    }
    ServeName {
        en: "Additional host name that browsers use; may be repeated",
        zh: "浏览器访问所用的名称，本机名之外另加；可重复",
    }
    ServeCheck { en: "Only check the configuration", zh: "仅检查配置" }
    ServeNoLine {
        en: "serve takes no -l: its lines are those of the configuration",
        zh: "serve 不接受 -l：总线须写在配置中"
    }
}
