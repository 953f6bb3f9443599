//! Every failure by its code: one table, which errors and `railbus explain` both read.

use crate::i18n::Lang;

/// A page of the table in both languages.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Page {
    /// What happened.
    pub(super) title: [&'static str; 2],
    /// What it usually comes from.
    pub(super) likely: [&'static str; 2],
    /// What to do next.
    pub(super) next: [&'static str; 2],
}

impl Page {
    pub(crate) const fn title(&self, lang: Lang) -> &'static str {
        lang.of(self.title)
    }

    pub(crate) const fn likely(&self, lang: Lang) -> &'static str {
        lang.of(self.likely)
    }

    pub(crate) const fn next(&self, lang: Lang) -> &'static str {
        lang.of(self.next)
    }
}

macro_rules! codes {
    ($($name:ident = $number:literal {
        title: $title:expr, likely: $likely:expr, next: $next:expr $(,)?
    })*) => {
        /// A kind of failure. The digits of its number before the last two are its exit code.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum Code { $(#[doc = $number] $name),* }

        impl Code {
            /// All of them, by number.
            pub(crate) const ALL: &[Code] = &[$(Code::$name),*];

            /// As people and programs read it, such as `E0301`.
            pub(crate) const fn name(self) -> &'static str {
                match self { $(Code::$name => $number),* }
            }

            /// What the table says of it.
            pub(crate) const fn page(self) -> Page {
                match self {
                    $(Code::$name => Page { title: $title, likely: $likely, next: $next }),*
                }
            }
        }
    };
}

impl Code {
    /// The code of this name.
    pub(crate) fn from_name(name: &str) -> Option<Code> {
        let found = |code: &&Code| code.name().eq_ignore_ascii_case(name);
        Code::ALL.iter().find(found).copied()
    }

    /// The exit code that goes with it.
    pub(crate) fn exit(self) -> u8 {
        let digits = self.name().trim_start_matches('E');
        let number: u16 = digits.parse().unwrap_or(100);
        u8::try_from(number / 100).unwrap_or(1)
    }
}

