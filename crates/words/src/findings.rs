//! The findings of `doctor` and `config check`, by their codes, for them and for `explain`. D1 is
//! the machine and its ports, D2 the line, D3 modules, D5 the daemon, D6 a fleet; L is for
//! configurations that are valid but unwise (`lints`).

mod lints;

use crate::codes::{GARBLED, Page};

/// A kind of finding.
#[derive(Clone, Copy, Debug)]
pub struct FindingKind {
    /// Its code, such as `D301`.
    pub code: &'static str,
    /// Its explanation.
    pub page: Page,
}

/// The finding with this code.
pub fn find(code: &str) -> Option<&'static FindingKind> {
    all().find(|known| known.code.eq_ignore_ascii_case(code))
}

const fn finding(
    code: &'static str,
    title: [&'static str; 2],
    likely: [&'static str; 2],
    next: [&'static str; 2],
) -> FindingKind {
    FindingKind {
        code,
        page: Page {
            title,
            likely,
            next,
        },
    }
}

/// All of them, by code.
pub fn all() -> impl Iterator<Item = &'static FindingKind> {
    FINDINGS.iter().chain(lints::TABLE)
}

/// Those of `doctor` alone.
const FINDINGS: &[FindingKind] = &[
    finding(
        "D101",
        ["the clock is wrong", "时钟不对"],
        [
            "no clock battery, and not yet synchronised with a time server",
            "没有时钟电池的机器尚未与时间服务器同步",
        ],
        ["timedatectl set-ntp true", "timedatectl set-ntp true"],
    ),
    finding(
        "D102",
        ["permission denied: can't open the port", "无权打开端口"],
        ["you are not in the device's group", "未加入设备所属用户组"],
        [
            "sudo usermod -aG GROUP $USER, then log in again",
            "sudo usermod -aG 用户组 $USER，然后重新登录",
        ],
    ),
    finding(
        "D103",
        ["port not found", "端口不存在"],
        [
            "adapter not plugged in · another number after plugging it in again",
            "转换器未插好 · 重新插入后编号改变",
        ],
        ["railbus ls ports", "railbus ls ports"],
    ),
    finding(
        "D104",
        [
            "the port is in use by another program",
            "端口被其他程序占用",
        ],
        ["one line has one master", "一条总线只能有一个主站"],
        [
            "stop that program, or use only that one",
            "停止该程序，或只由它使用",
        ],
    ),
    finding(
        "D105",
        [
            "ModemManager probes this adapter when it is plugged in",
            "ModemManager 会在插入时试探该转换器",
        ],
        [
            "it takes serial adapters for modems and sends AT commands to your modules",
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
            "the FTDI adapter delays received data",
            "FTDI 转换器延迟转交数据",
        ],
        [
            "its latency timer: each reply may be delayed by this much",
            "其延迟定时器：每个应答可能晚到这么久",
        ],
        ["railbus doctor D106 --fix", "railbus doctor D106 --fix"],
    ),
    finding(
        "D107",
        [
            "the configuration uses a port name that can change",
            "配置使用了会改变的端口名",
        ],
        [
            "ttyUSB0 is the adapter plugged in first",
            "ttyUSB0 是最先插入的设备",
        ],
        [
            "use the stable name, see railbus ls ports",
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
            "they share a USB ID, and the port disappears as soon as it appears",
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
            "log out and in again for the new group to apply",
            "须重新登录，新用户组才生效",
        ],
        [
            "a session keeps the groups it started with",
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
            "LANG=C or not set: Chinese names can't be shown",
            "LANG=C 或未设置：无法显示中文名称",
        ],
        ["export LANG=C.UTF-8", "export LANG=C.UTF-8"],
    ),
    finding(
        "D111",
        ["not a serial port", "不是串口"],
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
            "server off · wrong host or port · firewall",
            "未上电 · 主机或端口有误 · 防火墙",
        ],
        [
            "ping the host, and check its TCP port",
            "ping 该主机并检查 TCP 端口",
        ],
    ),
    finding(
        "D113",
        ["port failure", "端口故障"],
        [
            "the adapter was pulled out · its driver fails",
            "转换器被拔出 · 驱动故障",
        ],
        ["plug it in again and check dmesg", "重新插入并查看 dmesg"],
    ),
    finding(
        "D201",
        ["unsolicited data on the line", "总线上有非请求数据"],
        [
            "bias or termination missing · A/B swapped · interference from a machine nearby",
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
        ["another master is on the line", "总线上另有主站"],
        [
            "a PLC, another program or another adapter polls the same modules",
            "PLC、其他程序或其他转换器在轮询同一批模块",
        ],
        [
            "one line has one master: disconnect the other one, or only listen",
            "一条总线只能有一个主站：断开另一个，或只监听",
        ],
    ),
    finding(
        "D203",
        ["the adapter echoes what it sends", "转换器回显所发送的数据"],
        [
            "its receiver stays on while it sends; railbus removes the echo",
            "发送时接收器未关闭；railbus 会去除回显",
        ],
        ["no action needed", "无需处理"],
    ),
    finding(
        "D204",
        [
            "continuous transmission on the line",
            "总线上有设备持续发送",
        ],
        [
            "a transceiver stuck in transmit · a wire broken or not connected",
            "收发器卡在发送状态 · 断线或未接线",
        ],
        [
            "unplug the modules one by one until the line is idle",
            "逐个断开模块，直到总线空闲",
        ],
    ),
    finding(
        "D205",
        ["no module on the line replies", "总线上没有模块应答"],
        [
            "A/B swapped · power off · other speed or parity · wire broken near the adapter",
            "A/B 接反 · 未上电 · 波特率或校验位不同 · 靠近转换器处断线",
        ],
        [
            "swap A and B once, then: railbus scan",
            "对调 A/B 试一次，再执行 railbus scan",
        ],
    ),
    finding(
        "D301",
        ["the module does not reply", "模块无应答"],
        [
            "module off · other address, speed or protocol · its wire broken",
            "模块未上电 · 地址、波特率或协议不同 · 其接线断开",
        ],
        ["railbus scan", "railbus scan"],
    ),
    finding(
        "D302",
        ["the module's replies are garbled", "模块的应答损坏"],
        GARBLED,
        [
            "railbus scan; then check cable, bias and termination, and try one module alone",
            "railbus scan；再检查线缆、偏置和终端电阻，并单独接一个模块试验",
        ],
    ),
    finding(
        "D303",
        ["the module refuses reads", "模块拒绝读取"],
        [
            "not the model given in the configuration",
            "实际型号与配置不符",
        ],
        ["railbus scan", "railbus scan"],
    ),
    finding(
        "D304",
        ["late replies from the module", "模块有迟到的应答"],
        [
            "a slow module or gateway · a busy machine",
            "模块或网关较慢 · 主机繁忙",
        ],
        ["railbus ls     shows the count", "railbus ls     查看次数"],
    ),
    finding(
        "D305",
        ["the module receives many bad frames", "模块接收质量差"],
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
            "the module's host watchdog has tripped: outputs are in the safe state and locked",
            "模块的主机看门狗已触发：输出处于安全值并锁定",
        ],
        [
            "the host was silent for longer than the watchdog time",
            "主机静默超过看门狗时间",
        ],
        [
            "find the cause, then clear it: railbus raw --yes --crc 03 06 BE 00 00 00",
            "查明原因后清除：railbus raw --yes --crc 03 06 BE 00 00 00",
        ],
    ),
    finding(
        "D307",
        [
            "another model replies in the module's place",
            "该处应答的是另一型号",
        ],
        [
            "a module was replaced by another model · wrong model in the configuration",
            "换上了另一型号的模块 · 配置的型号不对",
        ],
        [
            "put the right module in its place, or correct \"model\" in the configuration; if \
             the board is known to be compatible, set identify = false in [module.NAME]",
            "装回正确的模块，或更正配置中的 model；确知该板兼容时：在 [module.名称] 中设 identify = false",
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
        ["a key, a value or a name is wrong", "键、值或名称有误"],
        ["railbus config check", "railbus config check"],
    ),
    finding(
        "D501",
        [
            "a killed daemon left its socket behind",
            "守护进程被强行终止，留下了套接字",
        ],
        ["kill -9 or a power failure", "kill -9 或断电"],
        [
            "railbus doctor D501 --fix, or start the daemon",
            "railbus doctor D501 --fix，或启动守护进程",
        ],
    ),
    finding(
        "D502",
        [
            "other users can use the daemon's socket",
            "其他用户可使用守护进程的套接字",
        ],
        ["its mode was changed manually", "权限被手工改动"],
        ["railbus doctor D502 --fix", "railbus doctor D502 --fix"],
    ),
    finding(
        "D503",
        [
            "permission denied: can't use the daemon's socket",
            "无权使用守护进程的套接字",
        ],
        [
            "the daemon is run by another user",
            "守护进程由其他用户运行",
        ],
        ["run the command as that user", "以该用户身份执行命令"],
    ),
    finding(
        "D504",
        ["the daemon replies incorrectly", "守护进程应答异常"],
        [
            "different version, or not responding",
            "版本不同，或已停止响应",
        ],
        ["restart the daemon", "重新启动守护进程"],
    ),
    finding(
        "D505",
        [
            "the daemon's certificate expires soon",
            "守护进程的证书即将到期",
        ],
        ["certificates have a limited lifetime", "证书有有效期限制"],
        [
            "replace the certificate file; the daemon reloads it",
            "换用新证书文件；守护进程会自动读取",
        ],
    ),
    finding(
        "D506",
        [
            "the daemon's certificate has expired",
            "守护进程的证书已过期",
        ],
        [
            "not renewed, or this machine's clock is wrong",
            "未及时更换，或本机时钟有误",
        ],
        [
            "replace the certificate file; for --tls auto, delete the file and restart the daemon",
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
            "no daemon answers at the given socket",
            "无法通过所指定的套接字访问守护进程",
        ],
        [
            "it is not running · another socket · no permission",
            "未运行 · 套接字不同 · 无权限",
        ],
        [
            "correct --socket or RAILBUS_SOCKET, or start the daemon",
            "更正 --socket 或 RAILBUS_SOCKET，或启动守护进程",
        ],
    ),
    finding(
        "D509",
        ["an integration keeps failing", "集成持续失败"],
        [
            "the other system is off or not reachable · wrong address or password",
            "对方系统已关闭或无法访问 · 地址或密码有误",
        ],
        [
            "see its last error on the page Integrations, and test it there",
            "在“集成”页面查看最近错误，并进行测试",
        ],
    ),
    finding(
        "D601",
        [
            "the centre is not connected to its servers",
            "中心未连接到服务器",
        ],
        [
            "servers not running · not reachable · the centre's key is refused · just started",
            "服务器未运行 · 无法访问 · 中心的密钥被拒绝 · 刚刚启动",
        ],
        [
            "wait a few seconds; then railbus fleet ls",
            "等待几秒，再运行 railbus fleet ls",
        ],
    ),
    finding(
        "D602",
        ["sites are offline", "站点离线"],
        [
            "daemon or machine off · no network · key expired or revoked · its clock is wrong",
            "守护进程或计算机已停止 · 网络中断 · 密钥到期或已吊销 · 站点时钟有误",
        ],
        [
            "at the site: railbus outlet list shows why it does not connect. One that is gone for \
             good: railbus fleet remove SITE",
            "在站点上运行 railbus outlet list 查看未连接的原因；已永久停用的站点：railbus fleet remove 站点",
        ],
    ),
    finding(
        "D603",
        [
            "sites whose values are not known to be current",
            "站点的数值尚未收齐",
        ],
        [
            "site or centre just connected · a slow connection to the servers",
            "站点或中心刚刚连接 · 到服务器的网络较慢",
        ],
        [
            "wait a minute; then railbus fleet ls",
            "等待一分钟，再运行 railbus fleet ls",
        ],
    ),
    finding(
        "D604",
        [
            "another machine asks to be one of these sites",
            "另一台机器以这些站点的身份请求连接",
        ],
        [
            "a copied disk or folder · the integration was added again · a stolen key",
            "磁盘或文件夹被复制 · 集成被重新添加 · 密钥被盗",
        ],
        [
            "find the other machine and stop it; if the key was stolen: railbus fleet revoke",
            "找到并停止另一台机器；密钥被盗时运行 railbus fleet revoke",
        ],
    ),
    finding(
        "D605",
        [
            "sites whose clock differs from the centre's",
            "与中心时钟不一致的站点",
        ],
        [
            "no clock battery there · this machine's clock is wrong · a slow connection",
            "站点没有时钟电池 · 本机时钟有误 · 网络较慢",
        ],
        [
            "timedatectl set-ntp true, at the site and here",
            "在站点和本机上运行 timedatectl set-ntp true",
        ],
    ),
    finding(
        "D606",
        ["sites whose key expires soon", "站点密钥即将到期"],
        [
            "no centre was there to renew it, or it refused to",
            "没有可续期的中心，或中心拒绝续期",
        ],
        [
            "at the site: railbus outlet list shows why it was not renewed",
            "在站点上运行 railbus outlet list 查看未续期的原因",
        ],
    ),
    finding(
        "D607",
        [
            "messages that the centre can't read",
            "中心收到无法识别的消息",
        ],
        [
            "a site or another centre of another version",
            "站点或另一个中心的版本不同",
        ],
        [
            "the same version of railbus for the centre and its sites",
            "使中心和站点的 railbus 版本一致",
        ],
    ),
    finding(
        "D608",
        ["the centre can't be asked", "无法访问站群中心"],
        [
            "it ended unexpectedly · another user runs it · another version",
            "意外终止 · 由其他用户运行 · 版本不同",
        ],
        [
            "start railbus fleet serve again, or run the doctor as its user",
            "重新启动 railbus fleet serve，或以运行中心的用户诊断",
        ],
    ),
    finding(
        "D609",
        ["the centre reports an error", "中心报告错误"],
        [
            "a file that it needs · its servers refused something",
            "所需文件有问题 · 服务器拒绝了请求",
        ],
        [
            "railbus fleet ls shows the error",
            "railbus fleet ls 显示该错误",
        ],
    ),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Lang;

    #[test]
    fn codes_rise_and_pages_are_written_in_both_languages() {
        assert!(all().is_sorted_by(|a, b| a.code < b.code));
        for finding in all() {
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
