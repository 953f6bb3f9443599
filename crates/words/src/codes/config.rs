//! The configuration and what it names: exit code 8.

use super::{Code, codes};

codes! {
    NoModule = "E0801" {
        title: ["there is no such module or point", "没有该模块或点位"],
        likely: ["a typing mistake · wrong configuration file", "输入错误 · 使用了别的配置"],
        next: ["railbus ls points", "railbus ls points"],
    }
    NoPoint = "E0802" {
        title: ["the module has no such point", "模块没有该点位"],
        likely: ["labels are those printed on the module: do0, di0, k1, ai1",
            "标签与模块上所印一致：do0、di0、k1、ai1"],
        next: ["railbus ls points", "railbus ls points"],
    }
    NoLine = "E0803" {
        title: ["unknown line", "没有该总线"],
        likely: ["a typing mistake; a port is /dev/…, tcp:HOST:PORT, mbtcp:HOST or pty:/PATH",
            "输入错误；端口写作 /dev/…、tcp:HOST:PORT、mbtcp:HOST 或 pty:/PATH"],
        next: ["railbus ls lines", "railbus ls lines"],
    }
    Pulse = "E0804" {
        title: ["the module does not support this pulse", "该模块不支持此点动时间"],
        likely: ["EDA modules have one width for all outputs; 0x55 boards take 1 ms to 4 h 39 min; \
            the others have no timer",
            "EDA 模块各输出共用一个宽度；0x55 板为 1 ms 至 4 小时 39 分；其余没有定时器"],
        next: ["railbus pulse POINT DURATION --by host", "railbus pulse POINT DURATION --by host"],
    }
    Unsupported = "E0805" {
        title: ["not sent: this model has no such command", "未发送：该型号没有此命令"],
        likely: ["the family has no pulse timer or no toggle, or another module on the line could \
            take the frame for a command",
            "该系列不能点动或翻转，或总线上其他模块可能误认此报文"],
        next: ["railbus ls models", "railbus ls models"],
    }
    BadValue = "E0806" {
        title: ["invalid value", "值无效"],
        likely: ["a typing mistake, another type, or out of range", "输入错误、类型不符，或超出范围"],
        next: ["correct the value and try again", "改正后重试"],
    }
    NotAnOutput = "E0807" {
        title: ["not an output", "该点位不是输出"],
        likely: ["inputs and analog values can only be read", "开关量输入和模拟量只能读取"],
        next: ["railbus ls points", "railbus ls points"],
    }
    BadFrame = "E0808" {
        title: ["the bytes are not a request of that protocol", "这些字节不是该协议的请求"],
        likely: ["wrong checksum · another protocol · the daemon only sends known requests",
            "校验和有误 · 是另一协议 · 经守护进程时只发送已知的请求"],
        next: ["railbus decode", "railbus decode"],
    }
    NoConfig = "E0809" {
        title: ["there is no configuration", "没有配置"],
        likely: ["no railbus.toml here, in a parent folder, in ~/.config/railbus or /etc/railbus",
            "当前目录、上级目录、~/.config/railbus 和 /etc/railbus 中均无 railbus.toml"],
        next: ["name port and module: -l /dev/ttyUSB0 -m erc8 -a 3",
            "直接指定端口和模块：-l /dev/ttyUSB0 -m erc8 -a 3"],
    }
    BadConfig = "E0810" {
        title: ["the configuration has problems", "配置有问题"],
        likely: ["see each of them", "见各项说明"],
        next: ["correct the places named", "改正所指出的位置"],
    }
    ConfigSyntax = "E0811" {
        title: ["the configuration is not valid TOML", "配置不是有效的 TOML"],
        likely: ["a quote or bracket is missing", "缺少引号或括号"],
        next: ["see the line and column given", "查看所指的行和列"],
    }
    ConfigKey = "E0812" {
        title: ["unknown key in the configuration", "配置中有未知的键"],
        likely: ["a typing mistake", "输入错误"],
        next: ["use the suggested key", "使用所建议的键"],
    }
    ConfigMissing = "E0813" {
        title: ["a key is missing in the configuration", "配置中缺少键"],
        likely: ["a line needs port; a module needs line, model and address",
            "line 需要 port；module 需要 line、model 和 address"],
        next: ["add the key", "补上该键"],
    }
    ConfigType = "E0814" {
        title: ["a value of the wrong type in the configuration", "配置中值的类型不对"],
        likely: ["a number in quotes, or a text without quotes", "数字加了引号，或文本缺少引号"],
        next: ["use the type given", "改为所要求的类型"],
    }
    ConfigChoice = "E0815" {
        title: ["invalid value; not one of the allowed values", "值不在可选范围内"],
        likely: ["a typing mistake · an unknown model", "输入错误 · 未知型号"],
        next: ["use one of the values listed", "使用列出的值之一"],
    }
    ConfigRange = "E0816" {
        title: ["a number out of range in the configuration", "配置中数值超出范围"],
        likely: ["a typing mistake", "输入错误"],
        next: ["use a number within the given range", "使用所示范围内的数值"],
    }
    ConfigName = "E0817" {
        title: ["invalid name", "名称无效"],
        likely: ["names are 1 to 32 of a-z, 0-9 and _", "名称为 1 至 32 个 a-z、0-9 或 _"],
        next: ["choose another name; the display name goes into name = {…}",
            "换一个名称；显示名写在 name = {…} 中"],
    }
    ConfigDuration = "E0818" {
        title: ["a time without its unit", "时间缺少单位"],
        likely: ["write 200ms, 1.5s, 2m", "应写作 200ms、1.5s、2m"],
        next: ["add the unit", "补上单位"],
    }
    ConfigAnalog = "E0819" {
        title: ["invalid range of an analog input", "模拟量量程无效"],
        likely: ["low is not below high", "下限不小于上限"],
        next: ["see range under [module.NAME] in the guide, page railbus.toml",
            "见手册“railbus.toml”一页 [module.名称] 的 range"],
    }
    ConfigLine = "E0820" {
        title: ["a module uses a line that does not exist", "模块所属的总线不存在"],
        likely: ["a typing mistake in line =", "line = 有误"],
        next: ["add [line.NAME] or correct the name", "添加 [line.NAME] 或改正名称"],
    }
    ConfigPoint = "E0821" {
        title: ["the module has no such point", "模块没有该点位"],
        likely: ["labels are those printed on the module: do0, di0, k1, ai1",
            "标签与模块上所印一致：do0、di0、k1、ai1"],
        next: ["railbus ls models", "railbus ls models"],
    }
    ConfigSetup = "E0822" {
        title: ["impossible settings for this model", "该型号不支持此设置"],
        likely: ["an address, speed, protocol or channel count that this family does not have",
            "该系列没有此地址、波特率、协议或通道数"],
        next: ["railbus ls models", "railbus ls models"],
    }
    ConfigTwice = "E0823" {
        title: ["two modules on one address", "两个模块地址相同"],
        likely: ["copied and not changed", "复制后未修改"],
        next: ["change the address of one of them", "为其中一个更换地址"],
    }
    ConfigFile = "E0824" {
        title: ["the configuration can't be read", "无法读取配置"],
        likely: ["no such file · no read permission", "文件不存在 · 无读取权限"],
        next: ["check the path given to --config", "检查 --config 的路径"],
    }
    ConfigPort = "E0825" {
        title: ["not a port name", "该值不是端口名称"],
        likely: ["COM3 or ttyUSB0 without /dev/", "写成 COM3，或缺少 /dev/"],
        next: ["write /dev/ttyUSB0, tcp:HOST:PORT, mbtcp:HOST or pty:/PATH",
            "应写为 /dev/ttyUSB0、tcp:主机:端口、mbtcp:主机 或 pty:/路径"],
    }
    ConfigPortTwice = "E0826" {
        title: ["two lines on one port", "两条总线使用同一端口"],
        likely: ["copied and not changed", "复制后未修改"],
        next: ["put the modules of both on one line", "将两者的模块放在一条总线下"],
    }
    ConfigChanged = "E0827" {
        title: ["the configuration has been changed by someone else", "配置已被他人更改"],
        likely: ["another user or program wrote the file", "其他人或程序写入了该文件"],
        next: ["reload it and repeat the change", "重新读取后再次更改"],
    }
    ConfigByHand = "E0828" {
        title: ["this part of the configuration can only be changed by hand",
            "配置的这一部分只能手动更改"],
        likely: ["it is written in a form that can't be edited automatically", "其写法无法就地编辑"],
        next: ["edit the file as a whole", "直接编辑整个文件"],
    }
    ConfigNameTaken = "E0829" {
        title: ["the name is already in use", "名称已被使用"],
        likely: ["names of lines and modules must be unique", "各总线和模块的名称不得重复"],
        next: ["choose another name", "换用其他名称"],
    }
    ConfigUnwritten = "E0830" {
        title: ["the configuration can't be written; nothing was changed",
            "无法写入配置；未作任何更改"],
        likely: ["no write permission for the file or its folder · disk full",
            "文件或目录无写入权限 · 磁盘已满"],
        next: ["railbus doctor", "railbus doctor"],
    }
    NoGeneration = "E0831" {
        title: ["no such saved version", "没有保存该版本"],
        likely: ["nothing has been changed yet · only the last 20 are kept", "尚未更改 · 仅保留最近 20 个版本"],
        next: ["GET /api/v1/config/generations lists those that are",
            "GET /api/v1/config/generations 列出所保留的版本"],
    }
    NoIfMatch = "E0832" {
        title: ["nothing written: If-Match does not say which text is to be replaced",
            "未写入：If-Match 未说明要替换哪个文本"],
        likely: ["the request has no If-Match header", "请求缺少 If-Match 头"],
        next: ["send the ETag of GET /api/v1/config as If-Match",
            "以 GET /api/v1/config 的 ETag 作为 If-Match 发送"],
    }
    HostAway = "E0833" {
        title: ["the primary host is not there, and nothing is told until it is",
            "主要主机（Primary Host）不在线，暂不发布数据"],
        likely: ["the host application is stopped · it has another host ID, or another broker · \
            its clock was set back",
            "主机应用未运行 · 主机 ID 或代理不一致 · 主机时钟被调回"],
        next: ["see what it says: mosquitto_sub -h HOST -p PORT -v -t 'spBv1.0/STATE/+'",
            "查看其状态：mosquitto_sub -h 主机 -p 端口 -v -t 'spBv1.0/STATE/+'"],
    }
    ConfigThumbprint = "E0834" {
        title: ["not the thumbprint of a certificate", "不是证书指纹"],
        likely: ["it has 40 hexadecimal digits (SHA-1), with or without colons · another kind of \
            fingerprint, or a serial number",
            "指纹为 40 位十六进制数字（SHA-1），可带冒号 · 误填了其他指纹或序列号"],
        next: ["copy it from the client, or: openssl x509 -noout -fingerprint -sha1 -in FILE",
            "从客户端复制，或执行 openssl x509 -noout -fingerprint -sha1 -in 文件"],
    }
    ConfigServers = "E0835" {
        title: ["the servers of a fleet are not named as they must be", "站群服务器填写有误"],
        likely: ["a host name or IPv4 address, with a port or without, is wanted · none is named",
            "应为主机名或 IPv4 地址，可带端口 · 未填写"],
        next: ["servers = [\"nats1\", \"nats2:4222\"]", "servers = [\"nats1\", \"nats2:4222\"]"],
    }
    NoSite = "E0836" {
        title: ["the fleet has no such site", "站群中没有该站点"],
        likely: ["a typing mistake · it never had a session · it was removed",
            "输入错误 · 从未建立会话 · 已被移除"],
        next: ["railbus fleet ls", "railbus fleet ls"],
    }
    NoBulk = "E0837" {
        title: ["the centre knows no command to several sites with this id",
            "中心没有该编号的多站点命令"],
        likely: ["a typing mistake · it was to one site · newer ones took its place",
            "输入错误 · 是单站点命令 · 已被较新的命令取代"],
        next: ["railbus fleet commands", "railbus fleet commands"],
    }
    ExportNoOutlet = "E0838" {
        title: ["there is no integration that this export can use", "没有此导出可用的集成"],
        likely: ["none is configured, or it is off · a typing mistake · Modbus TCP with TLS",
            "未配置或已停用 · 输入错误 · Modbus TCP 使用了 TLS"],
        next: ["add [outlet.home] with type = \"mqtt\" or \"modbus_tcp\" to the configuration",
            "在配置中添加 [outlet.home]，type = \"mqtt\" 或 \"modbus_tcp\""],
    }
    ExportWhich = "E0839" {
        title: ["several integrations fit: say which one", "有多个可用的集成：请指定其中一个"],
        likely: ["more than one of the same kind is configured", "配置了多个同类集成"],
        next: ["name it: --outlet NAME", "指定名称：--outlet 名称"],
    }
    NoSetting = "E0840" {
        title: ["the module has no such setting", "模块没有该设置"],
        likely: ["a typing mistake · another model", "输入错误 · 型号不同"],
        next: ["railbus config show MODULE", "railbus config show MODULE"],
    }
    SettingRange = "E0841" {
        title: ["invalid value for this setting", "该设置不能为此值"],
        likely: ["this family has other addresses, baud rates or widths", "该系列的地址、波特率或宽度不同"],
        next: ["railbus config show MODULE     lists the allowed values",
            "railbus config show MODULE     列出各项可选值"],
    }
    SettingFixed = "E0842" {
        title: ["this setting can't be changed by a command", "没有命令可更改该设置"],
        likely: ["it is set by the vendor's software, a pin or a switch", "由厂家软件、引脚或拨码开关决定"],
        next: ["railbus config show MODULE", "railbus config show MODULE"],
    }
    PortSpeed = "E0843" {
        title: ["nothing written: this port can't change its speed or parity",
            "未写入：该端口无法改变波特率或校验位"],
        likely: ["a serial server keeps its own speed: the module would become unreachable",
            "串口服务器使用自身波特率：模块将无法访问"],
        next: ["change the server's speed manually, or connect the module to a serial port",
            "手动更改服务器的波特率，或将模块接到串口"],
    }
    NotReadable = "E0844" {
        title: ["nothing written: related settings can't be read",
            "未写入：无法读取同时保存的其他设置"],
        likely: ["an older EDA9060 has no pulses", "旧型 EDA9060 没有点动功能"],
        next: ["railbus config show MODULE", "railbus config show MODULE"],
    }
    UnsafeFrame = "E0845" {
        title: ["nothing written: a module of another protocol could take the frame for a command",
            "未写入：其他协议的模块可能误认此报文为命令"],
        likely: ["address 85, 76 or 36: frames of other protocols start with these bytes",
            "地址 85、76 或 36 是其他协议报文的首字节"],
        next: ["choose another address", "选择其他地址"],
    }
    NoChange = "E0846" {
        title: ["no such change in the journal", "日志中没有该更改"],
        likely: ["different folder, or too long ago", "文件夹不同，或时间过久"],
        next: ["railbus config log", "railbus config log"],
    }
    CantUndo = "E0847" {
        title: ["this change can't be undone", "该更改无法撤销"],
        likely: ["the old values are unknown, e.g. after a calibration", "原值未知，例如校准之后"],
        next: ["railbus config log", "railbus config log"],
    }
    BackupFile = "E0848" {
        title: ["not a backup file", "不是备份文件"],
        likely: ["wrong file · incomplete", "文件有误 · 不完整"],
        next: ["railbus config backup -O site.json", "railbus config backup -O site.json"],
    }
    BackupSchema = "E0849" {
        title: ["the backup was written by another version", "备份由其他版本写成"],
        likely: ["made by an older or newer railbus", "由更旧或更新的 railbus 生成"],
        next: ["make a new backup with this version", "用此版本重新备份"],
    }
    BackupSite = "E0850" {
        title: ["the backup belongs to another site", "备份属于另一个站点"],
        likely: ["not the configuration it was made with", "与备份时的配置不同"],
        next: ["add --other-site if intended", "确认无误后加 --other-site"],
    }
    NotAlone = "E0851" {
        title: ["not sent: more than one module replies on the line", "未发送：总线上不止一个模块应答"],
        likely: ["a broadcast would change all of them", "广播会更改所有模块"],
        next: ["connect this module alone", "将该模块单独接到总线上"],
    }
    NothingToDo = "E0852" {
        title: ["no module to do this with", "没有可执行此操作的模块"],
        likely: ["wrong line · no module of that family in the configuration",
            "总线有误 · 配置中没有该系列的模块"],
        next: ["railbus ls", "railbus ls"],
    }
    NoRule = "E0853" {
        title: ["there is no such rule", "没有此规则"],
        likely: ["a typing mistake · wrong configuration file", "输入错误 · 使用了别的配置"],
        next: ["check the configuration", "查看配置文件"],
    }
    RuleNotTried = "E0854" {
        title: ["a rule must be tested before it is enabled", "规则须先测试才能启用"],
        likely: ["it was changed after the test · railbus was restarted",
            "测试后又作了更改 · railbus 已重新启动"],
        next: ["test it on the history, then enable it", "先用历史数据测试，再启用"],
    }
    ConfigTopic = "E0855" {
        title: ["these MQTT topics can't be used", "MQTT 主题不可用"],
        likely: ["a wildcard (+, #), a space or a slash too many · another integration has the \
            same topics at the broker",
            "含有通配符（+、#）、空格或多余的斜杠 · 另一个集成已在该代理上使用相同的主题"],
        next: ["write base = \"railbus\", site = \"plant1\", with Sparkplug group and node, \
            for each integration another",
            "应写为 base = \"railbus\"、site = \"plant1\"（Sparkplug 用 group、node），\
            每个集成各不相同"],
    }
    BrokerFile = "E0856" {
        title: ["a certificate or key for the MQTT broker can't be used",
            "用于 MQTT 代理的证书或私钥不可用"],
        likely: ["wrong path · no PEM · key of another certificate · no read permission",
            "路径有误 · 不是 PEM · 私钥与证书不匹配 · 无读取权限"],
        next: ["check ca, cert and key of the integration, and who may read the files",
            "检查集成的 ca、cert、key 及文件的读取权限"],
    }
    HookUnreached = "E0857" {
        title: ["the receiver of the webhook can't be reached", "无法连接 webhook 接收方"],
        likely: ["wrong address · the receiver is not running · no network connection",
            "地址有误 · 接收方未运行 · 网络不通"],
        next: ["test the address from this machine: curl -v URL", "在本机测试该地址：curl -v URL"],
    }
    HookTls = "E0858" {
        title: ["no trusted connection to the receiver of the webhook",
            "无法与 webhook 接收方建立可信连接"],
        likely: ["its certificate is for another name, or from an authority this machine does \
            not trust",
            "其证书不是由本机信任的机构签发，或域名不符"],
        next: ["add its authority to this machine's trusted ones, or set SSL_CERT_FILE",
            "将其签发机构加入本机信任列表，或设置 SSL_CERT_FILE"],
    }
    HookSlow = "E0859" {
        title: ["the receiver of the webhook did not answer in time", "webhook 接收方未及时应答"],
        likely: ["the receiver processes the event before it replies", "接收方先处理后应答"],
        next: ["let the receiver reply first, then process", "让接收方先应答，再处理"],
    }
    NoGroup = "E0860" {
        title: ["there is no such group", "没有此分组"],
        likely: ["a typing mistake · wrong configuration file", "输入错误 · 使用了别的配置"],
        next: ["railbus ls groups", "railbus ls groups"],
    }
    NoScene = "E0861" {
        title: ["there is no such scene", "没有此场景"],
        likely: ["a typing mistake · wrong configuration file", "输入错误 · 使用了别的配置"],
        next: ["railbus scene list", "railbus scene list"],
    }
    NotSimulated = "E0862" {
        title: ["this line is not simulated here", "此总线不是在此仿真的"],
        likely: ["a line with real modules · a typing mistake", "总线上是真实模块 · 输入错误"],
        next: ["railbus serve --demo", "railbus serve --demo"],
    }
    NoSimModule = "E0863" {
        title: ["there is no such module on the simulated line", "仿真总线上没有此模块"],
        likely: ["renamed or added after the simulation was started",
            "仿真开始后才改名或添加"],
        next: ["use a module listed by the simulator", "使用仿真器中列出的模块"],
    }
    NoOutlet = "E0864" {
        title: ["there is no such integration", "没有此集成"],
        likely: ["a typing mistake · wrong configuration file", "输入错误 · 使用了别的配置"],
        next: ["list the integrations: GET /api/v1/outlets", "查看集成列表：GET /api/v1/outlets"],
    }
    ConfigOutput = "E0865" {
        title: ["this key or list of the configuration is for outputs only", "配置的该项仅适用于输出"],
        likely: ["an input or analog value is named", "指定的是输入点或模拟量"],
        next: ["railbus ls points", "railbus ls points"],
    }
    ConfigSelf = "E0866" {
        title: ["an output cannot interlock with itself", "输出与自身互锁"],
        likely: ["a different output was intended", "应为另一个输出"],
        next: ["name the other output", "写另一个输出的名称"],
    }
    ConfigAgain = "E0867" {
        title: ["a point appears twice in a list", "列表中某点位重复"],
        likely: ["copied and not changed", "复制后未修改"],
        next: ["remove one of them", "删去其中一个"],
    }
    ConfigTooMuch = "E0868" {
        title: ["a time or list in the configuration is out of range", "配置中的时间或列表超出范围"],
        likely: ["wrong unit", "单位有误"],
        next: ["see the range in the message", "查看提示中的范围"],
    }
    ConfigStep = "E0869" {
        title: ["a step of a scene can't be read", "场景的步骤有误"],
        likely: ["\"set\" without \"to\", or together with \"wait\"",
            "只有 \"set\" 没有 \"to\"，或与 \"wait\" 并用"],
        next: ["write { set = \"oven.k1\", to = true } or { wait = \"2s\" }",
            "应写为 { set = \"oven.k1\", to = true } 或 { wait = \"2s\" }"],
    }
    ScanNotWritten = "E0870" {
        title: ["the modules found can't be saved to the configuration", "无法将发现的模块写入配置"],
        likely: ["no permission for the file or its folder · disk full · an inline table",
            "文件或目录无权限 · 磁盘已满 · 配置中有单行表"],
        next: ["add them by hand as railbus scan shows them", "按 railbus scan 的结果手动写入"],
    }
    RuleWhen = "E0871" {
        title: ["the condition of a rule can't be read", "规则的条件有误"],
        likely: ["\"is\" of an analog value, \"above\" of an output · \"for\" with a time of day",
            "对模拟量用了 \"is\"，或对输出用了 \"above\" · 对时刻用了 \"for\""],
        next: ["write { point = \"tank.ai1\", above = 8.5 } or { time = \"06:30\" }",
            "应写为 { point = \"tank.ai1\", above = 8.5 } 或 { time = \"06:30\" }"],
    }
    RuleThen = "E0872" {
        title: ["the action of a rule can't be read", "规则的动作有误"],
        likely: ["\"set\" without \"to\" · an empty or long text",
            "只有 \"set\" 没有 \"to\" · 文字为空或过长"],
        next: ["write { set = \"oven.k1\", to = true }, { pulse = … } or { notify = … }",
            "应写为 { set = \"oven.k1\", to = true }、{ pulse = … } 或 { notify = … }"],
    }
    RuleAsks = "E0873" {
        title: ["a rule may not switch an output that requires confirmation",
            "规则不能操作须由人确认的输出"],
        likely: ["the output has \"confirm\"", "该输出设有 \"confirm\""],
        next: ["use another output, or remove \"confirm\"", "换用其他输出，或去掉 \"confirm\""],
    }
    RuleUnit = "E0874" {
        title: ["the unit of a rule differs from the unit of its point", "规则的单位与点位的单位不同"],
        likely: ["the scale of the point was changed", "点位的量程已更改"],
        next: ["write the limit in the unit of the point", "按点位的单位填写限值"],
    }
    OutletEnded = "E0875" {
        title: ["the integration stopped unexpectedly", "集成意外停止"],
        likely: ["an error in this program", "程序自身出错"],
        next: ["it is restarted after a while; if this repeats, report it with the daemon's log",
            "稍后会自动重启；若反复出现，请附上守护进程日志报告"],
    }
    ConfigUrl = "E0876" {
        title: ["not a valid receiver address", "配置中的该项不是接收方地址"],
        likely: ["not http or https · contains a name and password",
            "不是 http 或 https · 含有用户名和密码"],
        next: ["write https://HOST/…; the secret is set separately", "写作 https://主机/…；密钥另行设置"],
    }
    NoHook = "E0877" {
        title: ["there is no such webhook", "没有此 webhook"],
        likely: ["a typing mistake · wrong configuration file", "输入错误 · 使用了别的配置"],
        next: ["check the configuration", "查看配置文件"],
    }
    HookRefused = "E0878" {
        title: ["the receiver of the webhook did not accept the event", "webhook 接收方未接受事件"],
        likely: ["wrong path · different secret · error in the receiver",
            "路径有误 · 密钥不一致 · 接收方自身出错"],
        next: ["check the receiver's log", "查看接收方的日志"],
    }
    HookSecret = "E0879" {
        title: ["webhook secrets can't be saved", "无法保存 webhook 密钥"],
        likely: ["disk full · no write permission for the state folder",
            "磁盘已满 · 状态文件夹无写权限"],
        next: ["free disk space, or correct the permissions", "腾出空间或修正权限"],
    }
    OutletStuck = "E0880" {
        title: ["the integration does not stop or answer", "集成未停止或无响应"],
        likely: ["the other side holds the connection · an error in this program",
            "对方占用连接 · 程序自身出错"],
        next: ["check the other side; if this repeats, restart the daemon",
            "检查对方；若反复出现，请重启守护进程"],
    }
    SettingsChanged = "E0881" {
        title: ["nothing written: the module's settings differ from those shown",
            "未写入：模块的设置与所见不同"],
        likely: ["changed by someone else in the meantime", "期间被他人更改"],
        next: ["read the settings again, then change them", "重新读取设置后再更改"],
    }
    NoSettingsMatch = "E0882" {
        title: ["nothing written: If-Match does not say which settings are to be changed",
            "未写入：If-Match 未说明要更改哪些设置"],
        likely: ["If-Match is missing", "缺少 If-Match"],
        next: ["GET the settings, and send their ETag as If-Match",
            "先 GET 设置，并以其 ETag 作为 If-Match"],
    }
    LineAtWork = "E0883" {
        title: ["another operation is running on this line", "该总线上正在执行其他操作"],
        likely: ["a scan or a change of settings is running", "正在扫描或更改设置"],
        next: ["wait until it has finished, or cancel it", "等待其结束，或将其取消"],
    }
    OtherSite = "E0884" {
        title: ["not done: the daemon that answers serves another site",
            "未执行：应答的守护进程属于另一个站点"],
        likely: ["another daemon runs, such as the demo · this is another folder than meant",
            "正在运行别的守护进程（例如演示） · 当前目录不对"],
        next: ["name the site: --socket for that daemon, --config for this file",
            "指明站点：--socket 使用该守护进程，--config 使用此文件"],
    }
    ConfigListen = "E0885" {
        title: ["not a valid listening address or network", "监听地址或网络的写法不对"],
        likely: ["the port is missing · a name in place of a number", "缺少端口 · 写了名称而不是数字"],
        next: ["write 127.0.0.1:1502, or a network such as 192.168.1.0/24",
            "应写为 127.0.0.1:1502，或网络如 192.168.1.0/24"],
    }
    ConfigUnit = "E0886" {
        title: ["a module has no valid Modbus unit number", "模块的 Modbus 单元号无效"],
        likely: ["the module's address is not from 1 to 247 · a typing mistake",
            "模块地址不在 1 至 247 之内 · 输入错误"],
        next: ["give it a number from 1 to 247: units = [\"MODULE=N\"]",
            "指定 1 至 247 的单元号：units = [\"模块=N\"]"],
    }
    ConfigUnitTaken = "E0887" {
        title: ["two modules have the same Modbus unit number", "两个模块的 Modbus 单元号相同"],
        likely: ["they are on different lines and have the same address", "它们在不同总线上，地址相同"],
        next: ["give one of them another number: units = [\"MODULE=N\"]",
            "为其中一个另指定单元号：units = [\"模块=N\"]"],
    }
    ConfigUnguarded = "E0888" {
        title: ["other machines could connect without a password", "其他机器无需密码即可连接"],
        likely: ["it listens beyond this machine, and \"allow\" is missing",
            "监听范围超出本机，且没有 \"allow\""],
        next: ["add allow = [\"192.168.1.0/24\"], or listen at 127.0.0.1 only",
            "加上 allow = [\"192.168.1.0/24\"]，或只监听 127.0.0.1"],
    }
    ConfigRole = "E0889" {
        title: ["the rights of clients are not valid", "客户端权限的配置不对"],
        likely: ["a typing mistake in \"roles\" · \"write\" beside TLS",
            "\"roles\" 输入错误 · 使用 TLS 时写了 \"write\""],
        next: ["roles = [\"operator=pump.*\"]", "roles = [\"operator=pump.*\"]"],
    }
    ConfigFault = "E0890" {
        title: ["unknown simulated fault", "未知的仿真故障"],
        likely: ["a typing mistake · a value is missing", "输入错误 · 缺少数值"],
        next: ["railbus help sim     lists them", "railbus help sim     列出所有故障"],
    }
    SimState = "E0891" {
        title: ["the saved settings of the simulated modules can't be used", "无法使用所保存的仿真模块设置"],
        likely: ["a different kind of file, or of another plant · no permission",
            "文件属于其他用途或其他仿真文件 · 无权限"],
        next: ["choose another file with --state", "用 --state 换一个文件"],
    }
    SimPlant = "E0892" {
        title: ["the plant can't be simulated", "仿真文件无法运行"],
        likely: ["a flag names a line that does not exist · nothing to simulate",
            "参数中的总线不存在 · 没有可仿真的总线"],
        next: ["railbus help sim", "railbus help sim"],
    }
    ConfigInput = "E0893" {
        title: ["a simulated level at a point that is not an input", "仿真电平所在的点位不是输入"],
        likely: ["outputs and variables are set by the module and its master", "输出和变量由模块和主站控制"],
        next: ["use an input: di0, k1 of an input board, ai1", "使用输入：di0、输入板的 k1、ai1"],
    }
    AuditBroken = "E0894" {
        title: ["the audit log has been altered", "审计日志已被改动"],
        likely: ["a part was changed or removed · a failing disk",
            "部分内容被改动或删除 · 磁盘故障"],
        next: ["compare with a copy: railbus audit export", "与备份比对：railbus audit export"],
    }
    OutletListen = "E0895" {
        title: ["the integration is not listening at its address", "集成未在其地址上监听"],
        likely: ["another program has the port · ports below 1024 need a permission · this machine \
            has no such address",
            "端口被其他程序占用 · 1024 以下的端口需要权限 · 本机没有该地址"],
        next: ["find the program with ss -ltnp, or use another port such as 1502",
            "用 ss -ltnp 查找占用的程序，或换用其他端口，如 1502"],
    }
    BrokerUnreached = "E0896" {
        title: ["the MQTT broker can't be reached", "无法连接 MQTT 代理"],
        likely: ["wrong host or port · the broker is not running · no network connection",
            "主机或端口有误 · 代理未运行 · 网络不通"],
        next: ["test it from this machine: mosquitto_sub -h HOST -p PORT -t '$SYS/#' -C 1",
            "在本机测试：mosquitto_sub -h 主机 -p 端口 -t '$SYS/#' -C 1"],
    }
    BrokerTls = "E0897" {
        title: ["no trusted connection to the MQTT broker", "无法与 MQTT 代理建立可信连接"],
        likely: ["its certificate is for another name or from another authority · the port is one \
            without TLS · the broker wants a certificate of the client",
            "证书的域名不符或由其他机构签发 · 该端口未启用 TLS · 代理要求客户端证书"],
        next: ["set ca to the file of its authority; cert and key if it wants them",
            "将 ca 设为其 CA 证书文件；代理要求时再设 cert 和 key"],
    }
    BrokerLogin = "E0898" {
        title: ["the MQTT broker does not accept this user", "MQTT 代理不接受该用户"],
        likely: ["wrong user name or password · the broker takes nobody without a password",
            "用户名或密码有误 · 代理不允许无密码连接"],
        next: ["enter user name and password of the integration again",
            "重新输入集成的用户名和密码"],
    }
    BrokerRefused = "E0899" {
        title: ["the MQTT broker ended the connection", "MQTT 代理断开了连接"],
        likely: ["another client has the same client ID · not an MQTT port · a port with TLS · \
            another version",
            "另一客户端使用了相同的客户端 ID · 不是 MQTT 端口 · 该端口启用了 TLS · 协议版本不符"],
        next: ["look into the log of the broker; give the integration another client_id",
            "查看代理的日志；为集成另设 client_id"],
    }
}
