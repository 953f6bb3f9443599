//! The texts of `railbus help`.

railbus_words::texts! {
    pub(crate) HelpText;

    About { en: "Show the help of a command or a topic.", zh: "显示命令或专题的帮助。" }
    Examples {
        en: "  railbus help set
  railbus help exit-codes
  railbus help addressing            also: units, protocols, safety",
        zh: "  railbus help set
  railbus help exit-codes
  railbus help addressing            另有：units、protocols、safety",
    }
    Topic {
        en: "A command, or exit-codes, addressing, units, protocols, safety",
        zh: "命令名，或 exit-codes、addressing、units、protocols、safety",
    }

    Addressing {
        en: "How lines, modules and points are named

  -l main                     a line of railbus.toml
  -l /dev/ttyUSB0             a serial port; better by its stable name: /dev/serial/by-id/…
  -l tcp:10.0.0.5:4001        a serial server that forwards raw bytes
  -l mbtcp:10.0.0.5           a gateway that speaks Modbus TCP; default port 502
  -l pty:/tmp/railbus-main    a pseudo-terminal, such as that of railbus sim

  pump                        a module; all its points
  pump.do0                    a point: labels are those printed on the module
  '*.di*'                     a pattern; in quotes, or the shell would expand it
  yard 1,3=on                 outputs of a module by terminal number; also 1-3=on

EDA modules count from 0 (do0, di0), ERC-8 and 0x55 boards from 1 (k1), EMD-2A2Q from 1
(k1, ai1). JSON has both the label and an index that counts from 0.

Addresses are written 10, 0x0A or 0Ah, and shown as 10 (0Ah), since manuals of ASCII modules
use hexadecimal and those of Modbus modules decimal. The broadcast address is 0 (Modbus) or
245 (F5h, 0x55 boards).

The configuration is the first of --config, RAILBUS_CONFIG, railbus.toml here or in a folder
above, ~/.config/railbus/railbus.toml and /etc/railbus/railbus.toml: railbus config path shows
which. Without one: railbus -l /dev/ttyUSB0 -m erc8 -a 3 get erc8

The daemon is found by its socket: --socket, RAILBUS_SOCKET, or railbus.sock in XDG_RUNTIME_DIR,
/run/railbus or the user's temporary folder; RAILBUS_RUN sets a folder that replaces these. If
the daemon serves a different configuration than the one found here, the command is refused:
name the site with --socket or --config.",
        zh: "总线、模块和点位的名称

  -l main                     railbus.toml 中的总线
  -l /dev/ttyUSB0             串口；最好用固定名称 /dev/serial/by-id/…
  -l tcp:10.0.0.5:4001        透传的串口服务器
  -l mbtcp:10.0.0.5           Modbus TCP 网关；默认端口 502
  -l pty:/tmp/railbus-main    伪终端，例如 railbus sim 所建

  pump                        模块；即其所有点位
  pump.do0                    点位：标签与模块上所印一致
  '*.di*'                     通配；须加引号，以免被 shell 展开
  yard 1,3=on                 按端子编号指定输出；也可写 1-3=on

EDA 模块从 0 起编号（do0、di0），ERC-8 和 0x55 板从 1 起（k1），EMD-2A2Q 从 1 起（k1、ai1）。
JSON 中同时给出标签和从 0 起的序号。

地址可写作 10、0x0A 或 0Ah，显示为 10 (0Ah)：ASCII 模块的手册用十六进制，Modbus 模块用十进制。
0 为广播地址（Modbus），0x55 板的广播地址为 245 (F5h)。

配置依次取 --config、RAILBUS_CONFIG、当前及上级目录的 railbus.toml、
~/.config/railbus/railbus.toml 和 /etc/railbus/railbus.toml：railbus config path 显示所用的文件。
无配置时：railbus -l /dev/ttyUSB0 -m erc8 -a 3 get erc8

守护进程依次在以下套接字查找：--socket、RAILBUS_SOCKET，XDG_RUNTIME_DIR、/run/railbus
或用户临时目录中的 railbus.sock；RAILBUS_RUN 可指定目录代替后三者。守护进程的配置与此处
找到的配置不同时，命令不会执行：请用 --socket 或 --config 指明站点。",
    }
    Units {
        en: "Numbers and units

Times carry their unit: 500ms, 1.5s, 2m, 1h. A number without a unit is refused. Programs get
whole milliseconds, in keys that end in _ms, and timestamps as RFC 3339 in UTC.

Analog values have the configured unit, default V, and as many decimals as the module resolves.
EMD-2A2Q counts hundredths: --raw shows the register, 871 for 8.71 V.

Bytes are hexadecimal, with or without blanks: 01 03 00 02. Addresses may be 10, 0x0A or 0Ah.
Speeds are in bits per second; a format is data bits, parity (N, E, O) and stop bits, as 8N1.

Outputs and inputs are on or off, in tables, CSV and bare values; true or false in JSON. An input
is on while its terminal is at the active level. In a row of bits 1 is on, in the order of the
terminals: 1100 is do0 and do1 on.",
        zh: "数值与单位

时间须带单位：500ms、1.5s、2m、1h。不带单位的数值会被拒绝。
程序得到的时间为整毫秒，键名以 _ms 结尾；时刻为 UTC 的 RFC 3339 格式。

模拟量带配置中的单位，默认 V，小数位数与模块分辨率一致。
EMD-2A2Q 以百分之一计：--raw 显示寄存器值，8.71 V 为 871。

字节用十六进制，可带空格：01 03 00 02。地址可写作 10、0x0A 或 0Ah。
波特率为每秒位数；格式为数据位、校验位（N、E、O）和停止位，如 8N1。

输出和输入在表格中为接通或断开，在 CSV 和单值输出中为 on 或 off，在 JSON 中为 true 或 false。
输入端子处于有效电平时为接通。成串显示时 1 为接通，按端子顺序排列：1100 表示 do0 和 do1 接通。",
    }
    Protocols {
        en: "The protocols of a line

  ascii   text such as $016 and !030200, ended by CR; with or without a checksum  (EDA)
  lc02    bytes that begin with 4C 57 and end with 0D, replies with 6C            (EDA)
  rtu     Modbus RTU, with a CRC                                         (EDA, ERC-8, EMD)
  r55     eight bytes that begin with 55, replies with 22                    (0x55 boards)

Modules of several protocols can share a line: railbus never sends a frame that another
protocol of the line would take for a command. Each module has one protocol at a time; where no
command switches it, the vendor's software or a jumper does. All modules of a line should have
the same speed; if they differ, railbus switches, which costs time (railbus explain L012).

A reply is always checked against its request: a late reply, or one to another request, is never
taken for that of another module.",
        zh: "总线上的协议

  ascii   文本，如 $016 和 !030200，以 CR 结束；可带校验和             （EDA）
  lc02    以 4C 57 开头、0D 结尾的字节，应答以 6C 开头                 （EDA）
  rtu     Modbus RTU，带 CRC                                （EDA、ERC-8、EMD）
  r55     以 55 开头的八个字节，应答以 22 开头                     （0x55 板）

不同协议的模块可共用一条总线：railbus 不会发送会被总线上另一协议误认为命令的报文。
每个模块同时只用一种协议；没有切换命令时，由厂家软件或跳线切换。
同一总线上的模块应使用相同波特率；不同时 railbus 会切换，但要花时间（railbus explain L012）。

应答总是与对应的请求一并校验：迟到的应答或其他请求的应答不会被误认为另一模块的应答。",
    }
    Safety {
        en: "What is sent, and what is not

  live        outputs: sent at once, and read back where the module can
  settings    stored in EEPROM (address, speed, calibration): after confirmation, or with --yes
  broadcast   to all modules: after confirmation, or with --yes

scan, get, ls, watch and doctor only read. set -n shows the frames and sends nothing.

\"done\" means that the module confirmed it. If an output is acknowledged but reads back
differently, the exit code is 6; if a command without a reply may have acted, the error says so. A
command that must not be carried out twice (toggle, pulse) is never repeated automatically.

locked = true for a point in the configuration keeps every command and program from switching it.

Ctrl-C waits for the frame on the wire to end, and switches off an output whose pulse is timed by
this command. If the command is killed, such an output stays on; pulses timed by the daemon
(railbus serve) or by the module still end.

railbus switches relays and reads inputs; it is not a safety device. Protecting people requires
a separate circuit.",
        zh: "发送什么，不发送什么

  输出      立即发送，能回读的模块会回读
  设置      保存在 EEPROM（地址、波特率、校准）：须确认，或用 --yes
  广播      面向所有模块：须确认，或用 --yes

scan、get、ls、watch 和 doctor 只读取。set 加 -n 只显示报文而不发送。

“完成”指模块已确认。已应答但回读不一致时退出码为 6；没有应答而命令可能已执行时，错误信息会说明。
不可重复的命令（翻转、点动）不会自动重发。

配置中点位的 locked = true 禁止任何命令和程序写入。

Ctrl-C 会等线路上的报文结束，并断开由本程序计时的点动输出。若被强行终止，由本程序计时的点动会保持
接通；守护进程（railbus serve）或自行计时的模块则不会。

railbus 用于操作继电器和读取输入，不是安全装置。人身保护须使用独立的电路。",
    }
}
