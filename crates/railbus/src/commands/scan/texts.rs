//! What the scan says.

crate::texts::texts! {
    ScanText;

    About { en: "Finds the modules on a line. It only reads.", zh: "扫描总线上的模块，只读取。" }
    Examples {
        en: "  railbus scan                            9600 baud, addresses 1-32, about 9 s
  railbus scan --full                     all addresses, about 77 s
  railbus scan --deep --add               five speeds, about 7 min; adds what it finds
  railbus scan -l /dev/ttyUSB0 --addr 1-247 --proto rtu --parity n,e
  railbus scan --follow -o ndjson         each module as soon as it is found",
        zh: "  railbus scan                            9600 波特，地址 1-32，约 9 秒
  railbus scan --full                     所有地址，约 77 秒
  railbus scan --deep --add               五种波特率，约 7 分钟；写入发现的模块
  railbus scan -l /dev/ttyUSB0 --addr 1-247 --proto rtu --parity n,e
  railbus scan --follow -o ndjson         每发现一个模块立即输出",
    }
    Quick { en: "The line's own speed, addresses 1-32 (if not said)", zh: "总线自身波特率，地址 1-32（默认）" }
    Full { en: "One speed, all addresses", zh: "一种波特率，所有地址" }
    Deep { en: "Five speeds, all addresses", zh: "五种波特率，所有地址" }
    Addr { en: "The addresses, such as 1-32,0x40", zh: "地址，如 1-32,0x40" }
    Proto {
        en: "The protocols: ascii,lc02,rtu,r55 if not said",
        zh: "协议：默认 ascii,lc02,rtu,r55",
    }
    Baud { en: "The speeds, such as 9600,19200", zh: "波特率，如 9600,19200" }
    AllBauds { en: "All speeds that modules have, 1200 to 38400", zh: "模块的所有波特率，1200 到 38400" }
    Parity { en: "Parity: n (if not said), e, o; Modbus only", zh: "校验位：n（默认）、e、o；仅限 Modbus" }
    Checksum {
        en: "ASCII checksum: auto (both, if not said), on or off",
        zh: "ASCII 校验和：auto（默认，两种都试）、on 或 off",
    }
    Describe {
        en: "Asks those found for maker, product and firmware version",
        zh: "询问所发现模块的厂商、产品和固件版本",
    }
    Follow { en: "Shows each module as soon as it is found", zh: "每发现一个模块立即显示" }
    Add {
        en: "Writes what is found to railbus.toml, after asking; uncertain ones with --model",
        zh: "将发现的模块写入 railbus.toml（先询问）；型号不确定的须加 --model",
    }
    Yes { en: "Writes without asking", zh: "不询问直接写入" }
    Outputs {
        en: "How many outputs the 0x55 boards have that are added: 1-32",
        zh: "所添加 0x55 板的输出路数：1-32",
    }
    Resume { en: "Goes on with a scan that was broken off", zh: "继续中断的扫描" }
    MaxTime { en: "Ends in time, and says what was left out", zh: "限时结束，并说明未扫描的部分" }

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
    Head { en: "ADDR|PROTOCOL|MODEL|DETAIL|RTT|VERDICT", zh: "地址|协议|型号|说明|往返|结果" }
    SpeedHead {
        en: "SPEED|ADDR|PROTOCOL|MODEL|DETAIL|RTT|VERDICT",
        zh: "波特率|地址|协议|型号|说明|往返|结果",
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
        en: "several 0x55 boards answer at other addresses: railbus scan --full --proto r55",
        zh: "多块 0x55 板同时应答，地址不在范围内：railbus scan --full --proto r55",
    }
    Skipped {
        en: "{count} questions left out: another module could take them for a command",
        zh: "跳过 {count} 次询问：其他模块可能误认为命令",
    }
    NextAdd { en: "next:  railbus scan --add                  writes these to railbus.toml",
        zh: "下一步：railbus scan --add                  写入 railbus.toml" }
    NextModel {
        en: "next:  railbus scan --addr {addr} --add --model {model}    if its label says so",
        zh: "下一步：railbus scan --addr {addr} --add --model {model}    若铭牌上是此型号",
    }
    NextRecover {
        en: "next:  railbus config recover --addr {addr}    says how to part two on one address",
        zh: "下一步：railbus config recover --addr {addr}    说明如何分开地址相同的两个模块",
    }
    NextPart {
        en: "two modules at address {addrs}? switch one of them off, or connect one at a time; then:
       railbus scan --add; railbus config set MODULE address=FREE; then connect the other again",
        zh: "地址 {addrs} 上有两个模块？请关闭其中一个，或逐个接入；然后：
        railbus scan --add；railbus config set 模块 address=空闲地址；再接回另一个",
    }
    NextResume { en: "next:  railbus scan --resume               goes on from here",
        zh: "下一步：railbus scan --resume               从此处继续" }

    ChecksumOn { en: "checksum on", zh: "有校验和" }
    ChecksumOff { en: "checksum off", zh: "无校验和" }
    Channels { en: "{outputs} outputs, {inputs} inputs", zh: "{outputs} 路输出，{inputs} 路输入" }
    CoilsAt60 { en: "8 coils at 60, no identity register", zh: "60 起 8 个线圈，无型号寄存器" }
    VersionIs { en: "version {version}", zh: "版本 {version}" }
    AtLeast { en: "at least {count} channels", zh: "至少 {count} 路" }
    AllOff { en: "no channel is on", zh: "所有通道均为断开" }
    Differ { en: "replies differ, wrong {tries} of {tries}", zh: "应答不一致，{tries} 次中 {tries} 次有误" }
    Wrong { en: "replies wrong {tries} of {tries}", zh: "{tries} 次应答中 {tries} 次有误" }
    Twice { en: "two replies to one question", zh: "一次询问收到两个应答" }
    Says { en: "says \"{text}\"", zh: "自述“{text}”" }
    AsciiWithChecksum { en: "ascii with checksum", zh: "ascii（带校验和）" }
    KnownAs { en: "module {name}", zh: "即 {name}" }
    NotAsConfigured { en: "{name} is another model in the configuration", zh: "与配置中的 {name} 不符" }
    VerdictOk { en: "ok", zh: "正常" }
    VerdictBehaves { en: "ok (by behaviour)", zh: "正常（按行为判断）" }
    VerdictRefused { en: "refused: it is there but answers no", zh: "拒绝：在线但不执行" }
    VerdictCouldBe { en: "could be {models}: nothing proves it", zh: "可能是 {models}，无法证实" }
    VerdictOdd { en: "stranger: no model that railbus knows", zh: "未知模块：不是 railbus 支持的型号" }
    VerdictGarbled {
        en: "garbled: two modules on one address?",
        zh: "损坏：两个模块地址相同？",
    }

    NothingToAsk {
        en: "no module speaks so: 0x55 boards have 9600 8N1, ASCII and LC-02 no parity",
        zh: "没有模块如此通信：0x55 板仅 9600 8N1，ASCII 和 LC-02 无校验位",
    }
    OtherScan { en: "it was: {options}", zh: "原扫描为：{options}" }
    NothingNew { en: "nothing to write: no module that is new and known", zh: "无可写入：没有新的已识别模块" }
    WillWrite { en: "to be added to {file}:", zh: "将添加到 {file}：" }
    AskWrite { en: "write this? [y/N] ", zh: "是否写入？[y/N] " }
    Written { en: "{count} modules written to {file}", zh: "{count} 个模块已写入 {file}" }
    OutputsGuessed {
        en: "{names}: written with {count} outputs: a 0x55 board does not report how many it has;
set outputs in [module.…], or add with --outputs N",
        zh: "{names}：已按 {count} 路输出写入，0x55 板不报告路数；
请修改 [module.…] 的 outputs，或用 --outputs N 添加",
    }
    NotWritten { en: "nothing was written", zh: "未写入" }
    NotRightText { en: "the file would no longer be a configuration", zh: "文件将不再是有效配置" }
}
