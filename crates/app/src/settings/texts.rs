//! Texts about changes of settings, for commands and gateway.

railbus_words::texts! {
    pub SettingsText;

    NoteWritten { en: "in EEPROM; in effect after the reply", zh: "存于 EEPROM；应答后生效" }
    NoteAtPowerUp {
        en: "in EEPROM; writable only within 10 s of power-up, DIP switch at 0",
        zh: "存于 EEPROM；仅在上电 10 秒内、拨码为 0 时可写",
    }
    NoteMaker { en: "only with the vendor's software", zh: "只能用厂家软件更改" }
    NoteInit {
        en: "set by the INIT* pin: open is ascii, grounded is lc02",
        zh: "由 INIT* 引脚决定：悬空为 ascii，接地为 lc02",
    }
    NoteInAscii { en: "only while the module speaks ascii", zh: "仅在模块使用 ascii 协议时可改" }
    NoteFixed { en: "fixed", zh: "固定" }
    WithChecksum { en: "checksum", zh: "带校验和" }
    NothingWritten { en: "nothing written", zh: "未写入任何内容" }
    TwoSpeeds {
        en: "modules on line \"{line}\" that keep their settings: {count}; each poll \
            of \"{module}\" then needs two speed changes",
        zh: "此后总线 \"{line}\" 上另有 {count} 个模块保持原设置，每次轮询 \"{module}\" 需切换两次波特率",
    }
    TwoChecksums {
        en: "ASCII modules with the other checksum setting: {count}; it should \
            be the same on the whole line",
        zh: "另有 {count} 个 ASCII 模块的校验和状态不同；整条总线应保持一致",
    }
    Reserved { en: "Modbus reserves the addresses 248 to 255", zh: "Modbus 保留地址 248 至 255" }
    Address85 {
        en: "requests to address 85 (55h) start like those to the 0x55 boards of this line",
        zh: "发往地址 85（55h）的请求与本总线 0x55 板的首字节相同",
    }
    BoardNeedsPower {
        en: "the board accepts it only within 10 s of power-up: you will be asked \
            to power-cycle it; its DIP switch must be at 0",
        zh: "该板仅在上电 10 秒内接受：届时请按提示断电再上电；拨码开关须为 0",
    }
    WriteByHand {
        en: "update address and baud of [module.{module}] to {place}",
        zh: "请将 [module.{module}] 的地址和波特率改为 {place}",
    }
    CallsItself { en: "it identifies itself as {name}", zh: "其报告的型号为 {name}" }
    NotAsModel { en: "its replies do not match that model", zh: "其应答与该型号不符" }
    TakenBy { en: "at {place} in {protocol}: {module}", zh: "位于 {place}，协议 {protocol}：{module}" }
    TakenGarbled { en: "the reply was not valid: there may be two modules", zh: "应答无效：可能有两个模块" }
    ReadsOtherwise { en: "acknowledged, but reads back differently", zh: "已应答，但回读不一致" }
    NotAcknowledged { en: "not acknowledged", zh: "未得到应答" }
    StateDone { en: "done", zh: "完成" }
    StateIntent { en: "interrupted: railbus config recover", zh: "中断：railbus config recover" }
    StatePending { en: "not in effect yet", zh: "尚未生效" }
    StateUnchanged { en: "not accepted, unchanged", zh: "未接受，未改变" }
    StateRolledBack { en: "undone", zh: "已恢复原值" }
    StateElsewhere { en: "unexpected values (neither old nor new)", zh: "值异常（既非原值也非新值）" }
    StateLost { en: "not found: railbus config recover", zh: "找不到：railbus config recover" }
    StateUntold { en: "unknown: can't be read back", zh: "未知：无法回读" }
    PartBoards {
        en: "to separate two boards: disconnect one; railbus config set {module} \
            address=FREE, and power-cycle the other when asked; then reconnect the first, \
            now alone at {address}",
        zh: "分开两块板：将其中一块从总线断开；执行 railbus config set {module} address=空闲地址，\
            按提示将另一块断电再上电；然后接回第一块，地址 {address} 上只剩它",
    }
    PartByPin {
        en: "to separate two modules: ground INIT* of one, which then uses lc02 and \
            leaves the other alone at {address}; railbus config set {module} address=FREE; \
            then open INIT* again",
        zh: "分开两个模块：将其中一个的 INIT* 接地，它改用 lc02，地址 {address} \
            上只剩另一个；执行 railbus config set {module} address=空闲地址；然后断开 \
            INIT*",
    }
    PartByPlug {
        en: "to separate two modules: unplug one; railbus config set {module} address=FREE; \
            then reconnect it, now alone at {address}",
        zh: "分开两个模块：拔下其中一个；执行 railbus config set {module} address=空闲地址；然后重新插上，地址 {address} 上只剩它",
    }
}
