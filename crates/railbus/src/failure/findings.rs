//! What `doctor` and `config check` may find, by its code: one table, which they and `explain`
//! read. D1 is the machine and its ports, D2 the line, D3 modules, D5 the daemon; L is what the
//! configuration allows and is still unwise.

use super::codes::Page;

/// A kind of finding.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Finding {
    pub(crate) code: &'static str,
    pub(crate) page: Page,
}

/// The finding of this code.
pub(crate) fn find(code: &str) -> Option<&'static Finding> {
    ALL.iter()
        .find(|known| known.code.eq_ignore_ascii_case(code))
}

const fn finding(
    code: &'static str,
    title: [&'static str; 2],
    likely: [&'static str; 2],
    next: [&'static str; 2],
) -> Finding {
    Finding {
        code,
        page: Page {
            title,
            likely,
            next,
        },
    }
}

/// All of them, by code.
pub(crate) const ALL: &[Finding] = &[
    finding(
        "D101",
        ["the clock is wrong", "时钟不对"],
        [
            "a machine without a clock battery that has not met a time server yet",
            "没有时钟电池的机器尚未与时间服务器同步",
        ],
        ["timedatectl set-ntp true", "timedatectl set-ntp true"],
    ),
    finding(
        "D102",
        ["you may not open the port", "无权打开端口"],
        [
            "you are not in the group of the device",
            "未加入设备所属用户组",
        ],
        [
            "sudo usermod -aG GROUP $USER, then log in again",
            "sudo usermod -aG 用户组 $USER，然后重新登录",
        ],
    ),
    finding(
        "D103",
        ["the port is not there", "端口不存在"],
        [
            "adapter not plugged in · another number after plugging it in again",
            "转换器未插好 · 重新插入后编号改变",
        ],
        ["railbus ls ports", "railbus ls ports"],
    ),
    finding(
        "D104",
        ["another program has the port", "端口被其他程序占用"],
        ["one line has one master", "一条总线只能有一个上位机"],
        [
            "stop that program, or let it be the only one",
            "停止该程序，或只由它使用",
        ],
    ),
    finding(
        "D105",
        [
            "ModemManager tries this adapter when it is plugged in",
            "ModemManager 会在插入时试探该转换器",
        ],
        [
            "it takes any serial adapter for a modem, and sends AT commands to your modules",
            "它把串口转换器当作调制解调器，并向模块发送 AT 命令",
        ],
        [
            "railbus doctor D105 --fix: a udev rule, shown first",
            "railbus doctor D105 --fix：udev 规则，先显示后执行",
        ],
    ),
    finding(
        "D106",
        [
            "the FTDI adapter keeps what it hears",
            "FTDI 转换器延迟转交数据",
        ],
        [
            "its latency timer: each reply may come that much later",
            "其延迟定时器：每个应答可能晚到这么久",
        ],
        ["railbus doctor D106 --fix", "railbus doctor D106 --fix"],
    ),
    finding(
        "D107",
        [
            "the configuration uses a name that changes",
            "配置使用了会改变的端口名",
        ],
        [
            "ttyUSB0 is whatever was plugged in first",
            "ttyUSB0 是最先插入的设备",
        ],
        [
            "write the stable name, see railbus ls ports",
            "改用固定名称，见 railbus ls ports",
        ],
    ),
    finding(
        "D108",
        [
            "brltty takes CH340 adapters for Braille displays",
            "brltty 会把 CH340 转换器当作盲文显示器",
        ],
        [
            "they have the same USB numbers, and the port vanishes as soon as it is there",
            "两者 USB 编号相同，端口出现后随即消失",
        ],
        [
            "railbus doctor D108 --fix, or remove brltty",
            "railbus doctor D108 --fix，或卸载 brltty",
        ],
    ),
    finding(
        "D109",
        [
            "you did not log in again since you came into the group",
            "加入用户组后尚未重新登录",
        ],
        [
            "a login keeps the groups that it began with",
            "登录会话沿用登录时的用户组",
        ],
        [
            "log out and in again, or: newgrp GROUP",
            "注销后重新登录，或执行 newgrp 用户组",
        ],
    ),
    finding(
        "D110",
        ["the locale is not UTF-8", "语言环境不是 UTF-8"],
        [
            "LANG=C or none at all: Chinese names can't be shown",
            "LANG=C 或未设置：无法显示中文名称",
        ],
        ["export LANG=C.UTF-8", "export LANG=C.UTF-8"],
    ),
    finding(
        "D111",
        ["this is no serial port", "这不是串口"],
        [
            "a file or another kind of device has this name",
            "该名称是普通文件或其他设备",
        ],
        ["railbus ls ports", "railbus ls ports"],
    ),
    finding(
        "D112",
        ["the serial server can't be reached", "无法连接串口服务器"],
        [
            "it is off · wrong host or port · a firewall",
            "未上电 · 主机或端口有误 · 防火墙",
        ],
        [
            "ping the host, and check its TCP port",
            "ping 该主机并检查 TCP 端口",
        ],
    ),
    finding(
        "D113",
        ["the port fails", "端口故障"],
        [
            "the adapter was pulled out · its driver fails",
            "转换器被拔出 · 驱动故障",
        ],
        [
            "plug it in again, and look at dmesg",
            "重新插入并查看 dmesg",
        ],
    ),
    finding(
        "D201",
        [
            "bytes on the line though nobody was asked",
            "无人询问时总线上有字节",
        ],
        [
            "bias or termination missing · A/B swapped · a machine nearby that disturbs",
            "缺少偏置或终端电阻 · A/B 接反 · 附近设备干扰",
        ],
        [
            "measure A against B while idle: 0.2 V or more; bias at one place, termination at both \
             ends",
            "空闲时测量 A 对 B 电压：应在 0.2 V 以上；偏置只在一处，终端电阻在两端",
        ],
    ),
    finding(
        "D202",
        ["another master talks on the line", "总线上另有上位机"],
        [
            "a PLC, another program or another adapter polls the same modules",
            "PLC、其他程序或其他转换器在轮询同一批模块",
        ],
        [
            "one line has one master: take the other one off, or only listen",
            "一条总线只能有一个上位机：断开另一个，或只监听",
        ],
    ),
    finding(
        "D203",
        ["the adapter echoes what it sends", "转换器回显所发送的数据"],
        [
            "its receiver stays on while it sends; railbus takes the echo out",
            "发送时接收器未关闭；railbus 会去除回显",
        ],
        ["nothing needs to be done", "无需处理"],
    ),
    finding(
        "D204",
        [
            "something on the line never stops sending",
            "总线上有设备持续发送",
        ],
        [
            "a transceiver that hangs in sending · a wire broken or not connected",
            "收发器卡在发送状态 · 断线或未接线",
        ],
        [
            "unplug the modules one after the other until it is quiet",
            "逐个断开模块直到总线安静",
        ],
    ),
    finding(
        "D205",
        ["no module of the line answers", "总线上没有模块应答"],
        [
            "A/B swapped · power off · other speed or parity · line broken near the adapter",
            "A/B 接反 · 未上电 · 波特率或校验位不同 · 靠近转换器处断线",
        ],
        [
            "swap A and B once, then: railbus scan",
            "对调 A/B 试一次，再执行 railbus scan",
        ],
    ),
    finding(
        "D301",
        ["the module does not answer", "模块无应答"],
        [
            "module off · other address, speed or protocol · its wire broken",
            "模块未上电 · 地址、波特率或协议不同 · 其接线断开",
        ],
        ["railbus scan", "railbus scan"],
    ),
    finding(
        "D302",
        ["the module's replies are garbled", "模块的应答损坏"],
        [
            "two modules on one address · other parity · noise, bias or termination",
            "两个模块地址相同 · 校验位不同 · 干扰、偏置或终端电阻问题",
        ],
        [
            "take one module off the line and ask again",
            "断开一个模块后再试",
        ],
    ),
    finding(
        "D303",
        ["the module refuses to be read", "模块拒绝读取"],
        [
            "another model than the configuration says",
            "实际型号与配置不符",
        ],
        ["railbus scan", "railbus scan"],
    ),
    finding(
        "D304",
        ["replies of the module came too late", "模块有迟到的应答"],
        [
            "a slow module or gateway · a busy machine",
            "模块或网关较慢 · 主机繁忙",
        ],
        ["railbus ls     shows how many", "railbus ls     查看次数"],
    ),
    finding(
        "D305",
        ["the module hears badly", "模块接收质量差"],
        [
            "noise, bias or termination · its microcontroller is too busy",
            "干扰、偏置或终端电阻问题 · 模块的单片机过于繁忙",
        ],
        [
            "check wiring, bias and termination",
            "检查接线、偏置和终端电阻",
        ],
    ),
    finding(
        "D306",
        [
            "the module's host watchdog has tripped: its outputs are safe and locked",
            "模块的主机看门狗已触发：输出处于安全值并锁定",
        ],
        [
            "the host was silent for longer than the watchdog's time",
            "主机静默超过看门狗时间",
        ],
        [
            "find out why, then clear it: railbus raw --yes --crc 03 06 BE 00 00 00",
            "查明原因后清除：railbus raw --yes --crc 03 06 BE 00 00 00",
        ],
    ),
    finding(
        "D401",
        ["there is no configuration", "没有配置"],
        [
            "no railbus.toml in the usual places",
            "常用位置均无 railbus.toml",
        ],
        [
            "railbus doctor -l /dev/ttyUSB0, or write a railbus.toml",
            "railbus doctor -l /dev/ttyUSB0，或编写 railbus.toml",
        ],
    ),
    finding(
        "D402",
        ["the configuration has problems", "配置有问题"],
        ["see railbus config check", "见 railbus config check"],
        ["railbus config check", "railbus config check"],
    ),
    finding(
        "D501",
        [
            "a daemon was killed and left its socket behind",
            "守护进程被强行终止，留下了套接字",
        ],
        ["kill -9, or the power failed", "kill -9 或断电"],
        [
            "railbus doctor D501 --fix, or start the daemon",
            "railbus doctor D501 --fix，或启动守护进程",
        ],
    ),
    finding(
        "D502",
        [
            "others may use the daemon's socket",
            "其他用户可使用守护进程的套接字",
        ],
        ["its mode was changed by hand", "权限被手工改动"],
        ["railbus doctor D502 --fix", "railbus doctor D502 --fix"],
    ),
    finding(
        "D503",
        [
            "you may not use the daemon's socket",
            "无权使用守护进程的套接字",
        ],
        ["another user runs the daemon", "守护进程由其他用户运行"],
        ["run the command as that user", "以该用户身份执行命令"],
    ),
    finding(
        "D504",
        [
            "the daemon does not answer as it should",
            "守护进程应答异常",
        ],
        [
            "it is of another version, or hangs",
            "版本不同，或已停止响应",
        ],
        ["restart the daemon", "重新启动守护进程"],
    ),
    finding(
        "D505",
        [
            "the daemon's certificate ends soon",
            "守护进程的证书即将到期",
        ],
        [
            "a certificate is good for a limited time",
            "证书有有效期限制",
        ],
        [
            "get another and put it in the place of the file; the daemon reads it by itself",
            "换用新证书文件；守护进程会自动读取",
        ],
    ),
    finding(
        "D506",
        ["the daemon's certificate has ended", "守护进程的证书已过期"],
        [
            "nobody renewed it, or the clock of this machine is wrong",
            "未及时更换，或本机时钟有误",
        ],
        [
            "get another and put it in the place of the file; one made by --tls auto is made anew \
            when its file is gone and the daemon starts",
            "换用新证书文件；--tls auto 的证书在删除文件并重启后重新生成",
        ],
    ),
    finding(
        "D507",
        [
            "the daemon that answers serves another site",
            "应答的守护进程属于另一个站点",
        ],
        [
            "a daemon of another configuration runs, such as the demo",
            "正在运行另一份配置（例如演示）的守护进程",
        ],
        [
            "name the site: --socket for that daemon, --config for this file",
            "指明站点：--socket 使用该守护进程，--config 使用此文件",
        ],
    ),
    finding(
        "D508",
        [
            "no daemon can be asked at the socket that was named",
            "无法通过所指定的套接字访问守护进程",
        ],
        [
            "it does not run · another socket · no permission",
            "未运行 · 套接字不同 · 无权限",
        ],
        [
            "correct --socket or RAILBUS_SOCKET, or start the daemon",
            "更正 --socket 或 RAILBUS_SOCKET，或启动守护进程",
        ],
    ),
    finding(
        "L001",
        [
            "a Modbus address that frames of another protocol begin with",
            "Modbus 地址与另一协议的帧首字节相同",
        ],
        [
            "85 (55h) or 34 (22h) beside 0x55 boards, 76 (4Ch) or 108 (6Ch) beside LC-02, \
            36 (24h) and other signs beside ASCII modules",
            "0x55 板旁的 85、34，LC-02 旁的 76 (4Ch)、108 (6Ch)，ASCII 模块旁的 36 (24h) 等",
        ],
        [
            "give the Modbus module another address",
            "为该 Modbus 模块更换地址",
        ],
    ),
    finding(
        "L002",
        ["an address that Modbus reserves", "Modbus 保留的地址"],
        [
            "248 to 255: some modules take them, some masters do not ask them",
            "248 至 255：部分模块可用，部分上位机不会询问",
        ],
        ["use 1 to 247", "使用 1 至 247"],
    ),
    finding(
        "L003",
        [
            "address 0 is for all modules in Modbus",
            "地址 0 在 Modbus 中为广播",
        ],
        [
            "switched to Modbus, the module could not be reached any more",
            "切换到 Modbus 后将无法访问该模块",
        ],
        ["use 1 to 247", "使用 1 至 247"],
    ),
    finding(
        "L010",
        [
            "the polls need more time than the line has",
            "轮询所需时间超过总线能力",
        ],
        [
            "too many modules, a slow line or poll = too short",
            "模块过多、波特率过低或 poll 过短",
        ],
        [
            "a longer poll, a higher speed, or two lines",
            "加大 poll、提高波特率，或分为两条总线",
        ],
    ),
    finding(
        "L011",
        [
            "values of the module grow stale between two readings",
            "两次读取之间数值已过期",
        ],
        [
            "one round of all modules takes longer than max_age",
            "轮询一圈的时间超过 max_age",
        ],
        [
            "a longer max_age, a higher speed, or two lines",
            "加大 max_age、提高波特率，或分为两条总线",
        ],
    ),
    finding(
        "L012",
        [
            "modules at different speeds on one line",
            "同一总线上波特率不同",
        ],
        [
            "each poll of the odd ones costs two changes of speed, and is noise to the others",
            "每次轮询都要切换两次波特率，且对其他模块是噪声",
        ],
        [
            "give all modules of the line one speed",
            "使同一总线的模块波特率一致",
        ],
    ),
    finding(
        "L013",
        [
            "modules with different character formats on one line",
            "同一总线上字符格式不同",
        ],
        [
            "each poll of the odd ones costs two changes of format",
            "每次轮询都要切换两次格式",
        ],
        [
            "give all modules of the line one format",
            "使同一总线的模块格式一致",
        ],
    ),
    finding(
        "L014",
        [
            "ASCII modules with and without checksum on one line",
            "同一总线上有带与不带校验和的 ASCII 模块",
        ],
        [
            "a frame for one kind may be a good one for the other after a byte was lost",
            "丢失字节后，一类的帧可能被另一类接受",
        ],
        [
            "switch the checksum on for all of them",
            "为全部模块启用校验和",
        ],
    ),
    finding(
        "L020",
        ["the port has a name that changes", "端口名会改变"],
        [
            "ttyUSB0 is whatever was plugged in first",
            "ttyUSB0 是最先插入的设备",
        ],
        [
            "write the stable name, see railbus ls ports",
            "改用固定名称，见 railbus ls ports",
        ],
    ),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::i18n::Lang;

    #[test]
    fn codes_rise_and_pages_are_written_in_both_languages() {
        assert!(ALL.is_sorted_by(|a, b| a.code < b.code));
        for finding in ALL {
            let page = finding.page;
            for [en, zh] in [page.title, page.likely] {
                assert!(en.is_ascii() || en.contains('·'), "{en}");
                assert!(!zh.is_ascii(), "{zh}");
            }
            assert!(!page.next(Lang::Zh).is_empty());
        }
        assert_eq!(find("d102").map(|found| found.code), Some("D102"));
        assert!(find("D999").is_none());
    }
}
