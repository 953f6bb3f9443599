//! The texts of `railbus export`.

railbus_words::texts! {
    pub(crate) ExportText;

    About {
        en: "Export the configuration for another tool: Home Assistant, Grafana and others.",
        zh: "为其他工具导出配置：Home Assistant、Grafana 等。",
    }
    Examples {
        en: "  railbus export ha > railbus.yaml
  railbus export nodered > flow.json
  railbus export prometheus > prometheus.yml
  railbus export prometheus --rules > railbus.rules.yml
  railbus export grafana > dashboard.json
  railbus export telegraf --url https://gate:7485 > railbus.conf
  railbus export csv > points.csv
  railbus export mbpoll              a command line for each Modbus module",
        zh: "  railbus export ha > railbus.yaml
  railbus export nodered > flow.json
  railbus export prometheus > prometheus.yml
  railbus export prometheus --rules > railbus.rules.yml
  railbus export grafana > dashboard.json
  railbus export telegraf --url https://gate:7485 > railbus.conf
  railbus export csv > points.csv
  railbus export mbpoll              每个 Modbus 模块一条命令",
    }
    Form {
        en: "ha, nodered, telegraf, prometheus, grafana, csv or mbpoll",
        zh: "ha、nodered、telegraf、prometheus、grafana、csv 或 mbpoll",
    }
    Url {
        en: "Where the other program reaches the daemon [default: http://127.0.0.1:7485]",
        zh: "其他程序访问守护进程的地址 [默认：http://127.0.0.1:7485]",
    }
    Outlet {
        en: "Integration to use, if there are several (ha, nodered)",
        zh: "有多个集成时，使用哪一个（ha、nodered）",
    }
    Site {
        en: "Name of the site in the file; topics of MQTT stay [default: the folder of the \
configuration]",
        zh: "文件中的站点名称，不改变 MQTT 主题 [默认：配置文件所在文件夹的名称]",
    }
    Http {
        en: "Over HTTP, even if there is an MQTT integration (nodered)",
        zh: "即使有 MQTT 集成也使用 HTTP（nodered）",
    }
    Rules {
        en: "The alerting rules, a file of their own (prometheus)",
        zh: "报警规则，单独一个文件（prometheus）",
    }
    LeftOut {
        en: "left out (not Modbus, or on a line that mbpoll does not support): {modules}",
        zh: "未导出，因非 Modbus 或 mbpoll 不支持其总线：{modules}",
    }
    Token {
        en: "token: railbus token create {program} --role {role} -o value > {file}",
        zh: "令牌：railbus token create {program} --role {role} -o value > {file}",
    }
    Certificate {
        en: "certificate of the daemon (PEM): {file}; not needed if an authority has issued it",
        zh: "守护进程的证书（PEM）：{file}；由公认机构签发的证书不需要",
    }

    // Home Assistant.
    HaMqtt {
        en: "railbus, site {site}: Home Assistant over MQTT (integration {outlet}), no discovery.
Save it beside configuration.yaml as railbus.yaml, and add there:
  homeassistant:
    packages:
      railbus: !include railbus.yaml",
        zh: "railbus，站点 {site}：Home Assistant 通过 MQTT（集成 {outlet}）接入，不使用自动发现。
以 railbus.yaml 为名存放在 configuration.yaml 旁，并在后者中加入：
  homeassistant:
    packages:
      railbus: !include railbus.yaml",
    }
    HaModbus {
        en: "railbus, site {site}: Home Assistant over Modbus TCP (integration {outlet}).
Save it beside configuration.yaml as railbus.yaml, and add there:
  homeassistant:
    packages:
      railbus: !include railbus.yaml",
        zh: "railbus，站点 {site}：Home Assistant 通过 Modbus TCP（集成 {outlet}）接入。
以 railbus.yaml 为名存放在 configuration.yaml 旁，并在后者中加入：
  homeassistant:
    packages:
      railbus: !include railbus.yaml",
    }
    HaDiscovered {
        en: "{outlet} has \"discovery\": Home Assistant finds the modules itself and needs no file",
        zh: "{outlet} 已设置 \"discovery\"：Home Assistant 会自动发现模块，不需要此文件",
    }

    HaLeftOut {
        en: "left out, because {outlet} gives them no unit (see its \"modules\" and \"units\"): \
{modules}",
        zh: "未导出，因 {outlet} 没有为其分配单元号（见其 \"modules\" 和 \"units\"）：{modules}",
    }
    HaOnlyHere {
        en: "{outlet} listens at {listen}, for programs on that machine only; set \"listen\" and \
             \"allow\"",
        zh: "{outlet} 只监听 {listen}，仅供本机程序连接；请设置 \"listen\" 和 \"allow\"",
    }

    // Node-RED.
    NodeRedMqtt {
        en: "Each module has an output for every point: its changes, and null while its value is \
             not known. If the broker wants a user, enter it in the broker's settings. ON and OFF \
             go to the outputs that the integration may switch.",
        zh: "每个模块的每个点位有一个输出端：输出其变化，值未知时为 null。若代理需要用户名，请在代理设置中填写。\
             ON 和 OFF 发送到该集成允许操作的输出。",
    }
    NodeRedHttp {
        en: "Each module has an output for every point: its changes, and null while its value is \
             not known. Enter the token in the settings of this flow: environment variable \
             RAILBUS_TOKEN.",
        zh: "每个模块的每个点位有一个输出端：输出其变化，值未知时为 null。令牌填写在本流程的设置中：\
             环境变量 RAILBUS_TOKEN。",
    }
    NodeRedUser {
        en: "import the file in Node-RED; a user of the broker, if it wants one, is entered there",
        zh: "在 Node-RED 中导入此文件；代理如需用户名和密码，在该处填写",
    }
    NodeRedToken {
        en: "import the file in Node-RED, and enter the token in the flow's settings: {name}",
        zh: "在 Node-RED 中导入此文件，并在流程设置中填写令牌：{name}",
    }
    NodeRedResult { en: "results", zh: "结果" }

    // Telegraf.
    Telegraf {
        en: "railbus, site {site}: inputs of Telegraf 1.28 or newer, for /etc/telegraf/telegraf.d.
Only good values are taken, each with the time at which it was read.",
        zh: "railbus，站点 {site}：Telegraf 1.28 及以上版本的输入配置，存放在 /etc/telegraf/telegraf.d。
只采集质量良好的数值，时间为读取时间。",
    }

    // Prometheus.
    Prometheus {
        en: "railbus, site {site}: configuration of Prometheus. Its alerts, {rules}:
railbus export prometheus --rules",
        zh: "railbus，站点 {site}：Prometheus 的配置。报警规则 {rules}：
railbus export prometheus --rules",
    }
    PrometheusRules {
        en: "railbus, site {site}: alerts of Prometheus. Save it as {rules}.",
        zh: "railbus，站点 {site}：Prometheus 的报警规则，保存为 {rules}。",
    }
    AlertDown {
        en: "railbus does not answer at {{ $labels.instance }}",
        zh: "railbus 无应答：{{ $labels.instance }}",
    }
    AlertAudit {
        en: "the audit log is not written",
        zh: "审计日志无法写入",
    }
    AlertLine {
        en: "line {{ $labels.line }}: its port is not open",
        zh: "总线 {{ $labels.line }}：端口未打开",
    }
    AlertModule {
        en: "module {{ $labels.module }} does not answer, or is another model",
        zh: "模块 {{ $labels.module }} 无应答或型号不符",
    }
    AlertValues {
        en: "module {{ $labels.module }} is online, and some of its values are not good",
        zh: "模块 {{ $labels.module }} 在线，但部分数值质量不良",
    }
    AlertExchanges {
        en: "module {{ $labels.module }}: more than 5 % of the requests fail",
        zh: "模块 {{ $labels.module }}：超过 5 % 的请求失败",
    }
    AlertBusy {
        en: "line {{ $labels.line }} is busy for more than 90 % of the time",
        zh: "总线 {{ $labels.line }} 的占用率超过 90 %",
    }
    AlertOutlet {
        en: "integration {{ $labels.outlet }} ({{ $labels.kind }}) does not work",
        zh: "集成 {{ $labels.outlet }}（{{ $labels.kind }}）不工作",
    }

    // Grafana.
    GrafanaAbout {
        en: "Values, modules, lines and integrations of a site, from railbus export grafana.",
        zh: "站点的数值、模块、总线和集成，由 railbus export grafana 生成。",
    }
    GrafanaImport {
        en: "import the file in Grafana; its data are those of railbus export prometheus",
        zh: "在 Grafana 中导入此文件；数据来自 railbus export prometheus 的配置",
    }
    GrafanaDaemon { en: "Daemon answers", zh: "守护进程应答" }
    GrafanaAudit { en: "Audit log works", zh: "审计日志正常" }
    GrafanaOnline { en: "Modules online", zh: "在线模块" }
    GrafanaOffline { en: "Modules offline", zh: "离线模块" }
    GrafanaLines { en: "Lines not open", zh: "未打开的总线" }
    GrafanaOutlets { en: "Integrations not working", zh: "不工作的集成" }
    GrafanaModules { en: "Module online", zh: "模块在线" }
    GrafanaBusy { en: "Utilisation of lines", zh: "总线占用率" }
    GrafanaErrors { en: "Failed requests", zh: "失败的请求" }
    GrafanaRoundTrip { en: "Response time", zh: "响应时间" }
    GrafanaOutletStates { en: "Integration works", zh: "集成工作状态" }
    GrafanaQueues { en: "Waiting to be delivered", zh: "等待发送" }
    GrafanaValues { en: "Values", zh: "数值" }
    GrafanaNumbers { en: "Measured values", zh: "测量值" }
    Yes { en: "yes", zh: "是" }
    No { en: "no", zh: "否" }
    On { en: "on", zh: "通" }
    Off { en: "off", zh: "断" }
}
