//! The texts of `railbus scan`.

railbus_words::texts! {
    pub(crate) ScanText;

    About { en: "Find the modules on a line. Read-only.", zh: "扫描总线上的模块，只读取。" }
    Examples {
        en: "  railbus scan                            9600 baud, addresses 1-32, about 9 s
  railbus scan --full                     all addresses, about 77 s
  railbus scan --deep --add               five speeds, about 7 min; add those found
  railbus scan -l /dev/ttyUSB0 --addr 1-247 --proto rtu --parity n,e
  railbus scan --follow -o ndjson         each module as soon as it is found",
        zh: "  railbus scan                            9600 波特，地址 1-32，约 9 秒
  railbus scan --full                     所有地址，约 77 秒
  railbus scan --deep --add               五种波特率，约 7 分钟；写入发现的模块
  railbus scan -l /dev/ttyUSB0 --addr 1-247 --proto rtu --parity n,e
  railbus scan --follow -o ndjson         每发现一个模块立即输出",
    }
    Quick { en: "The line's own speed, addresses 1-32 (default)", zh: "总线自身波特率，地址 1-32（默认）" }
    Full { en: "One speed, all addresses", zh: "一种波特率，所有地址" }
    Deep { en: "Five speeds, all addresses", zh: "五种波特率，所有地址" }
    Addr { en: "Addresses, such as 1-32,0x40", zh: "地址，如 1-32,0x40" }
    Proto {
        en: "Protocols; default ascii,lc02,rtu,r55",
        zh: "协议：默认 ascii,lc02,rtu,r55",
    }
    Baud { en: "Speeds, such as 9600,19200", zh: "波特率，如 9600,19200" }
    AllBauds { en: "All speeds that modules have, 1200 to 38400", zh: "模块的所有波特率，1200 到 38400" }
    Parity { en: "Parity: n (default), e, o; Modbus only", zh: "校验位：n（默认）、e、o；仅限 Modbus" }
    Checksum {
        en: "ASCII checksum: auto (default, both), on or off",
        zh: "ASCII 校验和：auto（默认，两种都试）、on 或 off",
    }
    Describe {
        en: "Ask the modules found for vendor, product and firmware version",
        zh: "查询所发现模块的厂商、产品和固件版本",
    }
    Follow { en: "Show each module as soon as it is found", zh: "每发现一个模块立即显示" }
    Add {
        en: "Add the modules found to railbus.toml, after asking; uncertain ones need --model",
        zh: "将发现的模块写入 railbus.toml（须确认）；型号不确定的须加 --model",
    }
    Yes { en: "Add without asking", zh: "不询问直接写入" }
    Outputs {
        en: "How many outputs the 0x55 boards have that are added: 1-32",
        zh: "所添加 0x55 板的输出路数：1-32",
    }
    Resume { en: "Resume an interrupted scan", zh: "继续中断的扫描" }
    MaxTime { en: "Stop in time, and list what was left out", zh: "限时结束，并说明未扫描的部分" }

    Begin {
        en: "line {line}  {settings}   read-only scan, {depth}, about {time}",
        zh: "总线 {line}  {settings}   只读扫描，{depth}，约 {time}",
    }
    QuickWord { en: "quick", zh: "快速" }
    FullWord { en: "full", zh: "完整" }
    DeepWord { en: "deep", zh: "深度" }
    Progress {
        en: "{bar}  {done}/{total}  {percent} %   found {found}   {left} left   (Ctrl-C keeps it)",
        zh: "{bar}  {done}/{total}  {percent} %   已发现 {found}   剩余 {left}   （Ctrl-C 保留结果）",
    }
    Head { en: "ADDR|PROTOCOL|MODEL|DETAIL|RTT|VERDICT", zh: "地址|协议|型号|说明|响应时间|结果" }
    SpeedHead {
        en: "SPEED|ADDR|PROTOCOL|MODEL|DETAIL|RTT|VERDICT",
        zh: "波特率|地址|协议|型号|说明|响应时间|结果",
    }
    Summary {
        en: "{found} found, {conflicts} in conflict, {silent} silent, {state}; {time}",
        zh: "发现 {found} 个，冲突 {conflicts} 个，无应答 {silent} 个，{state}；{time}",
    }
    Complete { en: "complete", zh: "已完成" }
    Incomplete { en: "not complete", zh: "未完成" }
    LeftOut { en: "left out: {what}", zh: "未扫描：{what}" }
    LeftPart { en: "{settings} {proto} {addresses}", zh: "{settings} {proto} 地址 {addresses}" }
    Missing { en: "in the configuration, but silent: {names}", zh: "配置中有但无应答：{names}" }
    Crowd {
        en: "several 0x55 boards reply at other addresses: railbus scan --full --proto r55",
        zh: "多块 0x55 板同时应答，地址不在范围内：railbus scan --full --proto r55",
    }
    Skipped {
        en: "requests left out, as another module could take them for a command: {count}",
        zh: "跳过 {count} 次请求：其他模块可能误认为命令",
    }
    NextSlow {
        en: "next:  {command}      waits for others: modules here reply slowly",
        zh: "下一步：{command}      等待其他模块：此总线上的模块应答较慢",
    }
    NextAdd { en: "next:  railbus scan --add                  adds these to railbus.toml",
        zh: "下一步：railbus scan --add                  写入 railbus.toml" }
    NextModel {
        en: "next:  railbus scan --addr {addr} --add --model {model}    if its label says so",
        zh: "下一步：railbus scan --addr {addr} --add --model {model}    若铭牌上是此型号",
    }
    NextRecover {
        en: "next:  railbus config recover --addr {addr}    shows how to separate two modules \
            on one address",
        zh: "下一步：railbus config recover --addr {addr}    说明如何分开地址相同的两个模块",
    }
    NextPart {
        en: "two modules at address {addrs}? Switch one of them off, or connect one at a time; then:
       railbus scan --add; railbus config set MODULE address=FREE; then connect the other again",
        zh: "地址 {addrs} 上有两个模块？请关闭其中一个，或逐个接入；然后：
        railbus scan --add；railbus config set 模块 address=空闲地址；再接回另一个",
    }
    NextResume { en: "next:  railbus scan --resume               continues from here",
        zh: "下一步：railbus scan --resume               从此处继续" }

    ChecksumOn { en: "checksum on", zh: "有校验和" }
    ChecksumOff { en: "checksum off", zh: "无校验和" }
    Channels { en: "{outputs} outputs, {inputs} inputs", zh: "{outputs} 路输出，{inputs} 路输入" }
    CoilsAt60 { en: "8 coils at 60, no identity register", zh: "60 起 8 个线圈，无型号寄存器" }
    VersionIs { en: "version {version}", zh: "版本 {version}" }
    AtLeast { en: "at least {count} channels", zh: "至少 {count} 路" }
    AllOff { en: "no channel is on", zh: "所有通道均为断开" }
    Differ { en: "replies differ, {tries} of {tries} wrong", zh: "应答不一致，{tries} 次中 {tries} 次有误" }
    Wrong { en: "{tries} of {tries} replies wrong", zh: "{tries} 次应答中 {tries} 次有误" }
    Twice { en: "two replies to one request", zh: "一次请求收到两个应答" }
    Says { en: "says \"{text}\"", zh: "自报“{text}”" }
    AsciiWithChecksum { en: "ascii with checksum", zh: "ascii（带校验和）" }
    KnownAs { en: "module {name}", zh: "已配置为 {name}" }
    NotAsConfigured { en: "{name} is another model in the configuration", zh: "与配置中的 {name} 不符" }
    VerdictOk { en: "ok", zh: "正常" }
    VerdictBehaves { en: "ok (by behaviour)", zh: "正常（按行为判断）" }
    VerdictRefused { en: "refused: present, but refuses", zh: "拒绝：在线但不执行" }
    VerdictCouldBe { en: "could be {models}; not proven", zh: "可能是 {models}，无法确定" }
    VerdictOdd { en: "unexpected reply: not a known model", zh: "未知模块：不是 railbus 支持的型号" }
    VerdictGarbled {
        en: "garbled: two modules on one address?",
        zh: "损坏：两个模块地址相同？",
    }

    NothingToAsk {
        en: "impossible combination: 0x55 boards use 9600 8N1, ASCII and LC-02 no parity",
        zh: "组合无效：0x55 板仅 9600 8N1，ASCII 和 LC-02 无校验位",
    }
    OtherScan { en: "the earlier scan: {options}", zh: "原扫描为：{options}" }
    NothingNew { en: "nothing new to add", zh: "没有可添加的新模块" }
    WillWrite { en: "to be added to {file}:", zh: "将添加到 {file}：" }
    AskWrite { en: "Write this? [y/N] ", zh: "是否写入？[y/N] " }
    Written { en: "added to {file}: {names}", zh: "已添加到 {file}：{names}" }
    OutputsGuessed {
        en: "{names}: added with {count} outputs; a 0x55 board does not report how many it has;
set outputs in [module.…], or add with --outputs N",
        zh: "{names}：已按 {count} 路输出写入，0x55 板不报告路数；
请修改 [module.…] 的 outputs，或用 --outputs N 添加",
    }
    NotWritten { en: "nothing written", zh: "未写入" }
    NotRightText { en: "the file would no longer be a valid configuration", zh: "文件将不再是有效配置" }
}
