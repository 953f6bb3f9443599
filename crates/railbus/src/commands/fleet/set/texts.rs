//! The texts of commands to many sites.

railbus_words::texts! {
    pub(crate) BulkText;

    About {
        en: "Switch an output, or a group of outputs, at many sites. It is sent to those that are \
            online, 256 at a time; Ctrl-C stops it. From 10 sites on, their number is to be said.",
        zh: "对多个站点的同一输出或输出组下达命令：只发送给在线站点，每次最多 256 个，Ctrl-C 停止；\
            10 个及以上站点须给出数量。",
    }
    Examples {
        en: "  railbus fleet set oven.k1 on --group north -n
  railbus fleet set oven.k1 on --group north
  railbus fleet set '@night' off --all --count 120
  railbus fleet set oven.k1 toggle plant1 plant7",
        zh: "  railbus fleet set oven.k1 on --group north -n
  railbus fleet set oven.k1 on --group north
  railbus fleet set '@night' off --all --count 120
  railbus fleet set oven.k1 toggle plant1 plant7",
    }
    Target {
        en: "The output, or the group, as each site names it: oven.k1, @night",
        zh: "各站点的输出或输出组：oven.k1、@night",
    }
    NewState { en: "on, off or toggle", zh: "on、off 或 toggle" }
    Sites { en: "These sites", zh: "指定站点" }
    OfGroup { en: "The sites of this group", zh: "该分组的站点" }
    Found {
        en: "The sites that have these words in their name, version, groups or points",
        zh: "名称、版本、分组或点位中含这些词的站点",
    }
    AllSites { en: "All sites of the fleet", zh: "站群的全部站点" }
    Preview { en: "Show the sites, switch nothing", zh: "只列出站点，不操作" }
    Count {
        en: "How many sites it is meant for; if there are others, nothing is sent",
        zh: "预期的站点数；与实际不符则不发送",
    }
    WhichSites {
        en: "nothing was sent: say at which sites, by name, --group, --search or --all",
        zh: "未发送：请用站点名、--group、--search 或 --all 指定站点",
    }
    Named {
        en: "command {id}: railbus fleet commands {id} shows it",
        zh: "命令编号 {id}：用 railbus fleet commands {id} 查看",
    }
    BadTarget {
        en: "\"{word}\" names no output, as oven.k1 does, and no group, as @night does; \
            patterns can't be given",
        zh: "\"{word}\" 不是输出（如 oven.k1）或输出组（如 @night）；不支持通配",
    }
    NoSites { en: "nothing was sent: no site is selected", zh: "未发送：没有选中任何站点" }
    OtherCount {
        en: "nothing was sent: there are {count} sites, not {said}",
        zh: "未发送：实际有 {count} 个站点，而非 {said}",
    }
    SayCount {
        en: "nothing was sent: say that {count} sites are meant: --count {count}",
        zh: "未发送：请确认对 {count} 个站点执行：--count {count}",
    }
    TypeCount {
        en: "type the number of sites, {count}, to switch there:",
        zh: "输入站点数 {count} 以执行：",
    }
    Sendable {
        en: "sites: {count}; online, would be sent it: {sendable}",
        zh: "站点 {count} 个，其中在线、将会发送的 {sendable} 个",
    }
    PreviewHead { en: "SITE|STATE|NOW|NOTE", zh: "站点|状态|当前|备注" }
    WouldNot { en: "would not be sent it", zh: "不会发送" }
    SoFar { en: "results: {ended} of {count}", zh: "已有结果：{ended}/{count}" }
    Stopping {
        en: "stopping: no further sites; what has begun goes on",
        zh: "正在停止：不再下达其余站点；已开始的继续执行",
    }
    GoesOn {
        en: "it may go on: railbus fleet commands {id} shows it, and stops it with --stop",
        zh: "命令可能仍在执行：用 railbus fleet commands {id} 查看，加 --stop 停止",
    }
    SomeFailed {
        en: "not done, or not known to be, at {failed} of {count} sites",
        zh: "{count} 个站点中有 {failed} 个未完成或结果未知",
    }
    OneSite { en: "1 site", zh: "1 个站点" }
    ManySites { en: "{count} sites", zh: "{count} 个站点" }
    StoppedBy { en: "stopped by {who}", zh: "由 {who} 停止" }
    NotSentYet { en: "no record of sending", zh: "尚无发送记录" }
    DoneAt { en: "done: {count}", zh: "已完成 {count}" }
    UnconfirmedAt { en: "sent, not confirmed: {count}", zh: "已发送未确认 {count}" }
    FailedAt { en: "failed: {count}", zh: "失败 {count}" }
    NeverAt { en: "not carried out: {count}", zh: "未执行 {count}" }
    UnknownAt { en: "not known: {count}", zh: "未知 {count}" }
    OpenAt { en: "no answer yet: {count}", zh: "尚无应答 {count}" }
    WaitingAt { en: "no record of sending: {count}", zh: "尚无发送记录 {count}" }
    Many { en: "{sites} ({id})", zh: "{sites}（{id}）" }
    NotAll {
        en: "the centre has no connection: more may have been sent, and more be known, than it \
            shows",
        zh: "中心未连接服务器：实际发送和已知的结果可能多于所示",
    }
    NoSuch {
        en: "no command to several sites has an id that begins with {id}",
        zh: "没有编号以 {id} 开头的多站点命令",
    }
    StopIt {
        en: "With an ID: no further sites are commanded; what has begun goes on",
        zh: "须给出编号：不再下达其余站点，已开始的继续执行",
    }
}
