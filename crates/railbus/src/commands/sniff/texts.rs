//! The texts of `sniff`, `extcap` and `replay`.

railbus_words::texts! {
    pub(crate) SniffText;

    SniffAbout {
        en: "Listen to a line and decode its traffic. Never sends.",
        zh: "监听总线并解释通信内容，绝不发送。",
    }
    SniffExamples {
        en: "  railbus sniff -l /dev/ttyUSB0 --auto-baud
  railbus sniff --filter 'addr=3 and (bad or slow>50ms)'
  railbus sniff --write night.pcapng --time 8h
  railbus sniff --read night.pcapng -o ndjson
  railbus sniff --install-wireshark",
        zh: "  railbus sniff -l /dev/ttyUSB0 --auto-baud
  railbus sniff --filter 'addr=3 and (bad or slow>50ms)'
  railbus sniff --write night.pcapng --time 8h
  railbus sniff --read night.pcapng -o ndjson
  railbus sniff --install-wireshark",
    }
    AutoBaud { en: "Detect baud rate and parity by listening", zh: "自动识别波特率和校验位" }
    Write {
        en: "Write all frames to a capture file, also those that the filter hides",
        zh: "将所有报文写入抓包文件，不受过滤影响",
    }
    DecodeFile { en: "Read a capture file instead of bytes", zh: "解释抓包文件中的报文" }
    Read { en: "Read a capture file instead of a line", zh: "读取抓包文件，不监听总线" }
    FilterFlag {
        en: "Show only: addr=3, proto=rtu, module=pump, ok, bad, refused, unknown, missing, \
             late, request, reply, read, write, ambiguous, slow>50ms, gap>20ms; joined by and, \
             or, not, ( )",
        zh: "只显示：addr=3 proto=rtu module=pump ok bad refused unknown missing late request \
             reply read write ambiguous slow>50ms gap>20ms；用 and or not ( ) 组合",
    }
    Count { en: "Stop after this many frames", zh: "显示若干条报文后结束" }
    Time { en: "Stop after this time: 10s, 8h", zh: "监听若干时间后结束：10s、8h" }
    Install {
        en: "Install the Wireshark dissector and capture source",
        zh: "安装 Wireshark 解析器和抓包接口",
    }
    Folder { en: "Install to this folder instead of the user's own", zh: "安装到此目录，代替用户目录" }
    DryRun { en: "Only show what would be done", zh: "仅说明将做什么" }
    WouldWrite { en: "would write {path}", zh: "将写入 {path}" }
    Wrote { en: "wrote {path}", zh: "已写入 {path}" }
    ExtcapAbout { en: "Capture source for Wireshark.", zh: "供 Wireshark 从总线抓包。" }
    ExtcapFlag { en: "Of Wireshark's extcap interface", zh: "Wireshark extcap 接口" }
    ExtcapAny { en: "railbus: any RS-485 port", zh: "railbus：任意 RS-485 端口" }
    ExtcapPort { en: "Port", zh: "端口" }
    ExtcapBaud { en: "Baud", zh: "波特率" }
    Head { en: "TIME|Δ ms|DIR|PROTOCOL|ADDR|MEANING|BYTES", zh: "时间|间隔 ms|方向|协议|地址|含义|字节" }
    Listening {
        en: "listening only, never sending: {port}, {settings}",
        zh: "仅监听，绝不发送：{port}，{settings}",
    }
    ListeningDaemon {
        en: "listening to line {line} through the daemon; the line is not affected",
        zh: "经守护进程监听总线 {line}，不影响总线",
    }
    Summary {
        en: "{frames} frames, {exchanges} exchanges, {missing} unanswered, {bad} bad; line \
             busy {busy} %",
        zh: "{frames} 条报文，{exchanges} 次交换，{missing} 次无应答，{bad} 条损坏；总线占用 {busy} %",
    }
    Slowest {
        en: "slowest reply: address {address}, {time} ms",
        zh: "最慢应答：地址 {address}，{time} 毫秒",
    }
    Dropped { en: "events lost (program too slow): {count}", zh: "丢失 {count} 个事件：本程序过慢" }
    NothingToHear {
        en: "a Modbus TCP gateway does not allow listening to its line",
        zh: "Modbus TCP 网关无法监听其总线",
    }
    FileEnds { en: "it ends in the middle of a block", zh: "文件在数据块中间结束" }
    FileBroken { en: "at byte {at}: {why}", zh: "字节 {at} 处：{why}" }
    NoCapture { en: "not a pcapng file", zh: "不是 pcapng 文件" }
    BlockLength { en: "the length of a block is wrong", zh: "数据块长度有误" }
    BlockTooMuch { en: "a block is too long, or there are too many lines", zh: "数据块过长，或总线过多" }
    BlockLine { en: "a packet of a line that is not in the file", zh: "包所属的总线在文件中不存在" }
    BlockPacket { en: "a packet that is longer than its block", zh: "包比所在的数据块还长" }
    Skipped { en: "packets of other kinds skipped: {count}", zh: "略过 {count} 个其他类型的包" }

    // Auto-baud.
    Trying { en: "listening at {settings} …", zh: "以 {settings} 监听 …" }
    Found {
        en: "{settings} found after {time}: {good} of {all} bytes in valid frames; next \
             best {next}: {other}",
        zh: "{time} 后识别为 {settings}：{all} 字节中 {good} 字节属于有效报文；次优 {next}：{other}",
    }
    Sure { en: "sure", zh: "可靠" }
    Likely { en: "likely, but few frames were received", zh: "很可能，但收到的报文较少" }
    StopBits { en: "8N1 and 8N2 can't be distinguished by listening", zh: "仅凭监听无法区分 8N1 和 8N2" }
    NoParityHere { en: "this port does not report parity", zh: "此端口无法得知校验位" }

    // What was heard.

    Stowaway {
        en: "contains a complete command of {protocol}, which such a module on the line would \
            execute",
        zh: "其中含有完整的 {protocol} 命令，总线上的此类模块会执行",
    }

    // Filters.
    FilterWrong {
        en: "the filter, character {at} \"{near}\": {why}",
        zh: "过滤条件第 {at} 个字符 \"{near}\"：{why}",
    }
    FilterLong { en: "longer than 500 bytes", zh: "超过 500 字节" }
    FilterJoin { en: "expected \"and\" or \"or\"", zh: "此处应为 and 或 or" }
    FilterClose { en: "a \")\" is missing here", zh: "此处缺少 )" }
    FilterEnds { en: "something is missing here", zh: "此处缺少内容" }
    FilterWord {
        en: "unknown word; see railbus help sniff",
        zh: "未知的词，见 railbus help sniff",
    }
    FilterEquals { en: "expected \"=\" or \"!=\"", zh: "此处应为 = 或 !=" }
    FilterAddress {
        en: "expected an address from 0 to 255, as 10 or 0Ah",
        zh: "此处应为 0 到 255 的地址，如 10 或 0Ah",
    }
    FilterProtocol {
        en: "expected rtu, ascii, lc02 or r55",
        zh: "此处应为 rtu、ascii、lc02 或 r55",
    }
    FilterCompare { en: "expected \">\" or \"<\"", zh: "此处应为 > 或 <" }
    FilterTime {
        en: "expected a time with its unit: 50ms, 1.5s",
        zh: "此处应为带单位的时间：50ms、1.5s",
    }
}
