//! Failures of a module: exit codes 3 to 6.

use super::{Code, GARBLED, codes};

codes! {
    NoReply = "E0301" {
        title: ["no reply within the time limit", "无应答：限定时间内未收到应答"],
        likely: ["module off · A/B swapped · other baud or protocol · address changed",
            "模块未上电 · A/B 接反 · 波特率或协议不同 · 地址已改"],
        next: ["railbus scan", "railbus scan"],
    }
    Unknown = "E0302" {
        title: ["the line was lost during the command; it may have taken effect",
            "命令执行中总线断开；命令可能已生效"],
        likely: ["the adapter was pulled out · its driver fails", "转换器被拔出 · 驱动故障"],
        next: ["plug it in, then: railbus get --fresh", "重新插入后执行：railbus get --fresh"],
    }
    KeyBegun = "E0303" {
        title: ["a command with this key was started before the daemon ended; its result is \
            unknown",
            "该幂等键的命令在守护进程退出前已开始，结果未知"],
        likely: ["the daemon was killed or lost power during the command",
            "命令进行中守护进程被终止或断电"],
        next: ["check the output, then repeat with a new key if needed",
            "先查看输出的实际状态，确需重发时换用新的幂等键"],
    }
    NotCurrent = "E0304" {
        title: ["the values of this site are not current", "该站点的数值不是当前值"],
        likely: ["the site or its connection is down · it has just connected",
            "站点或其网络中断 · 刚刚建立连接"],
        next: ["railbus fleet ls", "railbus fleet ls"],
    }
    Lost = "E0340" {
        title: ["the module is not found after the write", "写入后找不到该模块"],
        likely: ["it lost power · noise on the line · its settings are not those written",
            "期间断电 · 总线受干扰 · 实际采用的设置与写入的不同"],
        next: ["railbus config recover", "railbus config recover"],
    }
    NotFound = "E0341" {
        title: ["module not found", "未找到该模块"],
        likely: ["module off · on another line · A/B swapped",
            "未上电 · 在另一条总线上 · A/B 接反"],
        next: ["railbus scan", "railbus scan"],
    }
    NothingHeard = "E0380" {
        title: ["nothing was heard on the line", "总线上没有任何通信"],
        likely: ["no master is sending · A/B not connected · the adapter does not receive",
            "没有主站通信 · A/B 未接 · 转换器未在接收"],
        next: ["railbus doctor", "railbus doctor"],
    }
    Refused = "E0401" {
        title: ["refused by the module", "模块拒绝执行"],
        likely: ["wrong model in the configuration · a channel or value it does not have · its \
            host watchdog has tripped",
            "配置的型号不对 · 通道或值不存在 · 模块的主机看门狗已动作"],
        next: ["railbus scan", "railbus scan"],
    }
    OtherModel = "E0402" {
        title: ["another model replies in the module's place", "该处应答的是另一型号"],
        likely: ["a module was replaced by another model · two modules changed places · \
            wrong model in the configuration",
            "换上了另一型号的模块 · 两个模块装反 · 配置的型号不对"],
        next: ["put the right module in its place, or correct \"model\" in the configuration; if \
            the board is known to be compatible, set identify = false in [module.NAME]",
            "装回正确的模块，或更正配置中的 model；确知该板兼容时：在 [module.名称] 中设 identify = false"],
    }
    AddressTaken = "E0440" {
        title: ["nothing written: the new address is in use", "未写入：新地址已被占用"],
        likely: ["another module has this address", "已有其他模块使用该地址"],
        next: ["railbus scan", "railbus scan"],
    }
    SettingRefused = "E0441" {
        title: ["the module refused the setting; nothing changed", "模块拒绝了该设置；设置未变"],
        likely: ["a value that this version of the module does not have", "该版本模块没有此值"],
        next: ["railbus config show MODULE", "railbus config show MODULE"],
    }
    WrongModel = "E0442" {
        title: ["nothing written: a different model replied", "未写入：应答的是另一型号"],
        likely: ["wrong model in the configuration · another module on that address",
            "配置的型号不对 · 该地址上是另一模块"],
        next: ["railbus scan", "railbus scan"],
    }
    Confirm = "E0450" {
        title: ["not sent: this output requires confirmation", "未发送：该输出需要确认"],
        likely: ["confirm is set for this output", "配置中为其设置了 confirm"],
        next: ["repeat the command with --yes", "加 --yes 重新执行"],
    }
    Interlock = "E0451" {
        title: ["not sent: an interlocked output is on, or may be on",
            "未发送：与其互锁的输出已接通，或可能已接通"],
        likely: ["the other output is on · its module does not reply, so its state is unknown",
            "另一输出已接通 · 其模块无应答，状态未知"],
        next: ["switch the other one off first", "先断开另一输出"],
    }
    MinOff = "E0452" {
        title: ["not sent: the output must stay off a little longer", "未发送：该输出尚须保持断开"],
        likely: ["min_off in the configuration; after a start the time begins again",
            "配置中有 min_off · 启动后从头计时"],
        next: ["wait, then repeat the command", "稍候再试"],
    }
    Unwatched = "E0453" {
        title: ["not sent: max_on cannot be guaranteed without the daemon",
            "未发送：没有守护进程，无法保证到时断开"],
        likely: ["only the daemon enforces max_on", "max_on 只能由守护进程执行"],
        next: ["start railbus serve, then repeat without --direct",
            "先启动 railbus serve，再不带 --direct 重试"],
    }
    NoLease = "E0454" {
        title: ["the output has no lease", "该输出没有限时保持"],
        likely: ["the lease expired · another command took over", "限时保持已到期 · 已被其他命令接管"],
        next: ["railbus get", "railbus get"],
    }
    NotTried = "E0455" {
        title: ["not done because another part failed", "未执行：其他部分未成功"],
        likely: ["see the part that failed", "见失败的部分"],
        next: ["repeat the command once that is fixed", "排除后重新执行"],
    }
    Undone = "E0456" {
        title: ["done, then undone because another part failed", "已执行并恢复：其他部分失败"],
        likely: ["all-or-nothing was requested", "要求全部成功或全不执行"],
        next: ["see the part that failed", "见失败的部分"],
    }
    Playing = "E0457" {
        title: ["the scene is already running", "该场景正在执行"],
        likely: ["someone else has just started it", "刚由他人启动"],
        next: ["wait until it has finished", "等待其结束"],
    }
    SendConfirm = "E0458" {
        title: ["not sent: the frame may change something and was not confirmed",
            "未发送：此报文可能造成改变，尚未确认"],
        likely: ["it switches outputs, changes settings, is a broadcast, or overrides a lock",
            "会动作输出、更改设置、为广播，或越过锁定"],
        next: ["check what it may do, then add --yes, and --override if it overrides a lock",
            "看清其作用后再确认：加 --yes；要越过锁定则再加 --override"],
    }
    Garbled = "E0501" {
        title: ["garbled: the bytes received are not a valid reply", "应答损坏：收到的字节不是有效应答"],
        likely: GARBLED,
        next: ["railbus scan", "railbus scan"],
    }
    NoProtocol = "E0502" {
        title: ["not a valid frame", "不是有效的报文"],
        likely: ["a byte lost or changed · checksum missing · bytes of two frames",
            "丢失或改变了字节 · 缺少校验和 · 混有两条报文"],
        next: ["railbus decode --all", "railbus decode --all"],
    }
    TwoModules = "E0540" {
        title: ["nothing written: the reply from this address is not valid", "未写入：该地址的应答无效"],
        likely: ["two modules on one address · noise · another speed",
            "两个模块地址相同 · 干扰 · 波特率不同"],
        next: ["railbus config recover --addr N     shows how to separate two modules",
            "railbus config recover --addr N     说明如何分开两个模块"],
    }
    ScanNoise = "E0570" {
        title: ["scan aborted: the line is never idle", "扫描中止：总线始终不空闲"],
        likely: ["A/B swapped · no bias · a module stuck in transmit · another master",
            "A/B 接反 · 无偏置电阻 · 某模块持续发送 · 另有主站"],
        next: ["disconnect modules one by one, or swap A and B", "逐个断开模块，或对调 A、B"],
    }
    NoSpeed = "E0580" {
        title: ["bytes received, but no speed gives valid frames",
            "收到字节，但任何波特率下都不是有效报文"],
        likely: ["another protocol · A and B swapped · a speed not tried here",
            "其他协议 · A/B 接反 · 未尝试的波特率"],
        next: ["railbus sniff --baud N -v", "railbus sniff --baud N -v"],
    }
    NotVerified = "E0601" {
        title: ["not verified: acknowledged, but reads back differently", "回读不一致：已应答，但回读的状态与命令不同"],
        likely: ["the output is in pulse mode and is off again · someone else switched it · \
            the module's own logic",
            "输出为点动方式且已断开 · 另有主站操作 · 模块自身逻辑"],
        next: ["railbus get --fresh", "railbus get --fresh"],
    }
    SettingIgnored = "E0640" {
        title: ["the module did not accept the setting; nothing changed", "模块未接受该设置；设置未变"],
        likely: ["the write was lost twice · the module needs a jumper or the vendor's software \
            for this",
            "写入两次均丢失 · 该设置需要跳线或厂家软件"],
        next: ["railbus config show MODULE", "railbus config show MODULE"],
    }
    RolledBack = "E0641" {
        title: ["partly refused; what had been done was undone", "部分被拒绝：已完成的部分已恢复原值"],
        likely: ["a value that this version of the module does not have", "该版本模块没有此值"],
        next: ["railbus config log", "railbus config log"],
    }
    Halfway = "E0642" {
        title: ["partly failed; the part done could not be undone", "部分失败；已完成的部分无法恢复"],
        likely: ["some settings are not in effect yet; this model usually applies them at the \
            next power-up",
            "部分设置尚未生效；该型号通常在下次上电时采用"],
        next: ["railbus config recover", "railbus config recover"],
    }
    AtPowerUp = "E0643" {
        title: ["acknowledged, but not in effect yet",
            "已应答，但尚未生效"],
        likely: ["this model usually applies it at the next power-up · the module \
            acknowledged and did \
            nothing",
            "该型号通常在下次上电时采用 · 模块只应答而未执行"],
        next: ["power-cycle the module, then: railbus config recover",
            "断电再上电，然后执行：railbus config recover"],
    }
    NoPowerCycle = "E0644" {
        title: ["the board did not accept the new address", "该板未接受新地址"],
        likely: ["not power-cycled in time · DIP switch not at 0",
            "未及时断电再上电 · 拨码开关不为 0"],
        next: ["set the DIP switch to 0, repeat, and power-cycle the board when asked",
            "将拨码开关拨到 0，重新执行，并在提示时断电再上电"],
    }
    NotCalibrated = "E0645" {
        title: ["the calibration was not finished", "校准未完成"],
        likely: ["the module lost power, or its inputs are out of range",
            "模块断电，或输入超出量程"],
        next: ["railbus config calibrate MODULE", "railbus config calibrate MODULE"],
    }
    Untold = "E0646" {
        title: ["not acknowledged, and the setting can't be read back",
            "未应答，且该设置无法回读"],
        likely: ["the write was lost · not in effect yet: this model usually applies it at \
            the next power-up",
            "写入丢失 · 尚未生效：该型号通常在下次上电时采用"],
        next: ["power-cycle the module, then: railbus config recover MODULE",
            "断电再上电，然后执行：railbus config recover MODULE"],
    }
    NotUndone = "E0650" {
        title: ["partly failed; this part could not be undone",
            "部分失败；此部分已执行且无法恢复"],
        likely: ["its previous state is unknown · the module no longer replies",
            "原状态未知 · 模块已无应答"],
        next: ["railbus get --fresh", "railbus get --fresh"],
    }
}
