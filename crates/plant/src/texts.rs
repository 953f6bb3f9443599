//! The texts of the simulated plant.

use railbus_words::texts;

texts! {
    pub(crate) SimText;

    // The demo.
    Served {
        en: "The demo line, 9600 8N1, until you press Ctrl-C. Connect any master to:",
        zh: "演示总线，9600 8N1，按 Ctrl-C 结束。任何主站均可连接：",
    }
    RawBytes { en: "raw bytes, several clients share the line", zh: "原始字节，多个客户端共用总线" }
    Modules { en: "On it:", zh: "总线上的模块：" }
    Columns {
        en: "MODULE  MODEL        ADDRESS   PROTOCOL",
        zh: "模块    型号         地址      协议",
    }
    FrameColumns {
        en: "  TIME s     +ms  {who}  EVENT        BYTES",
        zh: "  时间 s     +ms  {who}  事件         字节",
    }
    Who { en: "WHO", zh: "谁" }

    // A plant.
    PlantServed {
        en: "{file} (lines: {lines}, modules: {modules}), all simulated, until you press Ctrl-C:",
        zh: "{file}：{lines} 条总线，{modules} 个模块，均为仿真，按 Ctrl-C 结束：",
    }
    LinesHead { en: "LINE|SETTINGS|MODULES|PTY|TCP", zh: "总线|参数|模块|PTY|TCP" }
    ControlledBy { en: "commands: railbus sim ctl {path} …", zh: "命令：railbus sim ctl {path} …" }
    NoLines { en: "{file} has no line to simulate", zh: "{file} 中没有可仿真的总线" }
    NoSuchLine {
        en: "there is no line \"{name}\" in the plant; there are: {names}",
        zh: "仿真文件中没有总线 \"{name}\"，现有：{names}",
    }
    NameLine {
        en: "the plant has several lines: name one, as {form}",
        zh: "仿真文件中有多条总线，请指明，如 {form}",
    }
    SamePlace { en: "two lines are to be served at {place}", zh: "两条总线使用同一位置 {place}" }
    BadAddress { en: "\"{value}\" is not a TCP address", zh: "\"{value}\" 不是 TCP 地址" }
    BadState { en: "{path} can't be used", zh: "无法使用 {path}" }
    OtherFamily {
        en: "it has module \"{name}\" as another model",
        zh: "其中模块 \"{name}\" 的型号不同",
    }

    // Commands and answers.
    NoOrder { en: "unknown command \"{text}\"; try help", zh: "未知命令 \"{text}\"；可输入 help" }
    WriteSo { en: "write it as: {form}", zh: "应写为：{form}" }
    WhichLine { en: "which line? there are: {names}", zh: "哪条总线？现有：{names}" }
    NoModule {
        en: "there is no module \"{name}\"; there are: {names}",
        zh: "没有模块 \"{name}\"，现有：{names}",
    }
    NoInput {
        en: "{path} is not an input; only inputs can be changed from outside",
        zh: "{path} 不是输入点；只能从外部改变输入",
    }
    Gone { en: "the line has been stopped", zh: "总线已停止" }
    TooLong { en: "the command is too long", zh: "命令过长" }
    HelpAnswer {
        en: "pump.di1 = 1 | tank.ai1 = 8.71 V | power yard on|off|cycle | dip yard 3 | \
            init gate on|off | reset tank | protocol pump rtu | fault tank mute 10s | \
            fault line main noise 1e-3 | \
            fault tank clear | fault clear | show | show pump | quit",
        zh: "改变输入：pump.di1 = 1 | tank.ai1 = 8.71 V；模块：power yard on|off|cycle | dip yard 3 | \
            init gate on|off | reset tank | protocol pump rtu；故障：fault tank mute 10s | \
            fault line main noise 1e-3 | \
            fault tank clear | fault clear；查看：show | show pump；退出：quit",
    }
    Bye { en: "simulator stopped", zh: "仿真器已停止" }
    AllClear { en: "all faults cleared", zh: "已清除全部故障" }
    On { en: "on", zh: "开" }
    Off { en: "off", zh: "关" }
    High { en: "high", zh: "高电平" }
    Low { en: "low", zh: "低电平" }
    NoDip { en: "{name} has no DIP switch", zh: "{name} 没有 DIP 开关" }
    NoInit { en: "{name} has no INIT* pin", zh: "{name} 没有 INIT* 引脚" }
    Grounded { en: "grounded", zh: "接地" }
    Open { en: "open", zh: "悬空" }
    None { en: "none", zh: "无" }
    LineNamed { en: "line {name}", zh: "总线 {name}" }
    ShowLine {
        en: "{name}: {serial}; collisions {collisions}; faults so far {injected}; faults: {faults}",
        zh: "{name}：{serial}; 冲突 {collisions}; 已发生故障 {injected}; 故障：{faults}",
    }
    Left { en: "{words} ({left} left)", zh: "{words}（剩余 {left}）" }
    PowerIs { en: "{name}: power {value}", zh: "{name}：电源{value}" }
    Cycled { en: "{name}: power-cycled", zh: "{name}：已断电重启" }
    DipIs { en: "{name}: DIP switch at {value}", zh: "{name}：DIP 开关为 {value}" }
    InitIs { en: "{name}: INIT* {value}", zh: "{name}：INIT* {value}" }
    ProtocolIs { en: "{name}: restarted with protocol {value}", zh: "{name}：已改用协议 {value} 并重启" }
    WasReset { en: "{name}: restarted with factory settings", zh: "{name}：已恢复出厂设置并重启" }
    FaultsOf { en: "{name}: faults: {faults}", zh: "{name}：故障：{faults}" }
    Checksummed { en: "checksum on", zh: "有校验和" }
    Kept { en: "after a restart {value}", zh: "重启后 {value}" }
    ShowPower { en: "power {value}", zh: "电源{value}" }
    ShowOutputs { en: "outputs {value}", zh: "输出 {value}" }
    ShowInputs { en: "inputs {value}", zh: "输入 {value}" }
    ShowAnalogs { en: "analog {value}", zh: "模拟量 {value}" }
    ShowLed { en: "LED {value}", zh: "指示灯{value}" }
    ShowReplies { en: "replies {value}", zh: "应答 {value}" }
    ShowSaves { en: "saved {value}", zh: "存储 {value}" }
    ShowRestarts { en: "restarts {value}", zh: "重启 {value}" }
    ShowFaults { en: "faults: {value}", zh: "故障：{value}" }
    NoControl { en: "can't use the control socket {path}", zh: "无法使用控制套接字 {path}" }
}