codes! {
    System = "E0101" {
        title: ["the system refuses something that always works", "系统拒绝了通常可行的操作"],
        likely: ["no memory, no file handles or no right to use them", "内存、文件句柄或权限不足"],
        next: ["read what the system says after \"why\"", "查看“原因”后的系统说明"],
    }
    Output = "E0102" {
        title: ["the result can't be written", "无法写出结果"],
        likely: ["the disk behind the redirection is full", "重定向所在磁盘已满"],
        next: ["make room and run the command again", "腾出空间后重新执行"],
    }
    Overloaded = "E0105" {
        title: ["not sent: too much waits for the line already", "未发送：总线上等待的命令过多"],
        likely: ["many commands at once, or modules that do not answer", "同时命令过多，或有模块不应答"],
        next: ["wait a moment, then repeat the command", "稍候再试"],
    }
    Expired = "E0106" {
        title: ["not sent: its time to live ran out", "未发送：已超过有效时间"],
        likely: ["the line is busy or silent modules hold it up", "总线繁忙，或被无应答的模块拖住"],
        next: ["railbus ls", "railbus ls"],
    }
    Locked = "E0107" {
        title: ["not sent: the point is locked", "未发送：该点已锁定"],
        likely: ["locked = true in the configuration", "配置中有 locked = true"],
        next: ["take the lock out of the configuration if you may", "如有权限，请在配置中解除锁定"],
    }
    NotAsAsked = "E0108" {
        title: ["not sent: the output is not in the state asked for", "未发送：输出不是所要求的状态"],
        likely: ["someone else switched it meanwhile", "期间已被他人操作"],
        next: ["railbus get --fresh", "railbus get --fresh"],
    }
    NoDaemon = "E0109" {
        title: ["the daemon can't be reached", "无法连接守护进程"],
        likely: ["it does not run · another socket · no right to it", "未运行 · 套接字不同 · 无权限"],
        next: ["railbus serve", "railbus serve"],
    }
    NoPage = "E0110" {
        title: ["the daemon has nothing at this address", "守护进程没有此地址"],
        likely: ["the daemon is of another version than this command", "守护进程与此命令版本不同"],
        next: ["restart the daemon", "重新启动守护进程"],
    }
    Journal = "E0140" {
        title: ["the journal of changes can't be written; nothing was sent after it failed",
            "无法写入更改日志；失败后未再发送任何内容"],
        likely: ["no right to the folder · the disk is full", "文件夹无写权限 · 磁盘已满"],
        next: ["choose another folder with --state DIR", "用 --state DIR 指定其他文件夹"],
    }
    JournalBusy = "E0141" {
        title: ["another railbus changes settings just now", "另一个 railbus 正在更改设置"],
        likely: ["a second shell, or an apply that still runs", "另一个终端，或仍在执行的 apply"],
        next: ["wait until it has ended", "等待其结束"],
    }
    ConfigNotWritten = "E0142" {
        title: ["the module was changed, but the configuration file was not",
            "模块已更改，但配置文件未能更新"],
        likely: ["no right to the file · the disk is full", "文件无写权限 · 磁盘已满"],
        next: ["railbus config recover", "railbus config recover"],
    }
    NotConfirmed = "E0143" {
        title: ["not confirmed: nothing was written", "未确认：未写入任何内容"],
        likely: ["the question was answered with no", "对提问回答了否"],
        next: ["repeat the command and answer y, or add --yes", "重新执行并回答 y，或加 --yes"],
    }
    Capture = "E0180" {
        title: ["the capture file can't be read", "无法读取抓包文件"],
        likely: ["it is no pcapng file · it was cut off while it was written",
            "不是 pcapng 文件 · 写入时被截断"],
        next: ["editcap -F pcapng OLD NEW   (of Wireshark)",
            "editcap -F pcapng 旧文件 新文件（Wireshark 工具）"],
    }
    CaptureWrite = "E0181" {
        title: ["the capture file can't be written", "无法写入抓包文件"],
        likely: ["it is there already · the disk is full · no right to the folder",
            "文件已存在 · 磁盘已满 · 无目录权限"],
        next: ["name another file", "换一个文件名"],
    }
    NothingToPlay = "E0183" {
        title: ["the capture file can't be played", "无法重放抓包文件"],
        likely: ["it holds replies alone, or too much", "文件中只有应答，或内容过多"],
        next: ["railbus sniff --read FILE", "railbus sniff --read 文件"],
    }
    Install = "E0195" {
        title: ["a file can't be put in its place", "无法写入文件"],
        likely: ["no right to write there · the disk is full", "无写入权限 · 磁盘已满"],
        next: ["name a folder of your own with --dir", "用 --dir 指定您自己的目录"],
    }
    Unhealthy = "E0196" {
        title: ["the doctor found errors", "诊断发现错误"],
        likely: ["see each of them", "见各项说明"],
        next: ["railbus doctor --fix", "railbus doctor --fix"],
    }
    FixFailed = "E0197" {
        title: ["a fix did not work", "修复未成功"],
        likely: ["the command named ended with an error · no right to run it",
            "所示命令执行出错 · 无执行权限"],
        next: ["run the command yourself and read what it says", "自行执行该命令并查看其输出"],
    }
    Usage = "E0201" {
        title: ["wrong arguments", "参数有误"],
        likely: ["a typing mistake", "输入错误"],
        next: ["railbus --help", "railbus --help"],
    }
    NeedsYes = "E0202" {
        title: ["not sent: the frame changes settings or is for all modules",
            "未发送：此帧会更改设置或面向所有模块"],
        likely: ["a broadcast switches every module; a setting is kept in EEPROM",
            "广播会动作所有模块；设置会写入 EEPROM"],
        next: ["repeat it with --yes if that is what you want", "确认无误后加 --yes 重试"],
    }
    NeedsAnswer = "E0240" {
        title: ["nobody can be asked: this is no terminal", "无法提问：当前不是终端"],
        likely: ["run from a script or with its input redirected", "在脚本中运行，或输入已重定向"],
        next: ["look at it with -n, then add --yes", "先用 -n 查看，再加 --yes"],
    }
    ScanNothing = "E0270" {
        title: ["there is nothing to ask", "没有可询问的内容"],
        likely: ["protocols, speeds and parity exclude each other", "协议、波特率与校验位互相矛盾"],
        next: ["railbus scan --help", "railbus scan --help"],
    }
    ScanNoneKept = "E0271" {
        title: ["there is no scan to go on with", "没有可继续的扫描"],
        likely: ["the last scan of this line came to its end · another folder or configuration",
            "此总线上次扫描已完成 · 目录或配置不同"],
        next: ["railbus scan", "railbus scan"],
    }
    ScanOther = "E0272" {
        title: ["the scan that was broken off is another one", "中断的扫描与此不同"],
        likely: ["other options, another line or another port", "选项、总线或端口不同"],
        next: ["repeat it with the options of that scan, or scan without --resume",
            "使用原扫描的选项，或不带 --resume 重新扫描"],
    }
    ScanFixedSpeed = "E0274" {
        title: ["the speed of this line can't be changed from here", "无法从此处更改该总线的波特率"],
        likely: ["the line is behind a serial server, which has a speed of its own",
            "总线位于串口服务器之后，波特率由其设定"],
        next: ["railbus scan --full, and change the speed at the server for each of the others",
            "railbus scan --full；其他波特率须在服务器上逐一更改"],
    }
    BadFilter = "E0280" {
        title: ["the filter can't be read", "无法理解过滤条件"],
        likely: ["a typing mistake", "输入错误"],
        next: ["railbus sniff --filter 'addr=3 and (bad or slow>50ms)'",
            "railbus sniff --filter 'addr=3 and (bad or slow>50ms)'"],
    }
    SimOrder = "E0290" {
        title: ["the simulator does not understand this", "模拟器无法理解此命令"],
        likely: ["a typing mistake · a module or point of another plant", "输入错误 · 属于其他工厂文件的模块或点"],
        next: ["type help at its prompt", "在提示符下输入 help"],
    }
    NoReply = "E0301" {
        title: ["no reply: nobody answered in time", "无应答：限定时间内无人应答"],
        likely: ["module off · A/B swapped · other baud or protocol · address changed",
            "模块未上电 · A/B 接反 · 波特率或协议不同 · 地址已改"],
        next: ["railbus scan", "railbus scan"],
    }
    Unknown = "E0302" {
        title: ["the line was lost during the command; it may have acted",
            "命令进行中失去总线；命令可能已执行"],
        likely: ["the adapter was pulled out · its driver fails", "转换器被拔出 · 驱动故障"],
        next: ["plug it in, then: railbus get --fresh", "重新插入后执行：railbus get --fresh"],
    }
    Lost = "E0340" {
        title: ["the module is not found any more after the write", "写入后找不到该模块"],
        likely: ["it lost its power meanwhile · its line was disturbed · it has other settings \
            than written",
            "期间断电 · 总线受干扰 · 实际采用的设置与写入的不同"],
        next: ["railbus config recover", "railbus config recover"],
    }
    NotFound = "E0341" {
        title: ["the module is found nowhere", "到处找不到该模块"],
        likely: ["it is off · it hangs on another line · A/B swapped",
            "未上电 · 在另一条总线上 · A/B 接反"],
        next: ["railbus scan", "railbus scan"],
    }
    NothingHeard = "E0380" {
        title: ["nothing was heard on the line", "总线上没有任何通信"],
        likely: ["no master talks · A and B not connected · the adapter does not listen",
            "没有主机通信 · A/B 未接 · 转换器未在接收"],
        next: ["railbus doctor", "railbus doctor"],
    }
    Refused = "E0401" {
        title: ["refused: the module answered no", "被拒绝：模块答复不执行"],
        likely: ["wrong model in the configuration · a channel or value it does not have · its \
            host watchdog has tripped",
            "配置的型号不对 · 通道或值不存在 · 模块的主机看门狗已动作"],
        next: ["railbus scan", "railbus scan"],
    }
    AddressTaken = "E0440" {
        title: ["nothing written: somebody is at the new address", "未写入：新地址已被占用"],
        likely: ["a module that is not in the configuration", "有模块未列入配置"],
        next: ["railbus scan", "railbus scan"],
    }
    SettingRefused = "E0441" {
        title: ["the module refused the setting; it is as it was", "模块拒绝了该设置；设置未变"],
        likely: ["a value that this version of the module does not have", "该版本模块没有此值"],
        next: ["railbus config show MODULE", "railbus config show MODULE"],
    }
    WrongModel = "E0442" {
        title: ["nothing written: another model answers there", "未写入：应答的是另一型号"],
        likely: ["wrong model in the configuration · another module on that address",
            "配置的型号不对 · 该地址上是另一模块"],
        next: ["railbus scan", "railbus scan"],
    }
    Garbled = "E0501" {
        title: ["garbled: bytes came back that are no reply", "应答损坏：收到的字节不是有效应答"],
        likely: ["other baud or parity · two modules on one address · noise, bias or termination",
            "波特率或校验位不同 · 两个模块地址相同 · 干扰、偏置或终端电阻问题"],
        next: ["railbus scan", "railbus scan"],
    }
    NoProtocol = "E0502" {
        title: ["these bytes are no good frame", "这些字节不是正确的帧"],
        likely: ["a byte lost or changed · the checksum left out · bytes of two frames",
            "丢失或改变了字节 · 缺少校验和 · 混有两帧"],
        next: ["railbus decode --all", "railbus decode --all"],
    }
    TwoModules = "E0540" {
        title: ["nothing written: what answers there is not understood", "未写入：该处的应答无法理解"],
        likely: ["two modules on one address · noise · another speed",
            "两个模块地址相同 · 干扰 · 波特率不同"],
        next: ["railbus config recover --addr N     says how to part two modules",
            "railbus config recover --addr N     说明如何分开两个模块"],
    }
    NoSpeed = "E0580" {
        title: ["bytes were heard, but at no speed do they make frames",
            "听到字节，但任何波特率下都不成帧"],
        likely: ["another protocol · A and B swapped · a speed that is not tried here",
            "其他协议 · A/B 接反 · 未尝试的波特率"],
        next: ["railbus sniff --baud N -v", "railbus sniff --baud N -v"],
    }
    NotVerified = "E0601" {
        title: ["not verified: acknowledged, but read back otherwise", "未证实：已应答，但回读不一致"],
        likely: ["the output gives pulses and has released already · someone else switched it · \
            the module's own logic",
            "输出为点动方式且已断开 · 另有上位机操作 · 模块自身逻辑"],
        next: ["railbus get --fresh", "railbus get --fresh"],
    }
    SettingIgnored = "E0640" {
        title: ["the module did not take the setting; it is as it was", "模块未接受该设置；设置未变"],
        likely: ["the write was lost twice · the module wants a jumper or its maker's software \
            for this",
            "写入两次均丢失 · 该设置需要跳线或厂家软件"],
        next: ["railbus config show MODULE", "railbus config show MODULE"],
    }
    RolledBack = "E0641" {
        title: ["a part was refused: what was done was taken back", "部分被拒绝：已完成的部分已恢复原值"],
        likely: ["a value that this version of the module does not have", "该版本模块没有此值"],
        next: ["railbus config log", "railbus config log"],
    }
    Halfway = "E0642" {
        title: ["a part was done and could not be taken back", "部分已完成且无法恢复"],
        likely: ["the module takes some settings only at its next power-up",
            "模块的部分设置在下次上电时才生效"],
        next: ["railbus config recover", "railbus config recover"],
    }
    AtPowerUp = "E0643" {
        title: ["acknowledged, but not in force: it acts at the module's next power-up",
            "已应答但尚未生效：模块下次上电时生效"],
        likely: ["this version of the module reads its settings only when it starts",
            "该版本模块仅在启动时读取设置"],
        next: ["switch the module off and on, then: railbus config recover",
            "断电再上电，然后执行：railbus config recover"],
    }
    NoPowerCycle = "E0644" {
        title: ["the board did not take its address", "该板未接受新地址"],
        likely: ["it was not switched off and on in time · its DIP switch is not at 0",
            "未及时断电再上电 · 拨码开关不为 0"],
        next: ["set the DIP switch to 0, repeat, and switch it off and on when asked",
            "将拨码开关拨到 0，重新执行，并在提示时断电再上电"],
    }
    NotCalibrated = "E0645" {
        title: ["the calibration was not finished", "校准未完成"],
        likely: ["the module was switched off, or its inputs are out of range",
            "模块断电，或输入超出量程"],
        next: ["railbus config calibrate MODULE", "railbus config calibrate MODULE"],
    }
    Untold = "E0646" {
        title: ["not acknowledged, and the module does not tell what it keeps",
            "未应答，且模块不提供其保存的设置"],
        likely: ["the write was lost · it acts at the next power-up", "写入丢失 · 下次上电时生效"],
        next: ["switch the module off and on, then: railbus config recover MODULE",
            "断电再上电，然后执行：railbus config recover MODULE"],
    }
    Listen = "E0701" {
        title: ["a TCP address can't be listened on", "无法监听 TCP 地址"],
        likely: ["another program listens there · the port needs more rights",
            "已被其他程序占用 · 端口需要更高权限"],
        next: ["choose another port", "换一个端口"],
    }
    Pty = "E0702" {
        title: ["a PTY can't be made", "无法创建 PTY"],
        likely: ["none left, or /dev/pts is not mounted", "PTY 已用尽，或 /dev/pts 未挂载"],
        next: ["mount | grep devpts", "mount | grep devpts"],
    }
    ForeignPath = "E0703" {
        title: ["something else lies where the link to the PTY should", "PTY 链接的位置已有其他文件"],
        likely: ["a file of that name", "存在同名文件"],
        next: ["choose another path with --pty", "用 --pty 换一个路径"],
    }
    Link = "E0704" {
        title: ["the link to the PTY can't be made", "无法创建 PTY 链接"],
        likely: ["the directory is missing or not yours", "目录不存在或无权限"],
        next: ["choose another path with --pty", "用 --pty 换一个路径"],
    }
    PortMissing = "E0705" {
        title: ["the port is not there", "端口不存在"],
        likely: ["adapter not plugged in · another number after plugging it in again",
            "转换器未插好 · 重新插入后编号改变"],
        next: ["railbus ls ports", "railbus ls ports"],
    }
    PortBusy = "E0706" {
        title: ["the port is in use by another program", "端口被其他程序占用"],
        likely: ["a daemon or another master has it open; one line has one master",
            "守护进程或其他上位机已打开；一条总线只能有一个主机"],
        next: ["railbus ls ports", "railbus ls ports"],
    }
    PortDenied = "E0707" {
        title: ["you may not open the port", "无权打开端口"],
        likely: ["you are not in the group of the device, or did not log in again since",
            "未加入设备所属用户组，或加入后未重新登录"],
        next: ["sudo usermod -aG dialout $USER     then log in again",
            "sudo usermod -aG dialout $USER     然后重新登录"],
    }
    NotATty = "E0708" {
        title: ["this is no serial port", "这不是串口"],
        likely: ["a file or another kind of device has this name", "该名称是普通文件或其他设备"],
        next: ["railbus ls ports", "railbus ls ports"],
    }
    PortUnreachable = "E0709" {
        title: ["the serial server can't be reached", "无法连接串口服务器"],
        likely: ["it is off · wrong host or port · a firewall", "未上电 · 主机或端口有误 · 防火墙"],
        next: ["ping the host, and check its TCP port", "ping 该主机并检查 TCP 端口"],
    }
    LineClosed = "E0710" {
        title: ["the line is not open", "总线未打开"],
        likely: ["the adapter was pulled out · its driver fails", "转换器被拔出 · 驱动故障"],
        next: ["railbus ls lines", "railbus ls lines"],
    }
    SimControl = "E0790" {
        title: ["the simulator's control socket can't be used", "无法使用模拟器的控制套接字"],
        likely: ["no simulator serves it · another one does · the folder is missing or not yours",
            "没有模拟器在此服务 · 已被另一模拟器占用 · 目录不存在或无权限"],
        next: ["railbus sim plant.toml --control PATH", "railbus sim plant.toml --control 路径"],
    }
    NoModule = "E0801" {
        title: ["there is no such module or point", "没有该模块或点"],
        likely: ["a typing mistake · another configuration than meant", "输入错误 · 使用了别的配置"],
        next: ["railbus ls points", "railbus ls points"],
    }
    NoPoint = "E0802" {
        title: ["the module has no such point", "模块没有该点"],
        likely: ["labels are those printed on the module: do0, di0, k1, ai1",
            "标签与模块上所印一致：do0、di0、k1、ai1"],
        next: ["railbus ls points", "railbus ls points"],
    }
    NoLine = "E0803" {
        title: ["this names no line", "没有该总线"],
        likely: ["a typing mistake; a port is /dev/…, tcp:HOST:PORT, mbtcp:HOST or pty:/PATH",
            "输入错误；端口写作 /dev/…、tcp:HOST:PORT、mbtcp:HOST 或 pty:/PATH"],
        next: ["railbus ls lines", "railbus ls lines"],
    }
    Pulse = "E0804" {
        title: ["the module can't give this pulse", "模块无法给出此点动"],
        likely: ["EDA modules have one width for all outputs; 0x55 boards take 1 ms to 4 h 39 min; \
            the others have no timer",
            "EDA 模块各输出共用一个宽度；0x55 板为 1 ms 至 4 小时 39 分；其余没有定时器"],
        next: ["railbus pulse POINT DURATION --by host", "railbus pulse POINT DURATION --by host"],
    }
    Unsupported = "E0805" {
        title: ["not sent: this model has no such command", "未发送：该型号没有此命令"],
        likely: ["the family times no pulses or has no toggle, or another module on the line could \
            take the frame for a command",
            "该系列不能点动或翻转，或总线上其他模块可能误认此帧"],
        next: ["railbus ls models", "railbus ls models"],
    }
    BadValue = "E0806" {
        title: ["a point can't take this value", "该点不接受此值"],
        likely: ["outputs take on, off, toggle; inputs take nothing; variables take numbers",
            "输出接受 on、off、toggle；输入不可写；变量接受数字"],
        next: ["railbus set --help", "railbus set --help"],
    }
    NotAnOutput = "E0807" {
        title: ["the point is no output", "该点不是输出"],
        likely: ["inputs and analog values can only be read", "开关量输入和模拟量只能读取"],
        next: ["railbus ls points", "railbus ls points"],
    }
    BadFrame = "E0808" {
        title: ["the bytes are no read of that protocol", "这些字节不是该协议的读取命令"],
        likely: ["through the daemon raw only reads · a wrong checksum",
            "经守护进程时 raw 只能读取 · 校验和有误"],
        next: ["railbus decode", "railbus decode"],
    }
    NoConfig = "E0809" {
        title: ["there is no configuration", "没有配置"],
        likely: ["no railbus.toml here, in a parent folder, in ~/.config/railbus or /etc/railbus",
            "当前目录、上级目录、~/.config/railbus 和 /etc/railbus 中均无 railbus.toml"],
        next: ["name port and module: -l /dev/ttyUSB0 -m erc8 -a 3",
            "直接指定端口和模块：-l /dev/ttyUSB0 -m erc8 -a 3"],
    }
    BadConfig = "E0810" {
        title: ["the configuration has problems", "配置有问题"],
        likely: ["see each of them", "见各项说明"],
        next: ["correct the places named", "改正所指出的位置"],
    }
    ConfigSyntax = "E0811" {
        title: ["the configuration is no TOML", "配置不是有效的 TOML"],
        likely: ["a quote or bracket is missing", "缺少引号或括号"],
        next: ["look at the line and column named", "查看所指的行和列"],
    }
    ConfigKey = "E0812" {
        title: ["unknown key in the configuration", "配置中有未知的键"],
        likely: ["a typing mistake", "输入错误"],
        next: ["use the key that is suggested", "使用所建议的键"],
    }
    ConfigMissing = "E0813" {
        title: ["a key is missing in the configuration", "配置中缺少键"],
        likely: ["a line needs port; a module needs line, model and address",
            "line 需要 port；module 需要 line、model 和 address"],
        next: ["add the key", "补上该键"],
    }
    ConfigType = "E0814" {
        title: ["a value of the wrong kind in the configuration", "配置中值的类型不对"],
        likely: ["quotes around a number, or none around a text", "数字加了引号，或文本缺少引号"],
        next: ["write the kind that is named", "改为所要求的类型"],
    }
    ConfigChoice = "E0815" {
        title: ["a value that is none of the possible ones", "值不在可选范围内"],
        likely: ["a typing mistake · an unknown model", "输入错误 · 未知型号"],
        next: ["use one of the values listed", "使用列出的值之一"],
    }
    ConfigRange = "E0816" {
        title: ["a number out of its range in the configuration", "配置中数值超出范围"],
        likely: ["a typing mistake", "输入错误"],
        next: ["use a number within the bounds named", "使用所示范围内的数值"],
    }
    ConfigName = "E0817" {
        title: ["this can't be a name", "名称无效"],
        likely: ["names are 1 to 32 of a-z, 0-9 and _", "名称为 1 至 32 个 a-z、0-9 或 _"],
        next: ["choose another name; the name to show goes into name = {…}",
            "换一个名称；显示名写在 name = {…} 中"],
    }
    ConfigDuration = "E0818" {
        title: ["a time without its unit", "时间缺少单位"],
        likely: ["write 200ms, 1.5s, 2m", "应写作 200ms、1.5s、2m"],
        next: ["add the unit", "补上单位"],
    }
    ConfigAnalog = "E0819" {
        title: ["this is no range of an analog input", "模拟量量程无效"],
        likely: ["low is not below high", "下限不小于上限"],
        next: ["see range in the guide", "参见手册中的 range"],
    }
    ConfigLine = "E0820" {
        title: ["a module hangs on a line that is not there", "模块所属的总线不存在"],
        likely: ["a typing mistake in line =", "line = 有误"],
        next: ["add [line.NAME] or correct the name", "添加 [line.NAME] 或改正名称"],
    }
    ConfigPoint = "E0821" {
        title: ["a point that the module does not have", "模块没有该点"],
        likely: ["labels are those printed on the module: do0, di0, k1, ai1",
            "标签与模块上所印一致：do0、di0、k1、ai1"],
        next: ["railbus ls models", "railbus ls models"],
    }
    ConfigSetup = "E0822" {
        title: ["no module of this model can be as described", "该型号不可能如此设置"],
        likely: ["an address, speed, protocol or number of channels that the family does not have",
            "该系列没有此地址、波特率、协议或通道数"],
        next: ["railbus ls models", "railbus ls models"],
    }
    ConfigTwice = "E0823" {
        title: ["two modules on one address", "两个模块地址相同"],
        likely: ["copied without a change", "复制后未修改"],
        next: ["give one of them another address", "为其中一个更换地址"],
    }
    ConfigFile = "E0824" {
        title: ["the configuration can't be read", "无法读取配置"],
        likely: ["no such file · no right to read it", "文件不存在 · 无读取权限"],
        next: ["check the path given to --config", "检查 --config 的路径"],
    }
    ConfigPort = "E0825" {
        title: ["the value names no port", "该值不是端口名称"],
        likely: ["COM3 or ttyUSB0 without /dev/", "写成 COM3，或缺少 /dev/"],
        next: ["write /dev/ttyUSB0, tcp:HOST:PORT, mbtcp:HOST or pty:/PATH",
            "应写为 /dev/ttyUSB0、tcp:主机:端口、mbtcp:主机 或 pty:/路径"],
    }
    ConfigPortTwice = "E0826" {
        title: ["two lines on one port", "两条总线使用同一端口"],
        likely: ["copied without a change", "复制后未修改"],
        next: ["put the modules of both on one line", "将两者的模块放在一条总线下"],
    }
    NoSetting = "E0840" {
        title: ["the module has no such setting", "模块没有该设置"],
        likely: ["a typing mistake · another model", "输入错误 · 型号不同"],
        next: ["railbus config show MODULE", "railbus config show MODULE"],
    }
    SettingRange = "E0841" {
        title: ["the setting can't have this value", "该设置不能为此值"],
        likely: ["the family has other addresses, bauds or widths", "该系列的地址、波特率或宽度不同"],
        next: ["railbus config show MODULE     lists what each may be",
            "railbus config show MODULE     列出各项可选值"],
    }
    SettingFixed = "E0842" {
        title: ["no command changes this setting", "没有命令可更改该设置"],
        likely: ["the maker's software, a pin or a switch does", "由厂家软件、引脚或拨码开关决定"],
        next: ["railbus config show MODULE", "railbus config show MODULE"],
    }
    PortSpeed = "E0843" {
        title: ["nothing written: this port can't follow another speed or parity",
            "未写入：该端口无法改变波特率或校验位"],
        likely: ["a serial server keeps its own speed: the module would be lost",
            "串口服务器使用自身波特率：模块将无法访问"],
        next: ["change the server's speed by hand, or connect the module to a serial port",
            "手动更改服务器的波特率，或将模块接到串口"],
    }
    NotReadable = "E0844" {
        title: ["nothing written: the settings kept beside it can't be read",
            "未写入：无法读取同时保存的其他设置"],
        likely: ["an older EDA9060 has no pulses", "旧型 EDA9060 没有脉冲功能"],
        next: ["railbus config show MODULE", "railbus config show MODULE"],
    }
    UnsafeFrame = "E0845" {
        title: ["nothing written: a module of another protocol could take the frame for a command",
            "未写入：其他协议的模块可能误认此帧为命令"],
        likely: ["the address is 85, 76 or 36, which begin frames of other protocols",
            "地址 85、76 或 36 是其他协议的帧头"],
        next: ["choose another address", "选择其他地址"],
    }
    NoChange = "E0846" {
        title: ["there is no such change in the journal", "日志中没有该更改"],
        likely: ["another folder, or too long ago", "文件夹不同，或时间过久"],
        next: ["railbus config log", "railbus config log"],
    }
    CantUndo = "E0847" {
        title: ["this change can't be taken back", "该更改无法撤销"],
        likely: ["the old values are not known, as after a calibration", "原值未知，例如校准之后"],
        next: ["railbus config log", "railbus config log"],
    }
    BackupFile = "E0848" {
        title: ["this is no backup", "这不是备份文件"],
        likely: ["another file than meant · cut short", "文件有误 · 不完整"],
        next: ["railbus config backup -O site.json", "railbus config backup -O site.json"],
    }
    BackupSchema = "E0849" {
        title: ["the backup was written by another version", "备份由其他版本写成"],
        likely: ["made by an older or newer railbus", "由更旧或更新的 railbus 生成"],
        next: ["make a new backup with this version", "用此版本重新备份"],
    }
    BackupSite = "E0850" {
        title: ["the backup is of another site", "备份属于另一个站点"],
        likely: ["another configuration than the one it was made with", "与备份时的配置不同"],
        next: ["add --other-site if that is what you want", "确认无误后加 --other-site"],
    }
    NotAlone = "E0851" {
        title: ["not sent: more than one module answers on the line", "未发送：总线上不止一个模块应答"],
        likely: ["a broadcast would change all of them", "广播会更改所有模块"],
        next: ["take the module off the line and connect it alone", "将该模块单独接到总线上"],
    }
    NothingToDo = "E0852" {
        title: ["there is no module that this could be done with", "没有可执行此操作的模块"],
        likely: ["another line than meant · no module of that family in the configuration",
            "总线有误 · 配置中没有该系列的模块"],
        next: ["railbus ls", "railbus ls"],
    }
    ScanNotWritten = "E0870" {
        title: ["the modules found can't be written to the configuration", "无法将发现的模块写入配置"],
        likely: ["no right to the file or its folder · no room · a table written in one line",
            "文件或目录无权限 · 磁盘已满 · 配置中有单行表"],
        next: ["write them by hand, as railbus scan shows them", "按 railbus scan 的结果手动写入"],
    }
    ConfigFault = "E0890" {
        title: ["this is no fault to simulate", "不是可模拟的故障"],
        likely: ["a typing mistake · a value is missing", "输入错误 · 缺少数值"],
        next: ["railbus sim --help lists them", "railbus sim --help 列出所有故障"],
    }
    SimState = "E0891" {
        title: ["the settings kept of the simulated modules can't be used", "无法使用所保存的模拟模块设置"],
        likely: ["a file of something else, or of another plant · no right to it",
            "文件属于其他用途或其他工厂文件 · 无权限"],
        next: ["choose another file with --state", "用 --state 换一个文件"],
    }
    SimPlant = "E0892" {
        title: ["the plant can't be simulated so", "无法如此模拟该工厂文件"],
        likely: ["a flag names a line that is not there · there is nothing to simulate",
            "参数中的总线不存在 · 没有可模拟的总线"],
        next: ["railbus sim --help", "railbus sim --help"],
    }
    ConfigInput = "E0893" {
        title: ["a simulated level at a point that is no input", "模拟电平所在的点不是输入"],
        likely: ["outputs and variables belong to the module and its master", "输出和变量由模块和主机控制"],
        next: ["name an input: di0, k1 of a board of inputs, ai1", "使用输入点：di0、输入板的点、ai1"],
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_rise_and_lead_to_known_exit_codes() {
        let exits: Vec<u8> = Code::ALL.iter().map(|code| code.exit()).collect();
        assert!(exits.is_sorted());
        for exit in exits {
            let known = super::super::exits::EXITS.iter().any(|e| e.code == exit);
            assert!(known, "{exit}");
        }
        for pair in Code::ALL.windows(2) {
            let [a, b] = pair else { continue };
            assert!((a.name().len(), a.name()) < (b.name().len(), b.name()));
        }
    }

    #[test]
    fn every_page_is_written_in_both_languages() {
        for code in Code::ALL {
            let page = code.page();
            for [en, zh] in [page.title, page.likely, page.next] {
                assert!(!en.is_empty() && en.len() < 200, "{code:?}");
                assert!(!zh.is_empty(), "{code:?}");
            }
            assert!(
                !page.title[1].is_ascii() && !page.likely[1].is_ascii(),
                "{code:?}"
            );
        }
    }

    #[test]
    fn a_code_is_found_by_its_name() {
        assert_eq!(Code::from_name("e0301"), Some(Code::NoReply));
        assert_eq!(Code::from_name("E13001"), Some(Code::Interrupted));
        assert_eq!(Code::from_name("E9999"), None);
        assert_eq!(Code::Interrupted.exit(), 130);
        assert_eq!(Code::NoReply.exit(), 3);
    }
}
