//! What a module did or did not: exit codes 3 to 6.

use super::{Code, codes};

codes! {
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
    KeyBegun = "E0303" {
        title: ["begun under this key before the daemon ended; nobody knows how it ended",
            "该幂等键的命令在守护进程退出前已开始，结果未知"],
        likely: ["the daemon was killed, or the power failed, during the command",
            "命令进行中守护进程被终止或断电"],
        next: ["look at the output, then repeat under a new key if need be",
            "先查看输出的实际状态，确需重发时换用新的幂等键"],
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
            "没有上位机通信 · A/B 未接 · 转换器未在接收"],
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
    Confirm = "E0450" {
        title: ["not sent: the output wants to be told that this is meant", "未发送：该输出需要确认"],
        likely: ["confirm is set for it in the configuration", "配置中为其设置了 confirm"],
        next: ["repeat the command with --yes", "加 --yes 重新执行"],
    }
    Interlock = "E0451" {
        title: ["not sent: an output that excludes this one is on, or may be",
            "未发送：与其互锁的输出已接通，或可能已接通"],
        likely: ["the other one is on · its module does not answer, so nobody knows",
            "另一输出已接通 · 其模块无应答，状态未知"],
        next: ["switch the other one off first", "先断开另一输出"],
    }
    MinOff = "E0452" {
        title: ["not sent: the output must stay off for a while yet", "未发送：该输出尚须保持断开"],
        likely: ["min_off of the configuration · after a start the time counts from there",
            "配置中有 min_off · 启动后从头计时"],
        next: ["wait a moment, then repeat the command", "稍候再试"],
    }
    Unwatched = "E0453" {
        title: ["not sent: nobody would switch the output off when its time is over",
            "未发送：到时没有程序断开该输出"],
        likely: ["max_on is kept by the daemon only", "max_on 只能由守护进程执行"],
        next: ["railbus serve, then without --direct", "railbus serve，然后不带 --direct"],
    }
    NoLease = "E0454" {
        title: ["nobody holds the output", "该输出未被租用"],
        likely: ["the lease ran out · another command took it over", "租约已到期 · 被其他命令接管"],
        next: ["railbus get", "railbus get"],
    }
    NotTried = "E0455" {
        title: ["not done, because another part was not", "未执行：其他部分未成功"],
        likely: ["see the part that failed", "见失败的部分"],
        next: ["repeat the command when that is mended", "排除后重新执行"],
    }
    Undone = "E0456" {
        title: ["done and taken back, because another part failed", "已执行并恢复：其他部分失败"],
        likely: ["all or nothing was asked for", "要求全部成功或全不执行"],
        next: ["see the part that failed", "见失败的部分"],
    }
    Playing = "E0457" {
        title: ["the scene is being played already", "该场景正在执行"],
        likely: ["somebody else has just started it", "刚由他人启动"],
        next: ["wait until it has ended", "等待其结束"],
    }
    SendConfirm = "E0458" {
        title: ["not sent: the frame may change something, and nobody said that this is meant",
            "未发送：此帧可能造成改变，尚未确认"],
        likely: ["it switches outputs, changes settings, is for all modules, or goes past a lock",
            "会动作输出、更改设置、面向所有模块，或越过锁定"],
        next: ["read what it may do, then say so: --yes, and --override where it goes past a lock",
            "看清其作用后再确认：加 --yes；要越过锁定则再加 --override"],
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
    ScanNoise = "E0570" {
        title: ["scan given up: the line is never silent", "放弃扫描：总线上一直有干扰"],
        likely: ["A/B swapped · no bias · a module that never stops sending · another master",
            "A/B 接反 · 无偏置电阻 · 某模块不停发送 · 另有上位机"],
        next: ["take modules off the line one by one, or swap A and B", "逐个断开模块，或对调 A、B"],
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
        title: ["acknowledged, but not in force: perhaps at the module's next power-up",
            "已应答但尚未生效：可能在模块下次上电时生效"],
        likely: ["this version of the module reads its settings only when it starts · \
            it says yes and does nothing",
            "该版本模块仅在启动时读取设置 · 模块只应答而未执行"],
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
    NotUndone = "E0650" {
        title: ["done, and could not be taken back though another part failed",
            "已执行且无法恢复，尽管其他部分失败"],
        likely: ["its state before is not known · the module does not answer any more",
            "原状态未知 · 模块已无应答"],
        next: ["railbus get --fresh", "railbus get --fresh"],
    }
}
