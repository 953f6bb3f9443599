//! What `railbus sim` says.

use railbus_words::texts;

texts! {
    pub(crate) SimText;

    // The command and its flags.
    About {
        en: "Simulate lines for any master, byte by byte at real line speed.",
        zh: "按实际线路速度逐字节仿真总线，供任何上位机访问。",
    }
    Examples {
        en: "  railbus sim --demo                    five modules on a PTY and on TCP
  railbus sim plant.toml                the lines and modules of a configuration
  railbus sim plant.toml --pty /tmp/v0 --seed 7 --fault 'pump: drop 5%'
  railbus sim plant.toml --control ./ctl
  railbus sim ctl ./ctl power yard cycle",
        zh: "  railbus sim --demo                    五个模块，经 PTY 和 TCP 访问
  railbus sim plant.toml                仿真配置文件中的总线和模块
  railbus sim plant.toml --pty /tmp/v0 --seed 7 --fault 'pump: drop 5%'
  railbus sim plant.toml --control ./ctl
  railbus sim ctl ./ctl power yard cycle",
    }
    Guide {
        en: "A plant is a configuration such as railbus.toml, with more for the simulation:
  [sim]               seed, speed
  [line.NAME.sim]     pty, tcp, faults
  [module.NAME.sim]   factory, power, dip, init, init_sampled, faults, inputs,
                      turnaround, applies, refuse_aloud, lower_case,
                      answer_bad_frames, insist_on_gap, beyond
  inputs = { di0 = 1, di1 = { every = \"10s\" } }
  inputs = { di2 = { low = \"3s\", after = \"9s\", every = \"42s\" } }
  inputs = { ai1 = 8.71, ai2 = { from = 1.2, to = 8.8, every = \"4m\" } }
  inputs = { ai1 = { from = 4, to = 6, every = \"20s\", soft = true } }

Faults, parted by commas; each may have a time after which it ends (mute 10s),
or, of a module, a number of replies (bad once, mute 3x):
  mute            obeys, never answers    drop 5%         requests, replies lost
  deaf            hears nothing           flip 1e-4       bits turn over
  dead            has no power            skip 1e-4       characters are lost
  echo            of a line: its adapter  noise 1e-4|2s   of a line: while idle
  delay 200ms±50  late replies            glitch 10%      00 before, FF after
  duplicate 10%   replies come twice      split 20% 30ms  replies in pieces
  babble|5%       garbage, or as a reply  cuts 10m 2s     no power: every, for
  dup-address 6   as if set so by mistake bad             last character wrong
  stuck k1        the output does not move

At the prompt, one order to a line; also on stdin, and by railbus sim ctl:
  pump.di1 = 1            power yard on|off|cycle     fault tank mute 10s
  tank.ai1 = 8.71 V       dip yard 3                  fault line main noise 1e-3
  tank.ai1 = auto         reset tank                  fault tank clear mute
  show                    init gate on|off            fault tank clear
  show pump               protocol pump rtu           fault clear
  help                    quit",
        zh: "仿真文件即 railbus.toml 格式的配置，可另含仿真设置：
  [sim]               seed、speed
  [line.名称.sim]     pty、tcp、faults
  [module.名称.sim]   factory、power、dip、init、init_sampled、faults、inputs、
                      turnaround、applies、refuse_aloud、lower_case、
                      answer_bad_frames、insist_on_gap、beyond
  inputs = { di0 = 1, di1 = { every = \"10s\" } }
  inputs = { di2 = { low = \"3s\", after = \"9s\", every = \"42s\" } }
  inputs = { ai1 = 8.71, ai2 = { from = 1.2, to = 8.8, every = \"4m\" } }
  inputs = { ai1 = { from = 4, to = 6, every = \"20s\", soft = true } }

故障，多个以逗号分隔，均可附加持续时间（mute 10s），
模块的故障也可附加应答次数（bad once、mute 3x）：
  mute            执行但从不应答      drop 5%         请求或应答丢失
  deaf            听不到请求          flip 1e-4       字符位翻转
  dead            断电                skip 1e-4       字符丢失
  echo            总线：适配器回显    noise 1e-4|2s   总线：空闲时的干扰
  delay 200ms±50  应答延迟            glitch 10%      应答前多 00、后多 FF
  duplicate 10%   应答重复            split 20% 30ms  应答分段
  babble|5%       持续乱码或以其应答  cuts 10m 2s     断电：平均间隔、时长
  dup-address 6   如同误设了地址      bad             末字符出错
  stuck k1        输出卡住不动

提示符下每行一条命令，也可经管道输入或用 railbus sim ctl 发送：
  pump.di1 = 1            power yard on|off|cycle     fault tank mute 10s
  tank.ai1 = 8.71 V       dip yard 3                  fault line main noise 1e-3
  tank.ai1 = auto         reset tank                  fault tank clear mute
  show                    init gate on|off            fault tank clear
  show pump               protocol pump rtu           fault clear
  help                    quit",
    }
    File { en: "The plant to simulate", zh: "仿真文件" }
    Demo { en: "The demo line: one module of each of five kinds", zh: "演示总线：五种模块各一个" }
    Pty {
        en: "The link to a line's PTY; LINE= where there are several. Demo: /tmp/railbus-main",
        zh: "总线 PTY 的链接；有多条总线时加 LINE=。演示默认 /tmp/railbus-main",
    }
    Tcp {
        en: "Where a line is served as raw bytes over TCP. Demo: 127.0.0.1:4001",
        zh: "总线 TCP 原始字节的监听地址。演示默认 127.0.0.1:4001",
    }
    Seed {
        en: "Random seed; default 0",
        zh: "随机数种子；默认 0",
    }
    Speed { en: "Speed factor relative to real time; default 1", zh: "相对实际时间的倍速；默认 1" }
    FaultFlag {
        en: "Faults: 'pump: drop 5%', 'line: echo'",
        zh: "故障：'pump: drop 5%'、'line: echo'",
    }
    Control { en: "Control socket, see railbus sim ctl", zh: "接收命令的套接字，见 railbus sim ctl" }
    State {
        en: "Keep the modules' settings in this file across restarts",
        zh: "将模块设置保存在此文件中，重启后保留",
    }
    CtlAbout {
        en: "Send a command to a running simulator, or those from stdin, one per line.",
        zh: "向运行中的仿真器发送命令；未给出时从标准输入读取，每行一条。",
    }
    CtlExamples {
        en: "  railbus sim ctl ./ctl power yard cycle
  railbus sim ctl ./ctl 'tank.ai1 = 8.71 V'",
        zh: "  railbus sim ctl ./ctl power yard cycle
  railbus sim ctl ./ctl 'tank.ai1 = 8.71 V'",
    }
    CtlSocket { en: "The path given to --control", zh: "--control 所指定的路径" }
    CtlOrder { en: "Command; see railbus help sim", zh: "命令；见 railbus help sim" }

    // The demo.
    Served {
        en: "The demo line, 9600 8N1, until you press Ctrl-C. Connect any master to:",
        zh: "演示总线，9600 8N1，按 Ctrl-C 结束。任何上位机均可连接：",
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
    ControlledBy { en: "orders: railbus sim ctl {path} …", zh: "命令：railbus sim ctl {path} …" }
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
    NoControl { en: "can't use the control socket {path}", zh: "无法使用控制套接字 {path}" }

    // Orders and answers.
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
    Cycled { en: "{name}: power went and came back", zh: "{name}：已断电重启" }
    DipIs { en: "{name}: DIP switch at {value}", zh: "{name}：DIP 开关为 {value}" }
    InitIs { en: "{name}: INIT* {value}", zh: "{name}：INIT* {value}" }
    ProtocolIs { en: "{name}: restarted with protocol {value}", zh: "{name}：已改用协议 {value} 并重启" }
    WasReset { en: "{name}: restarted with the factory's settings", zh: "{name}：已恢复出厂设置并重启" }
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
}
