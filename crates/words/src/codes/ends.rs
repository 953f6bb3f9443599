//! Permissions, differences, and ends that are not failures: exit codes from 9 on.

use super::{Code, codes};

codes! {
    Forbidden = "E0901" {
        title: ["request not allowed from this origin", "不允许来自该来源的请求"],
        likely: ["a request from another machine or page", "请求来自其他机器或网页"],
        next: ["use the daemon's own machine", "请在守护进程所在机器上操作"],
    }
    Unauthenticated = "E0902" {
        title: ["log in first, or use a token", "请先登录，或使用令牌"],
        likely: ["no cookie and no Authorization header · the session or token has expired",
            "没有 Cookie 或 Authorization 头 · 会话或令牌已失效"],
        next: ["railbus token create NAME --role viewer", "railbus token create 名称 --role viewer"],
    }
    NotLoopback = "E0903" {
        title: ["refusing to listen on the network without TLS and a user",
            "没有 TLS 和用户时不向其他机器开放"],
        likely: ["--listen names an address that others can reach", "--listen 的地址可被其他机器访问"],
        next: ["railbus user add NAME --role admin, then railbus serve --tls auto",
            "railbus user add 用户名 --role admin，再 railbus serve --tls auto"],
    }
    WrongLogin = "E0904" {
        title: ["name or password is wrong, or the user is locked", "用户名或密码错误，或该用户已锁定"],
        likely: ["a typing mistake · wrong daemon", "输入错误 · 连接了别的守护进程"],
        next: ["railbus user passwd NAME", "railbus user passwd 用户名"],
    }
    RoleTooLow = "E0905" {
        title: ["your role does not allow this", "您的角色无权执行此操作"],
        likely: ["viewers look, operators switch, engineers configure, admins manage users",
            "viewer 可查看，operator 可操作，engineer 可配置，admin 可管理用户"],
        next: ["ask an administrator: railbus user list", "请联系管理员：railbus user list"],
    }
    PointRight = "E0906" {
        title: ["you may not switch this point", "您无权操作该点位"],
        likely: ["the user or the token is limited to some points", "该用户或令牌只限于部分点位"],
        next: ["ask an administrator: railbus user list", "请联系管理员：railbus user list"],
    }
    TooManyTries = "E0907" {
        title: ["too many attempts; please wait", "尝试次数过多，请稍候"],
        likely: ["five failed attempts within a minute, for one account or from one address",
            "一分钟内同一账户或同一地址五次输入错误"],
        next: ["wait a minute, or railbus user passwd NAME", "等待一分钟，或 railbus user passwd 用户名"],
    }
    Csrf = "E0908" {
        title: ["the request lacks the X-CSRF-Token of its session", "请求缺少会话的 X-CSRF-Token"],
        likely: ["a page of another site · a page older than the session",
            "来自其他网站的网页 · 网页早于会话"],
        next: ["reload the page; programs should use a token instead of a cookie",
            "重新加载网页；程序请改用令牌"],
    }
    SetupLink = "E0909" {
        title: ["the set-up link is invalid or has expired", "设置链接无效或已失效"],
        likely: ["older than 15 min, already used, or replaced by a newer one",
            "已超过 15 分钟、已使用，或已生成新链接"],
        next: ["railbus user setup-link", "railbus user setup-link"],
    }
    NoUser = "E0910" {
        title: ["there is no such user", "没有该用户"],
        likely: ["a typing mistake · another daemon or configuration", "输入错误 · 别的守护进程或配置"],
        next: ["railbus user list", "railbus user list"],
    }
    NameTaken = "E0911" {
        title: ["the name is taken", "名称已被使用"],
        likely: ["there is a user or a token of this name", "已有同名用户或令牌"],
        next: ["railbus user list, or railbus token list",
            "railbus user list 或 railbus token list"],
    }
    LastAdmin = "E0912" {
        title: ["at least one unlocked administrator must remain", "至少须保留一名未锁定的管理员"],
        likely: ["this is the last one · the first user must be an administrator",
            "这是最后一名管理员 · 首个用户不是管理员"],
        next: ["railbus user add NAME --role admin", "railbus user add 用户名 --role admin"],
    }
    WeakPassword = "E0913" {
        title: ["the password is too short, too long or too simple", "密码过短、过长或过于简单"],
        likely: ["fewer than 10 letters, more than 256 bytes, one letter only, or the name itself",
            "少于 10 个字符、超过 256 字节、只有一种字符，或与用户名相同"],
        next: ["use a few words that others won't guess", "请使用几个他人想不到的词"],
    }
    NoToken = "E0914" {
        title: ["there is no such token", "没有该令牌"],
        likely: ["a typing mistake · already revoked", "输入错误 · 已被撤销"],
        next: ["railbus token list", "railbus token list"],
    }
    TooManyAccounts = "E0915" {
        title: ["the limit is reached", "数量已达上限"],
        likely: ["at most 64 users and 64 tokens", "最多 64 个用户和 64 个令牌"],
        next: ["railbus token revoke NAME", "railbus token revoke 名称"],
    }
    AccountsFile = "E0916" {
        title: ["the accounts can't be read or saved", "无法读取或保存账户"],
        likely: ["no write permission for the state folder · disk full", "状态文件夹不可写 · 磁盘已满"],
        next: ["free disk space or restore write permission for the state folder, then repeat",
            "腾出空间或恢复状态文件夹的写权限，然后重试"],
    }
    AccountsHeld = "E0917" {
        title: ["the accounts are in use by another program", "账户正由其他程序使用"],
        likely: ["a daemon, or the centre of a fleet, on another socket uses them",
            "有守护进程或站群中心在别的套接字上使用它们"],
        next: ["name its socket with --socket", "用 --socket 指定其套接字"],
    }
    NoSession = "E0918" {
        title: ["there is no such session", "没有该会话"],
        likely: ["it has expired", "会话已结束"],
        next: ["reload the list", "重新加载列表"],
    }
    HasUser = "E0919" {
        title: ["a user exists already, who can add others", "已有用户，可由其添加其他用户"],
        likely: ["the set-up link is for the first user only", "设置链接只用于创建首个用户"],
        next: ["railbus user add NAME --role admin", "railbus user add 用户名 --role admin"],
    }
    BadName = "E0920" {
        title: ["invalid name", "名称无效"],
        likely: ["names are 1 to 32 letters or digits, and . _ - @ after the first; owner is taken",
            "名称为 1 至 32 个字母、汉字或数字，首字符之后可用 . _ - @；owner 为保留名"],
        next: ["choose another name", "换一个名称"],
    }
    BadPoints = "E0921" {
        title: ["invalid point pattern", "点位匹配模式无效"],
        likely: ["patterns look like pump, pump.* or *.do0; at most 32",
            "模式如 pump、pump.* 或 *.do0，最多 32 个"],
        next: ["railbus ls points", "railbus ls points"],
    }
    Limited = "E0922" {
        title: ["your access is limited to some points, and this may affect others",
            "您的权限只限于部分点位，而此操作可能影响其他点位"],
        likely: ["with access limited to points you can switch and name these, but change \
            nothing else",
            "权限限于部分点位者只能操作和命名这些点位，不能更改其他内容"],
        next: ["ask an engineer or an administrator without this limit: railbus user list",
            "请由不受此限制的工程师或管理员操作：railbus user list"],
    }
    OwnerOnly = "E0923" {
        title: ["only the owner of the daemon may change this", "只有守护进程的所有者可以更改此项"],
        likely: ["[ports] and [webhooks] limit what everybody else may configure",
            "[ports] 和 [webhooks] 限定其他人可以配置的内容"],
        next: ["on the daemon's machine, edit the file, then: systemctl reload railbus",
            "在守护进程所在机器上编辑配置文件，再执行 systemctl reload railbus"],
    }
    PortNotAllowed = "E0924" {
        title: ["a configuration sent over the network may not open this port",
            "不允许通过网络提交的配置打开此端口"],
        likely: ["not a serial port, not in the configuration at start, and not in [ports] allow",
            "它不是串口，启动时的配置中没有，[ports] allow 中也没有"],
        next: ["have the owner of the daemon add it to allow in [ports] of the file, and reload",
            "请守护进程的所有者将其加入配置文件 [ports] 的 allow，然后重新加载"],
    }
    HookTarget = "E0925" {
        title: ["a webhook may not lead to this address", "Webhook 不能指向此地址"],
        likely: ["an address of the daemon's own machine, or of its local link",
            "该地址属于守护进程所在机器，或仅限其本地链路"],
        next: ["have the owner of the daemon add it to allow in [webhooks] of the file, and reload",
            "请守护进程的所有者将其加入配置文件 [webhooks] 的 allow，然后重新加载"],
    }
    OutletTls = "E0926" {
        title: ["certificate or key of the integration can't be used", "集成的证书或私钥不可用"],
        likely: ["expired · key of another certificate · wrong file · no read permission · the \
            clock is wrong",
            "已过期 · 私钥与证书不匹配 · 文件不对 · 无读取权限 · 时钟不准"],
        next: ["check the file with openssl x509 -noout -text -in FILE, and that the user of the \
            daemon may read it",
            "用 openssl x509 -noout -text -in 文件 查看，并确认守护进程的用户有读取权限"],
    }
    ClientNoCert = "E0927" {
        title: ["a client without a certificate was refused", "已拒绝没有证书的客户端"],
        likely: ["certificate and key are not set in the client", "客户端没有设置证书和私钥"],
        next: ["give the client a certificate issued by client_ca", "为客户端配置由 client_ca 签发的证书"],
    }
    ClientCert = "E0928" {
        title: ["the certificate of a client was not accepted", "客户端的证书未被接受"],
        likely: ["issued by another authority than client_ca · expired · not for clients · the \
            clock is wrong",
            "不是由 client_ca 签发 · 已过期 · 不能用于客户端 · 时钟不准"],
        next: ["check it with openssl verify -purpose sslclient -CAfile CA FILE",
            "用 openssl verify -purpose sslclient -CAfile CA文件 证书文件 检查"],
    }
    ClientNotTls = "E0929" {
        title: ["a client that does not speak TLS 1.2 or newer was refused",
            "已拒绝不使用 TLS 1.2 及以上版本的客户端"],
        likely: ["plain Modbus TCP on a port for TLS · an old client",
            "在 TLS 端口上使用了不加密的 Modbus TCP · 客户端版本过旧"],
        next: ["turn TLS on in the client", "在客户端启用 TLS"],
    }
    ClientHandshake = "E0930" {
        title: ["the TLS handshake with a client failed", "与客户端的 TLS 握手失败"],
        likely: ["the client does not trust this certificate, or expects another name in it",
            "客户端不信任本机证书，或证书中的名称与其预期不符"],
        next: ["give the client the authority of this certificate, and use a name in it",
            "在客户端添加本机证书的签发机构，并使用证书中的名称"],
    }
    ClientRole = "E0931" {
        title: ["the role in the certificate of a client can't be used: it only reads",
            "客户端证书中的角色不可用，只允许读取"],
        likely: ["there are two roles, or the role is not a UTF8String", "有两个角色，或角色不是 UTF8String"],
        next: ["issue the certificate again, with 1.3.6.1.4.1.50316.802.1 = ASN1:UTF8String:ROLE",
            "重新签发证书，并写入 1.3.6.1.4.1.50316.802.1 = ASN1:UTF8String:角色"],
    }
    BrokerTopic = "E0932" {
        title: ["the MQTT broker does not allow a topic", "MQTT 代理不允许该主题"],
        likely: ["the broker's access list does not name the topics of railbus for this user",
            "代理的访问控制列表未授权该用户使用 railbus 的主题"],
        next: ["allow this user to read and write BASE/SITE/#; with Sparkplug spBv1.0/#",
            "授权该用户读写 前缀/站点/#；Sparkplug 为 spBv1.0/#"],
    }
    ClientUntrusted = "E0933" {
        title: ["the certificate of a client is not trusted", "客户端的证书不受信任"],
        likely: ["the client connects for the first time, or has a new certificate",
            "该客户端首次连接，或已更换证书"],
        next: ["compare this thumbprint with the one the client shows, and add it to trusted of \
            the integration",
            "与客户端显示的指纹核对后，将其加入集成的 trusted"],
    }
    FleetLogin = "E0934" {
        title: ["the servers of the fleet do not accept this site", "站群服务器不接受该站点"],
        likely: ["its credentials have expired or were revoked · they are of another fleet",
            "凭据已过期或被吊销 · 凭据属于其他站群"],
        next: ["make an invitation, and accept it here: railbus fleet enrol DIR SITE FILE",
            "生成邀请并在此接受：railbus fleet enrol 文件夹 站点 文件"],
    }
    FleetTaken = "E0935" {
        title: ["the centre of the fleet does not give this site a session", "站群中心未给该站点会话"],
        likely: ["another machine reports as this site: a copied disk, or a file given twice",
            "另一台机器正以该站点上报：磁盘被复制，或凭据文件重复使用"],
        next: ["stop the other one, or make credentials of its own for it",
            "停用另一台，或为其生成单独的凭据"],
    }
    FleetKeyEnds = "E0936" {
        title: ["the key of this site expires soon", "该站点的密钥即将过期"],
        likely: ["the centre could not renew it: the centre or its keys are away · the file can't \
            be replaced",
            "中心未能续期：中心或其密钥不可用 · 凭据文件无法替换"],
        next: ["run the centre with the folder hub/ of the fleet, or make another key: railbus \
            fleet creds DIR SITE FILE",
            "以站群的 hub/ 文件夹运行中心，或重新生成：railbus fleet creds 文件夹 站点 文件"],
    }
    NotRemote = "E0937" {
        title: ["this can't be done from the centre of a fleet", "此操作不能从站群中心进行"],
        likely: ["from there a site can be read and its outputs switched, and nothing else can be \
            followed or changed",
            "从中心可以读取站点、操作其输出，不能持续跟踪或修改其他内容"],
        next: ["do it at the site", "在站点本地进行"],
    }
    NotInvited = "E0938" {
        title: ["the invitation is not accepted", "邀请未被接受"],
        likely: ["it was used already, has expired, was revoked, or is not whole",
            "已被使用、已过期、已吊销或内容不完整"],
        next: ["make another one: railbus fleet enrol DIR SITE FILE",
            "重新生成：railbus fleet enrol 文件夹 站点 文件"],
    }
    NoKey = "E0939" {
        title: ["the centre of the fleet issued no key", "站群中心未签发密钥"],
        likely: ["it lacks files of the folder hub/ · its clock is wrong · the site has too many \
            keys · it was asked too often · another invitation is being accepted here",
            "中心缺少 hub/ 中的文件 · 中心时钟有误 · 站点密钥过多 · 请求过于频繁 · 本站点正在接受另一邀请"],
        next: ["mend what the reason names, or wait ten seconds, and try again: what was made for \
            it is kept",
            "按原因处理，或等待十秒后重试：已生成的内容会保留"],
    }
    OtherFleet = "E0940" {
        title: ["the integration is of another fleet or site", "该集成属于其他站群或站点"],
        likely: ["the invitation is of another one · its files can't be read",
            "邀请属于其他站群或站点 · 其文件无法读取"],
        next: ["add another integration, railbus fleet join --name NAME, or remove this one first",
            "用 railbus fleet join --name 名称 添加另一集成，或先删除该集成"],
    }
    ReadsOnly = "E0941" {
        title: ["the site lets this integration read only", "站点只允许此集成读取"],
        likely: ["its write is empty: no output may be switched from afar",
            "该集成的 write 为空：不允许从远端操作任何输出"],
        next: ["at the site, name modules or outputs in it: write = [\"oven\"]",
            "在该站点的集成中填写模块或输出：write = [\"oven\"]"],
    }
    NotManaged = "E0942" {
        title: ["the site takes no configuration from its centre", "该站点不接受中心下发的配置"],
        likely: ["its integration has no config_key · it runs an older version",
            "其集成未设置 config_key · 该站点版本较旧"],
        next: ["at the site, give its integration the key of the centre: config_key = \"KEY\"; \
            railbus fleet config-key DIR shows it",
            "在该站点的集成中填写中心的密钥：config_key = \"密钥\"；\
            railbus fleet config-key 文件夹 可显示该密钥"],
    }
    SiteConfigChanged = "E0943" {
        title: ["what the site has is not the configuration that its centre gave it",
            "该站点的配置与中心下发的不一致"],
        likely: ["it was changed at the site · it had one before the centre gave it any",
            "配置已在站点本地更改 · 中心首次下发之前站点已有配置"],
        next: ["look at it, railbus fleet config SITE --text, then replace it: --replace HASH",
            "先查看：railbus fleet config 站点 --text，确认后用 --replace 哈希 替换"],
    }
    ConfigTakenBack = "E0944" {
        title: ["the site did not work as before, and went back to the configuration before",
            "站点未能像之前一样工作，已恢复先前的配置"],
        likely: ["a line, a module or the session with the centre was lost while it was tried · \
            the site was restarted meanwhile",
            "试用期间总线、模块或与中心的会话中断 · 站点在此期间重启"],
        next: ["mend what the reason names, and send it again", "按原因处理后重新下发"],
    }
    ConfigUntrusted = "E0945" {
        title: ["a configuration from the centre is not trusted", "中心下发的配置不受信任"],
        likely: ["another key signed it than config_key names · it is of another site",
            "签名密钥与 config_key 不符 · 该配置属于其他站点"],
        next: ["compare config_key with railbus fleet config-key DIR at the centre",
            "将 config_key 与中心的 railbus fleet config-key 文件夹 核对"],
    }
    NoConfigKey = "E0946" {
        title: ["the centre has no key that signs configurations", "中心没有用于签署配置的密钥"],
        likely: ["the fleet was founded by an older version · the key is kept elsewhere",
            "站群由较旧版本建立 · 密钥存放在别处"],
        next: ["railbus fleet config-key DIR", "railbus fleet config-key 文件夹"],
    }
    SiteOwn = "E0947" {
        title: ["this part of a configuration is the site's own", "配置的这一部分只能由站点自己设置"],
        likely: ["integrations, history, audit, and what the owner of a site allows are not for \
            the centre to say",
            "集成、历史、审计以及站点所有者允许的内容不能由中心下发"],
        next: ["leave it out, and change it at the site", "删去这一部分，并在站点本地更改"],
    }
    Differs = "E1001" {
        title: ["differences were found", "发现差异"],
        likely: ["the modules' settings are not as configured", "模块设置与期望不同"],
        next: ["see the list of differences", "查看差异列表"],
    }
    RepliesDiffer = "E1080" {
        title: ["replies differ from the recording", "应答与记录不同"],
        likely: ["inputs have changed · another module or firmware", "输入已变化 · 模块或固件不同"],
        next: ["railbus replay FILE --as-host -o ndjson", "railbus replay 文件 --as-host -o ndjson"],
    }
    Partial = "E1101" {
        title: ["some of several targets failed", "多个目标中部分失败"],
        likely: ["see the individual results", "见各目标的说明"],
        next: ["railbus ls", "railbus ls"],
    }
    ScanTimeUp = "E1170" {
        title: ["time is up before the scan was complete", "时间已到，扫描未完成"],
        likely: ["--max-time is shorter than the scan", "--max-time 短于扫描所需时间"],
        next: ["railbus scan --resume, with the same options", "railbus scan --resume，选项相同"],
    }
    WaitedInVain = "E1201" {
        title: ["the points did not get the values waited for in time",
            "等待的点位未按时达到指定的值"],
        likely: ["the value did not come · it came and went between two reads · the module does \
            not answer",
            "值未出现 · 值在两次读取之间出现又消失 · 模块无应答"],
        next: ["railbus watch POINT", "railbus watch 点位"],
    }
    Interrupted = "E1300" {
        title: ["interrupted", "已中断"],
        likely: ["Ctrl-C", "按下了 Ctrl-C"],
        next: ["railbus get --fresh     shows the state of the outputs",
            "railbus get --fresh     查看输出状态"],
    }
}
