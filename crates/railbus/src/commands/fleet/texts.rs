//! The texts of `railbus fleet`.

railbus_words::texts! {
    pub(crate) FleetText;

    About {
        en: "A fleet: many sites behind one centre, over NATS servers of your own.",
        zh: "站群：多个站点通过自有 NATS 服务器接入同一中心。",
    }
    Examples {
        en: "  railbus fleet demo
  railbus fleet init acme --nats nats1,nats2,nats3
  railbus fleet serve acme
  railbus fleet enrol acme plant7 plant7.invitation
  railbus fleet join plant7.invitation
  railbus fleet get plant7 oven.k1
  railbus set -s plant7 oven.k1 on
  railbus fleet set oven.k1 on --group north
  railbus fleet revoke acme plant7",
        zh: "  railbus fleet demo
  railbus fleet init acme --nats nats1,nats2,nats3
  railbus fleet serve acme
  railbus fleet enrol acme plant7 plant7.invitation
  railbus fleet join plant7.invitation
  railbus fleet get plant7 oven.k1
  railbus set -s plant7 oven.k1 on
  railbus fleet set oven.k1 on --group north
  railbus fleet revoke acme plant7",
    }
    Init {
        en: "Make the keys, accounts and certificates of a new fleet, and the \
            configuration of each of its NATS servers.",
        zh: "生成新站群的密钥、账户和证书，以及每台 NATS 服务器的配置。",
    }
    NewFolder { en: "A new folder for its files", zh: "存放文件的新文件夹" }
    Nats {
        en: "Its servers: 1, 3 or 5 host names or IPv4 addresses. Other \
            servers reach it at a port 2000 higher [port: 4222]",
        zh: "服务器：1、3 或 5 个主机名或 IPv4 地址。服务器之间使用高 2000 的端口 [端口：4222]",
    }
    BadCount {
        en: "no fleet was made: {count} servers, and there can be 1, 3 or 5",
        zh: "未生成站群：给出了 {count} 台服务器，只能为 1、3 或 5 台",
    }
    NamedTwice {
        en: "no fleet was made: {server} is named twice",
        zh: "未生成站群：{server} 重复",
    }
    NoKey { en: "no key can be made: {why}", zh: "无法生成密钥：{why}" }
    NotEmpty {
        en: "there is something in it already, which is left as it is",
        zh: "其中已有内容，未作任何改动",
    }
    Head { en: "FOLDER|WHAT FOR", zh: "文件夹|用途" }
    ForHub {
        en: "for the centre: whoever holds it can impersonate any site",
        zh: "供中心使用：持有者可冒充任何站点",
    }
    ForOffline {
        en: "all other keys: keep them on no machine of the fleet",
        zh: "其余密钥：不要保存在站群的任何机器上",
    }
    ForServer {
        en: "for {server}: nats-server -c nats.conf, started in it",
        zh: "供 {server} 使用：在其中启动 nats-server -c nats.conf",
    }
    Offline {
        en: "take the folder offline/ away from this machine",
        zh: "请将 offline/ 文件夹移离本机",
    }
    Creds {
        en: "Make a key for a site, and write it to a new file. Whoever has the file can \
            report as this site, and be sent its commands.",
        zh: "为站点生成密钥文件；持有该文件者即可冒充该站点上报和接收命令。",
    }
    Folder { en: "The folder of the fleet", zh: "站群的文件夹" }
    Site { en: "The site: 1 to 64 of a-z, 0-9, - and _", zh: "站点：1 至 64 个 a-z、0-9、- 或 _" }
    File { en: "The new file", zh: "新文件" }
    BadName {
        en: "a site's name has 1 to 64 of a-z, 0-9, - and _",
        zh: "站点名由 1 至 64 个 a-z、0-9、- 或 _ 组成",
    }
    CredsMade {
        en: "valid until {day}, and renewed by the centre before; carry it to {site} by a way you \
            trust",
        zh: "有效期至 {day}，到期前由中心续期；请经可信途径送达 {site}",
    }
    Demo {
        en: "Run a whole fleet on this machine, to try it: a NATS server, the centre, and three \
            simulated sites. Nothing of it is left afterwards.",
        zh: "在本机运行完整的站群供试用：NATS 服务器、中心和三个仿真站点，停止后不留下文件或进程。",
    }
    ServerProgram {
        en: "The program of the server [nats-server]",
        zh: "服务器程序 [nats-server]",
    }
    DemoTitle { en: "a fleet of three simulated sites", zh: "三个仿真站点组成的站群" }
    DemoSays {
        en: "  centre    {centre}   all sites
  server    {server}
{sites}  (one-time links, 15 min)
try in another terminal:
  railbus fleet ls{socket}
  railbus get -s plant2 oven{socket}
  railbus set -s plant2 oven.k3 on{socket}
  railbus fleet commands{socket}
press Ctrl-C to stop",
        zh: "  centre    {centre}   所有站点
  server    {server}
{sites}  （一次性链接，15 分钟内有效）
可在另一终端尝试：
  railbus fleet ls{socket}
  railbus get -s plant2 oven{socket}
  railbus set -s plant2 oven.k3 on{socket}
  railbus fleet commands{socket}
按 Ctrl-C 停止",
    }
    DemoLate { en: "the fleet does not stand after a minute", zh: "一分钟后站群仍未就绪" }
    DemoEnded { en: "{name} has ended", zh: "{name} 已退出" }
    Enrol {
        en: "Make an invitation for a site, which railbus fleet join accepts there: the site \
            makes its key, and the centre admits it. It can be used once; the centre must be \
            running then.",
        zh: "为站点生成一次性邀请，在站点用 railbus fleet join 接受（中心须在运行）：密钥由站点生成。",
    }
    InvitationFile { en: "The new file; - for standard output", zh: "新文件；- 表示标准输出" }
    Hours { en: "For how many hours it is valid [24]", zh: "有效小时数 [24]" }
    NoServers { en: "it names no server", zh: "其中没有服务器" }
    Enrolled {
        en: "whoever accepts it first is {site}, within {hours} h: carry it there by a way you \
            trust",
        zh: "{hours} 小时内首先接受者即为 {site}：请经可信途径送达",
    }
    Join {
        en: "Let this site join a fleet by an invitation. It needs the running daemon, which gets \
            the integration; where that is there, its key is replaced.",
        zh: "凭邀请加入站群：由运行中的守护进程添加集成，已存在时更换密钥。",
    }
    Invitation { en: "The invitation; - for standard input", zh: "邀请文件；- 表示标准输入" }
    IntegrationName { en: "The name of the integration [fleet]", zh: "集成的名称 [fleet]" }
    Joined {
        en: "this site has the key of {site} now (integration {name})",
        zh: "本站点已获得 {site} 的密钥（集成 {name}）",
    }
    JoinedNote {
        en: "the centre may switch what write in [outlet.{name}] names; without it, nothing",
        zh: "中心只能操作 [outlet.{name}] 中 write 列出的输出；未列出则均不可操作",
    }
    Managed {
        en: "the centre may say the configuration of this site, too",
        zh: "同时允许中心下发本站点的配置",
    }
    ManagedNote {
        en: "the centre may say its configuration: config_key in [outlet.{name}]",
        zh: "中心可下发其配置：[outlet.{name}] 中的 config_key",
    }
    NotNoted {
        en: "keys that the centre issued may still be accepted: its streams can't be used",
        zh: "无法使用中心的数据流，中心签发的密钥可能仍被接受",
    }
    Revoke {
        en: "Revoke the keys of a site: servers end its connections at once. Needs the key in \
            offline/, and running servers. Without SITE all revocations are sent to the servers \
            again.",
        zh: "吊销站点的密钥：其连接立即断开。需要 offline/ 中的密钥，且服务器须在运行。不给出 SITE \
            时，将已吊销的全部密钥重新下发到服务器。",
    }
    OfflineFolder {
        en: "The folder with the offline keys [DIR/offline]",
        zh: "离线保管的密钥所在文件夹 [DIR/offline]",
    }
    RevokedSite {
        en: "The site: all keys made for it in DIR or issued by the centre so far",
        zh: "站点：此前在 DIR 中生成或由中心签发的全部密钥",
    }
    UnnotedKey {
        en: "Also this public key (U…), which was made elsewhere",
        zh: "同时吊销在别处生成的公钥（U…）",
    }
    NoKeys {
        en: "no key of {site} is recorded in {file} or at the servers that is not revoked: name it \
            with --key",
        zh: "{file} 和服务器上没有 {site} 的未吊销密钥，请用 --key 指定",
    }
    Revoked {
        en: "keys of {site} revoked: {count}; in force at {servers}",
        zh: "已吊销 {site} 的密钥：{count} 个；已生效的服务器：{servers}",
    }
    AllRevoked {
        en: "revoked keys: {count}; in force at {servers}",
        zh: "已吊销的密钥：{count} 个；已生效的服务器：{servers}",
    }
    NotAllServers {
        en: "in force at {told} of {of} servers; the others may still accept the keys",
        zh: "{of} 台服务器中已有 {told} 台生效；其余服务器可能仍接受这些密钥",
    }
    NewKey {
        en: "to let {site} in again, make an invitation: railbus fleet enrol",
        zh: "如需重新接纳 {site}，请生成邀请：railbus fleet enrol",
    }
    Serve {
        en: "Run the centre of a fleet: it admits the sites, and knows how they are. The \
            commands ls and get ask it, over a socket that only its owner can open.",
        zh: "运行站群中心：接纳各站点并掌握其状态。ls 和 get 命令通过仅限其用户访问的套接字向它查询。",
    }
    Listen {
        en: "Listen here, too, for browsers, and programs with a token of the centre; for other \
            machines TLS and a user are required",
        zh: "同时在此监听网络，提供网页和 API；向其他机器开放须有 TLS 和用户",
    }
    Ls { en: "List the sites of the fleet.", zh: "列出站群的站点。" }
    Get { en: "Show the points of a site, as the centre knows them.", zh: "显示中心所知的站点点位。" }
    Group {
        en: "Set the groups that a site is in, also before it joins; without one it is in none. \
            railbus fleet ls --group lists the sites of a group.",
        zh: "设置站点所属分组，可在加入前设置；不给出则不属于任何分组。railbus fleet ls --group 列出分组的站点。",
    }
    Groups {
        en: "Groups, 16 at most: each 1 to 64 of a-z, 0-9, - and _",
        zh: "分组，最多 16 个：每个 1 至 64 个 a-z、0-9、- 或 _",
    }
    OneGroup { en: "Only the sites of this group", zh: "只列出该分组的站点" }
    BadGroup {
        en: "a group's name has 1 to 64 of a-z, 0-9, - and _",
        zh: "分组名由 1 至 64 个 a-z、0-9、- 或 _ 组成",
    }
    InGroups { en: "{site} is in {groups}", zh: "{site} 所属分组：{groups}" }
    InNoGroup { en: "{site} is in no group", zh: "{site} 不属于任何分组" }
    NeverReported {
        en: "no site named {site} has reported yet",
        zh: "尚无名为 {site} 的站点上报",
    }
    Remove {
        en: "Remove a site that is gone for good, with its values and groups. It must be \
            offline. Its key stays valid: if it comes back, it is a new site.",
        zh: "移除已停用的离线站点及其数据；密钥仍有效，重新连接则为新站点。",
    }
    Removed { en: "{site} removed", zh: "已移除 {site}" }
    NotPurged {
        en: "the servers still hold its last values and groups until it comes back, and changes \
            for a day",
        zh: "服务器仍保留其最后的数值和分组，直至再次连接；变化记录再保留一天",
    }
    KeepOut {
        en: "a key that was not revoked stays valid; to keep it out: railbus fleet revoke DIR \
            {site}",
        zh: "未吊销的密钥仍然有效；如不再接纳：railbus fleet revoke 文件夹 {site}",
    }
    CommandsAbout {
        en: "List the commands that were given to sites through the centre, and their results.",
        zh: "列出经中心下达给站点的命令及其结果。",
    }
    Limit { en: "How many, the newest [20]", zh: "显示最新的几条 [20]" }
    CommandsHead { en: "WHEN|SITE|WHAT|BY|RESULT", zh: "时间|站点|命令|操作者|结果" }
    Toggle { en: "toggle", zh: "翻转" }
    Pulse { en: "pulse", zh: "点动" }
    Scene { en: "scene {name}", zh: "场景 {name}" }
    Done { en: "done", zh: "已完成" }
    SentOnly { en: "sent, not confirmed", zh: "已发送，未确认" }
    NotDone { en: "not carried out: {why}", zh: "未执行：{why}" }
    NoEndYet { en: "no answer yet", zh: "尚无应答" }
    NeverKnown { en: "not known whether it was carried out", zh: "不知道是否已执行" }
    SiteName { en: "The site", zh: "站点" }
    SiteOrId {
        en: "The site; or the id of a command to several sites, to see what came of each",
        zh: "站点；或多站点命令的编号，显示各站点的结果",
    }
    Points {
        en: "Modules or points, such as oven or oven.k1 [all]",
        zh: "模块或点位，如 oven 或 oven.k1 [全部]",
    }
    SitesHead {
        en: "SITE|STATE|VALUES|HEARD|BEHIND|NOTE",
        zh: "站点|状态|数值|最近心跳|待送|备注",
    }
    GroupsHead { en: "GROUPS", zh: "分组" }
    Online { en: "online", zh: "在线" }
    Away { en: "offline", zh: "离线" }
    Unknown { en: "unknown", zh: "未知" }
    Current { en: "current", zh: "当前" }
    Old { en: "old", zh: "非当前" }
    None { en: "none", zh: "无" }
    Ago { en: "{time} ago", zh: "{time}前" }
    Copied {
        en: "another machine has its key ({ago})",
        zh: "另一台机器使用同一密钥（{ago}）",
    }
    KeyEnds { en: "key valid until {day}", zh: "密钥有效期至 {day}" }
    ClockOff { en: "clock off by {time}", zh: "时钟偏差 {time}" }
    AsOf { en: "as they were about {ago}, or later", zh: "约为 {ago}或之后的值" }
    WereSo {
        en: "the values of {site} are not current: they were so {ago}",
        zh: "{site} 的数值不是当前值：{ago}如此",
    }
    NeverSo { en: "the values of {site} are not current", zh: "{site} 的数值不是当前值" }
    SiteOffline { en: "site offline", zh: "站点离线" }
    SiteUnknown { en: "not known whether the site is there", zh: "站点是否在线未知" }
    Incomplete { en: "not all has arrived in time", zh: "未及时收齐" }
    NoSuchPoint { en: "{site} has no point {name}", zh: "{site} 没有点位 {name}" }
}
