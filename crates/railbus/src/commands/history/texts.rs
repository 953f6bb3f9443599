//! The texts of `railbus history`.

railbus_words::texts! {
    pub(crate) HistoryText;

    About {
        en: "Show the recorded values of a point (kept by the daemon).",
        zh: "显示守护进程保存的点位历史值。",
    }
    Examples {
        en: "  railbus history tank.ai1
  railbus history pump.do0 --since 7d
  railbus history pump.do0 --limit 10            the last ten changes
  railbus history tank.ai1 --since 12h --step 10m
  railbus history tank.ai1 --since 08:00 --until 16:30 -o csv > tank.csv",
        zh: "  railbus history tank.ai1
  railbus history pump.do0 --since 7d
  railbus history pump.do0 --limit 10            最近十次变化
  railbus history tank.ai1 --since 12h --step 10m
  railbus history tank.ai1 --since 08:00 --until 16:30 -o csv > tank.csv",
    }
    Point { en: "A point, such as pump.do0", zh: "点位，例如 pump.do0" }
    Since {
        en: "Start: \"2026-11-22 08:00\", 08:00, or 30m, 12h, 7d ago; default 1h",
        zh: "起始：\"2026-11-22 08:00\"、08:00，或 30m、12h、7d 之前；默认 1h",
    }
    Until {
        en: "End, in the same form; default now",
        zh: "结束，格式同上；默认现在",
    }
    Step {
        en: "Show minimum, maximum and mean of each step: 10s, 5m, 1h; at most 4000 steps",
        zh: "按固定时段给出平均、最小、最大值：10s、5m、1h；最多 4000 段",
    }
    Limit {
        en: "Show only the last N values (or steps), up to 4000",
        zh: "只显示最后 N 个值（或时段），最多 4000",
    }
    NothingBetween {
        en: "--since must be earlier than --until",
        zh: "--since 必须早于 --until",
    }
    Older {
        en: "older values not shown; raise --limit to see more",
        zh: "更早的值未显示；增大 --limit 可查看更多",
    }
    Means {
        en: "{samples} values shown in {lines} steps; --limit N shows the last N values, \
            --step TIME other steps",
        zh: "{samples} 个值按 {lines} 个时段显示；--limit N 显示最后 N 个值，--step 指定时段",
    }
    Head { en: "TIME|VALUE|QUALITY", zh: "时间|值|质量" }
    StretchHead {
        en: "FROM|MEAN|MIN|MAX|VALUES|QUALITY",
        zh: "起始|平均|最小|最大|值数|质量",
    }
}
