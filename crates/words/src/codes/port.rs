//! The port and the line: exit code 7.

use super::{Code, codes};

codes! {
    Listen = "E0701" {
        title: ["can't listen on the TCP address", "无法监听 TCP 地址"],
        likely: ["in use by another program · the port needs more rights",
            "已被其他程序占用 · 端口需要更高权限"],
        next: ["choose another port", "换一个端口"],
    }
    Pty = "E0702" {
        title: ["can't create a PTY", "无法创建 PTY"],
        likely: ["none left, or /dev/pts is not mounted", "PTY 已用尽，或 /dev/pts 未挂载"],
        next: ["mount | grep devpts", "mount | grep devpts"],
    }
    ForeignPath = "E0703" {
        title: ["the path of the PTY link is taken by another file", "PTY 链接的位置已有其他文件"],
        likely: ["a file with that name exists", "存在同名文件"],
        next: ["choose another path with --pty", "用 --pty 换一个路径"],
    }
    Link = "E0704" {
        title: ["can't create the PTY link", "无法创建 PTY 链接"],
        likely: ["the directory is missing or not writable", "目录不存在或无权限"],
        next: ["choose another path with --pty", "用 --pty 换一个路径"],
    }
    PortMissing = "E0705" {
        title: ["port not found", "端口不存在"],
        likely: ["adapter not plugged in · another number after plugging it in again",
            "转换器未插好 · 重新插入后编号改变"],
        next: ["railbus ls ports", "railbus ls ports"],
    }
    PortBusy = "E0706" {
        title: ["the port is in use by another program", "端口被其他程序占用"],
        likely: ["a daemon or another master has it open; one line has one master",
            "守护进程或其他主站已打开；一条总线只能有一个主站"],
        next: ["railbus ls ports", "railbus ls ports"],
    }
    PortDenied = "E0707" {
        title: ["permission denied: can't open the port", "无权打开端口"],
        likely: ["you are not in the device's group, or have not logged in again since",
            "未加入设备所属用户组，或加入后未重新登录"],
        next: ["sudo usermod -aG dialout $USER     then log in again",
            "sudo usermod -aG dialout $USER     然后重新登录"],
    }
    NotATty = "E0708" {
        title: ["not a serial port", "不是串口"],
        likely: ["a file or another kind of device has this name", "该名称是普通文件或其他设备"],
        next: ["railbus ls ports", "railbus ls ports"],
    }
    PortUnreachable = "E0709" {
        title: ["the serial server can't be reached", "无法连接串口服务器"],
        likely: ["server off · wrong host or port · firewall", "未上电 · 主机或端口有误 · 防火墙"],
        next: ["ping the host, and check its TCP port", "ping 该主机并检查 TCP 端口"],
    }
    LineClosed = "E0710" {
        title: ["the line is not open", "总线未打开"],
        likely: ["the adapter was pulled out · its driver fails", "转换器被拔出 · 驱动故障"],
        next: ["railbus ls lines", "railbus ls lines"],
    }
    SimControl = "E0790" {
        title: ["the simulator's control socket can't be used", "无法使用仿真器的控制套接字"],
        likely: ["no simulator is running there · used by another one · folder missing or not \
            writable",
            "没有仿真器在此运行 · 已被另一仿真器占用 · 目录不存在或无权限"],
        next: ["railbus sim plant.toml --control PATH", "railbus sim plant.toml --control 路径"],
    }
}
